"""A process's output is read as it comes: it never waits for a full pipe, and its words can't forge a terminal's."""

import subprocess
import sys

from servobench.rig.loop.chatter import SHOWN, Chatter

LINES = 2000  # of 100 characters: three times what a pipe holds
PATIENCE = 60.0  # s; an interpreter that starts on a busy machine


def shown_of(program: str) -> tuple[list[str], Chatter]:
    shown: list[str] = []
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    assert process.stdout is not None
    chatter = Chatter(process.stdout, shown.append)
    process.wait(PATIENCE)
    chatter.end()
    return shown, chatter


def test_a_process_that_prints_more_than_a_pipe_holds_comes_to_its_end() -> None:
    shown, chatter = shown_of(f"for n in range({LINES}): print(f'{{n:099}}')")

    assert shown[:SHOWN] == [f"{n:099}" for n in range(SHOWN)]
    assert shown[SHOWN:] == [f"… and {LINES - SHOWN} more lines; the last one: {LINES - 1:099}"]
    assert chatter.last == f"{LINES - 1:099}"


def test_a_line_without_an_end_is_taken_in_pieces() -> None:
    shown, _ = shown_of("print('x' * 1_000_000, end='')")

    assert max(map(len, shown)) < 1000


def test_control_characters_are_shown_and_not_obeyed() -> None:
    shown, _ = shown_of(r"print('\x1b[2Jgone\rError: forged')")

    assert shown == [r"\x1b[2Jgone\rError: forged"]
