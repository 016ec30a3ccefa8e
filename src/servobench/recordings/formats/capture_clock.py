"""The clock time that a serial monitor puts in front of each line, as the Arduino IDE does: `12:34:56.793 -> 5,3`.

The board didn't send it, so that it is no part of the row: it becomes a column of its own behind the others.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from servobench.core.channels import Array
from servobench.core.finding import Finding, info
from servobench.recordings.formats.columns import Heading, time_unit
from servobench.recordings.formats.time_stamps import seconds_from_first

CAPTURE_TIME = Heading(name="capture_time", unit="s")
"""The heading of the column of clock times."""

_CAPTURED = re.compile(r"\s*(?P<clock>[0-9]{1,2}:[0-9]{2}:[0-9]{2}(?:\.[0-9]{1,9})?)\s*->(?P<line>.*)")
_FIRST = 1000  # lines, among which the first of a capture must be
_SHARE = 0.5  # of the lines with text; a monitor puts the clock in front of every line


def without_clock(lines: Sequence[str]) -> tuple[Sequence[str], list[str]]:
    """Return the lines of a text as the board sent them, and their clock times, "" where a line has none.

    No clock times where most lines have none.
    """
    if not any("->" in line for line in lines[:_FIRST]):
        return lines, []
    captured = [_CAPTURED.fullmatch(line) if "->" in line else None for line in lines]
    count = sum(match is not None for match in captured)
    if not count or count <= _SHARE * sum(bool(line.strip()) for line in lines):
        return lines, []
    sent = [match["line"] if match else line for match, line in zip(captured, lines, strict=True)]
    return sent, [match["clock"] if match else "" for match in captured]


def clock_column(clocks: Sequence[str]) -> tuple[Array, Finding]:
    """Return the clock times (N,) in seconds from the first, and the finding on the column."""
    sentence = (
        f"Each line begins with the clock time of its capture, such as {next(filter(None, clocks), '')!r}; these times "
        f"become the column `{CAPTURE_TIME.name}`, in seconds from the first."
    )
    return seconds_from_first(clocks), info("time-stamps", sentence)


def is_the_time(headings: Sequence[Heading]) -> bool:
    """Return whether the clock may be the time: none of the other columns is called a time and has a unit of its own."""
    return not any(each.unit is not None and time_unit(each) is not None for each in headings)
