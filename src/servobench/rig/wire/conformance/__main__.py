"""`python -m servobench.rig.wire.conformance PORT`: whether a board keeps the rules of the rig's protocol."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress

from servobench.core.errors import DeviceError, ServobenchError
from servobench.rig.wire.conformance.base import Outcome, outcomes
from servobench.rig.wire.conformance.checks import AT_REST
from servobench.rig.wire.conformance.driven import DRIVEN, DUTY
from servobench.rig.wire.conformance.session import Session
from servobench.rig.wire.messages import protocol

_BREAKS_RULES = 1
_BOOT_TIME = 4.0  # s; a board that is reset by the opening of its port runs its boot loader first
_MARKS = {"passed": "passed", "failed": "FAILED", "not offered": "not offered"}


def main(arguments: Sequence[str] | None = None) -> int:
    """Test the board that the command line names, print a table, and return the exit status."""
    options = _parser().parse_args(arguments)
    from servobench.rig.wire.serial_port import SerialPort

    try:
        session = Session(SerialPort(options.port, options.baud))
        greet(session, options.port)
        return report(session, spin=options.spin, write=sys.stdout.write)
    except OSError as error:
        word = (
            str(error)
            if isinstance(error, DeviceError)
            else f"the port {options.port} is gone ({error.strerror or error})"
        )
        sys.stderr.write(f"{word}\n")
        return DeviceError.exit_status
    except ServobenchError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_status


def greet(session: Session, name: str) -> None:
    """Wait for a board to come up; raises `DeviceError` where nobody answers."""
    begun = session.now()
    while session.now() - begun < _BOOT_TIME:
        with suppress(DeviceError):
            session.ask("hello", schema=protocol().schema)
            return
    raise DeviceError(
        f"nobody at {name} answers HELLO with a STATUS of {protocol().message('status').struct.size} bytes; look at the "
        "baud rate, at the frames (COBS, CRC), and at INFO and STATUS in docs/reference/rig-protocol.md"
    )


def report(session: Session, *, spin: bool, write: Callable[[str], object]) -> int:
    """Carry the checks out, write a line for each and the sum, and return the exit status."""
    results: list[Outcome] = []
    for outcome in outcomes([*AT_REST, *(DRIVEN if spin else ())], session):
        results.append(outcome)
        write(
            f"{_MARKS[outcome.verdict]:12} {outcome.check.name:24} {' '.join(outcome.check.rule.split())}\n"
        )
        if outcome.found:
            write(f"{'':12} {'':24} -> {outcome.found}\n")
    if not spin:
        for check in DRIVEN:
            write(f"{'not asked':12} {check.name:24} {' '.join(check.rule.split())}\n")
    failed = sum(each.verdict == "failed" for each in results)
    passed = sum(each.verdict == "passed" for each in results)
    left = "" if spin else f", {len(DRIVEN)} turn the motor and weren't requested (--spin)"
    write(f"\n{passed} passed, {failed} failed, {len(results) - passed - failed} not offered{left}\n")
    write("Not tried: what hangs the main loop, resets the chip or damages the encoder's signals.\n")
    return _BREAKS_RULES if failed else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m servobench.rig.wire.conformance",
        description="Test whether a board speaks the rig's protocol as docs/reference/rig-protocol.md says. Nothing turns.",
        epilog="Exit status: 0 if the board keeps all rules that it offers, 1 if it breaks one, 4 if there is no board.",
    )
    parser.add_argument("port", metavar="PORT", help="the serial port, such as /dev/ttyUSB0 or COM3")
    parser.add_argument("--baud", type=int, default=500_000, help="its rate (default: 500000)")
    parser.add_argument(
        "--spin",
        action="store_true",
        help=f"turn the motor, too, with up to {DUTY} of {protocol().constants['duty_full']} of its supply, for some seconds "
        "either way: nothing on the shaft, a hand on the switch",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
