"""`python -m servobench.compat.quanser SCRIPT.py`: runs a program that was written for a QUBE on a simulated one."""

from __future__ import annotations

import argparse
import atexit
import math
import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from servobench.compat.quanser.program import Program

if TYPE_CHECKING:
    from servobench.compat.quanser.motion import Mounted
    from servobench.compat.quanser.session import Bench

_WRONG_USAGE = 2


def main(arguments: list[str] | None = None) -> int:
    """Run the program that the command line names, and return the exit status."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.hand and not options.pendulum:
        parser.error("--hand needs --pendulum: there is nothing to lift or to hold on a disc")
    script = Path(options.script)
    if not script.is_file():
        sys.stderr.write(
            f"{script} is a folder; name the program in it\n"
            if script.is_dir()
            else f"no such file: {script}\n"
        )
        return _WRONG_USAGE
    program = Program(options.script)
    _bench(options, program)
    sys.argv = [options.script, *options.arguments]
    sys.path[0] = str(script.resolve().parent)
    return program.run()


def _bench(options: argparse.Namespace, program: Program) -> None:
    """Install the stand-in; what ends it is registered first, so that it runs after all that the program registers."""
    from servobench.compat.quanser import install

    mounted: dict[str | None, Mounted] = {
        None: "lifted",
        "lifts": "lifted",
        "holds": "upright",
        "none": "hanging",
    }
    bench = install(
        time="real" if options.real_time else "simulated",
        mounted=mounted[options.hand] if options.pendulum else "disc",
        has_watchdog=not options.no_watchdog,
    )
    bench.unplug_at = options.unplug
    process = os.getpid()

    def finish() -> None:
        if os.getpid() == process:  # and not in a child that was forked off
            program.drop()
            _finish(bench)

    def end(number: int, frame: object) -> None:
        """End at once, as Python does, where neither `finally` nor what is registered for the exit runs."""
        if os.getpid() == process:
            _finish(bench)
        signal.signal(number, signal.SIG_DFL)
        os.kill(os.getpid(), number)

    atexit.register(finish)
    signal.signal(signal.SIGTERM, end)


def _finish(bench: Bench) -> None:
    """Put the boards to rest, and say how it ended."""
    bench.uninstall()
    if bench.forks:
        bench.say("child processes were started; what they left on a board isn't reported here.")
    if not bench.endings:
        bench.say(f"end: {'this process opened no board' if bench.forks else 'no board was opened'}.")
    for ending in bench.endings:
        bench.say(f"end: {ending}")


def _seconds(text: str) -> float:
    """A time from the command line [s]."""
    seconds = float(text)
    if not seconds >= 0.0:
        raise argparse.ArgumentTypeError(f"{text} isn't a time; give seconds, 0 or more")
    return seconds


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
        help="the hand lifts the pendulum after 2 s if the program waits for that (the default), holds it upright from "
        "the start, or there is none; it lets go when the motor takes over",
    )
    parser.add_argument(
        "--unplug", metavar="SECONDS", type=_seconds, default=math.inf, help="unplug the board at that time"
    )
    parser.add_argument("--no-watchdog", action="store_true", help="let the board have no watchdog")
    return parser


if __name__ == "__main__":
    sys.exit(main())
