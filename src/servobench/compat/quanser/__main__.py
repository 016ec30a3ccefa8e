"""`python -m servobench.compat.quanser SCRIPT.py`: runs a program that was written for a QUBE on a simulated one."""

from __future__ import annotations

import argparse
import atexit
import runpy
import signal
import sys
import traceback
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from servobench.compat.quanser.motion import Mounted
    from servobench.compat.quanser.session import Bench

_FAILED, _WRONG_USAGE, _INTERRUPTED = 1, 2, 130


def main(arguments: list[str] | None = None) -> int:
    """Run the program that the command line names, and return the exit status."""
    given = _parser().parse_args(arguments)
    script = Path(given.script)
    if not script.is_file():
        sys.stderr.write(f"no such file: {script}\n")
        return _WRONG_USAGE
    bench = _bench(given)
    signal.signal(signal.SIGTERM, _end)
    sys.argv = [str(script), *given.arguments]
    sys.path[0] = str(script.resolve().parent)
    try:
        runpy.run_path(str(script), run_name="__main__")
    except Exception as error:
        # Without the frames of whoever runs the program.
        traceback.print_exception(error.with_traceback(_own_frames(error, script)))
        return _FAILED
    except KeyboardInterrupt:
        bench.say("interrupted")
        return _INTERRUPTED
    return 0


def _bench(given: argparse.Namespace) -> Bench:
    """Install the stand-in; what ends it is registered first, so that it runs after all that the program registers."""
    from servobench.compat.quanser import install

    mounted: dict[str, Mounted] = {"lifts": "lifted", "holds": "upright", "none": "hanging"}
    bench = install(
        time="real" if given.real_time else "simulated",
        mounted=mounted[given.hand] if given.pendulum else "disc",
        has_watchdog=not given.no_watchdog,
    )
    bench.unplug_at = given.unplug
    atexit.register(_finish, bench)
    return bench


def _finish(bench: Bench) -> None:
    """Put the boards to rest, and say how it ended."""
    bench.uninstall()
    if not bench.endings:
        bench.say("end: no board was opened.")
    for ending in bench.endings:
        bench.say(f"end: {ending}")


def _end(number: int, frame: object) -> None:
    """End as on a request of the program itself, so that everything is put to rest."""
    sys.exit(128 + number)


def _own_frames(error: BaseException, script: Path) -> TracebackType | None:
    """The part of a traceback that begins in the program."""
    trace = error.__traceback__
    while trace and Path(trace.tb_frame.f_code.co_filename) != script:
        trace = trace.tb_next
    return trace or error.__traceback__


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m servobench.compat.quanser",
        description="Run a program that was written for a Quanser QUBE-Servo on a simulated one, a stand-in for the board.",
    )
    parser.add_argument("script", metavar="SCRIPT.py", help="the program, unmodified")
    parser.add_argument("arguments", metavar="...", nargs=argparse.REMAINDER, help="arguments of the program")
    clock = parser.add_mutually_exclusive_group()
    clock.add_argument(
        "--virtual", action="store_true", help="simulated time, in which waits take none (the default)"
    )
    clock.add_argument(
        "--real-time", action="store_true", help="let the wall clock set the pace from the start"
    )
    parser.add_argument("--pendulum", action="store_true", help="mount a pendulum in the disc's place")
    parser.add_argument(
        "--hand",
        choices=("lifts", "holds", "none"),
        default="lifts",
        help="the hand that lifts the pendulum after 2 s where the program waits for that (the default), holds it upright from "
        "the start, or isn't there; it lets go where the motor takes over",
    )
    parser.add_argument(
        "--unplug", metavar="SECONDS", type=float, default=float("inf"), help="unplug the board at that time"
    )
    parser.add_argument("--no-watchdog", action="store_true", help="let the board have no watchdog")
    return parser


if __name__ == "__main__":
    sys.exit(main())
