"""Tables of oscilloscopes that number their rows, and give the times as a start and an increment above them (Rigol).

X,CH1,CH2,Start,Increment,
Sequence,Volt,Volt,-1.000000e+00,2.000000e-02
0,4.7059e-01,0.0000e+00,,
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from servobench.core.finding import Finding, info
from servobench.core.rounding import plain

_NAMES = ("start", "increment")  # of the last two columns
_UNITS = {"volt": "V", "amp": "A", "ampere": "A"}


def with_times(content: Sequence[str]) -> tuple[list[str], float, float] | None:
    """Return the lines with a column of times [s] in place of the rows' numbers, the start and the increment [s].

    The second line, of the units, is in the first one afterwards. None where the lines are no such table.
    """
    if len(content) < 2:
        return None
    names, units = (_cells(line) for line in content[:2])
    columns = len(names) - len(_NAMES)
    if (
        tuple(name.casefold() for name in names[columns:]) != _NAMES
        or len(units) != len(names)
        or columns < 2
    ):
        return None
    start, increment = (_number(cell) for cell in units[columns:])
    if not (math.isfinite(start) and increment > 0):
        return None
    named = (
        f"{name} [{_UNITS.get(unit.casefold(), unit)}]"
        for name, unit in zip(names[1:columns], units[1:columns], strict=True)
    )
    rows = [_with_time(line.split(",")[:columns], start, increment) for line in content[2:]]
    return [",".join(["t [s]", *named]), *rows], start, increment


def about_times(start: float, increment: float, rows: tuple[int, int]) -> Finding:
    """Return the finding on times that begin at a start [s] and go on by an increment [s], as two rows of the file say."""
    sentence = (
        f"The times are the oscilloscope's: its rows have numbers, and the two lines above them a start of {plain(start)} s and "
        f"an increment of {plain(increment)} s."
    )
    return info("start-and-increment", sentence, rows=rows)


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.rstrip(", \t").split(",")]


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return math.nan


def _with_time(cells: list[str], start: float, increment: float) -> str:
    """A row with its time in place of its number; one without a number as it is."""
    number = _number(cells[0])
    time = f"{start + number * increment:.12g}" if math.isfinite(number) else cells[0]
    return ",".join([time, *cells[1:]])
