"""Rows that name their values, or give their units: `RPM:0.00,PWM:0`, `t=0, pwm=3`, `t,0,pwm,3`, `0.010s, 1.20V`.

The serial plotter of the Arduino IDE expects such rows, and so do people. Rows with the same names in the same order are a table.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from servobench.core.finding import Finding, info
from servobench.core.units import is_unit
from servobench.recordings.formats.columns import quote

SEPARATOR = "\t"
"""What stands between the values of a row once their labels are gone."""

_CLOCK = r"[0-9]{1,2}:[0-9]{2}:[0-9]{2}(?:[.,][0-9]++)?"
# A comma right before the next name separates, so that the one in `a:1,2,b:3` isn't a decimal mark.
_VALUE = rf"{_CLOCK}|[^\s,;|:=]++(?:,[0-9][^\s,;|:=]*+(?!,\S))?"
_PAIR = re.compile(
    rf"""[\s,;|]{{0,200}}+["']?(?P<name>[^\W\d][^:=,;|\t"']{{0,100}}+)["']?\s*+[:=]\s*+"""
    rf"(?P<value>(?:{_VALUE})(?:[ ][^\W\d_][^\s,;|:=]*+(?=\s*+(?:[,;|\t]|$)))?)"
)
_END = re.compile(r"[\s,;|]*")
_WITH_UNIT = re.compile(
    r"(?P<number>[+-]?(?:[0-9]++(?:[.,][0-9]*+)?|[.,][0-9]++)(?:e[+-]?[0-9]++)?)\s?(?P<unit>(?:(?:[^\W\d_]|[°%])\S*)?)",
    re.IGNORECASE,
)
_NAME = re.compile(r"[^\W\d][^:=,;|\t\"']{0,100}+")
_NUMBER = re.compile(r"[+-]?(?:[0-9]++\.?[0-9]*+|\.[0-9]++)(?:[eE][+-]?[0-9]++)?")
_BEGINS_WITH_A_NAME = re.compile(r"\s*[^\W\d][^:=]*+$")
_FEWEST = 2  # names in a row
_NEARLY_ALL = 0.9  # of the rows
_SHARE = 0.5  # of the rows, more than which have the same labels
_MOST = 100  # values in a row


@dataclass(frozen=True, kw_only=True)
class BareRows:
    """Rows without their labels: the `lines`, in which the row of names is new or rewritten.

    The row of names is the line `header`, counted from 0; `is_new` says that the text has no such line, and `finding`
    what the rows were like.
    """

    lines: list[str]
    header: int
    is_new: bool
    finding: Finding


def without_labels(content: Sequence[str], sample: Sequence[str]) -> BareRows | None:
    """Return the rows of a table without labels; None where not most of a `sample` of them have the same ones."""
    if _names_stand_in_turn(content, sample):
        content, sample = ([_with_marks(line) for line in lines] for lines in (content, sample))
    pairs = [each for line in sample if (each := _pairs(line))]
    names, count = (
        Counter(tuple(name for name, _ in each) for each in pairs).most_common(1)[0] if pairs else ((), 0)
    )
    if count > _SHARE * len(sample):
        rows = [[value for _, value in each] for each in pairs if tuple(name for name, _ in each) == names]
        return _without_names(content, names, _units(rows))
    cells = [row for line in sample if (row := _numbers_with_units(line))]
    width, count = Counter(map(len, cells)).most_common(1)[0] if cells else (0, 0)
    units = _units([row for row in cells if len(row) == width])
    return _without_units(content, units) if count > _SHARE * len(sample) and any(units) else None


def _with_marks(line: str) -> str:
    """A row of names and numbers in turn, `PWM,-120,Enc1,-45.1`, as `PWM:-120,Enc1:-45.1`; any other as it is."""
    if not _BEGINS_WITH_A_NAME.match(line):
        return line
    cells = _cells(line)
    names, values = cells[::2], cells[1::2]
    in_turn = len(values) >= _FEWEST and len(names) == len(values) and all(map(_NAME.fullmatch, names))
    if not (in_turn and all(map(_NUMBER.fullmatch, values))):
        return line
    return ",".join(f"{name}:{value}" for name, value in zip(names, values, strict=True))


def _names_stand_in_turn(content: Sequence[str], sample: Sequence[str]) -> bool:
    """Whether nearly all rows have the same names between their numbers, and no row above them names columns of words instead."""
    in_turn = [_with_marks(line) != line for line in sample]
    if not any(in_turn):
        return False
    below = sample[in_turn.index(True) :]
    names = Counter(tuple(_cells(line)[::2]) for line in below if _with_marks(line) != line)
    if names.most_common(1)[0][1] < _NEARLY_ALL * len(below):
        return False
    width = 2 * len(names.most_common(1)[0][0])
    first = next((k for k, line in enumerate(content) if _with_marks(line) != line), 0)
    above = (_cells(line) for line in content[:first])
    return not any(len(cells) == width and not any(map(_NUMBER.fullmatch, cells)) for cells in above)


def _pairs(line: str) -> list[tuple[str, str]]:
    """The names and values of a row; none where it holds anything else."""
    pairs: list[tuple[str, str]] = []
    place = 0
    while (match := _PAIR.match(line, place)) and len(pairs) < _MOST:
        pairs.append((match["name"].strip(), match["value"].strip("\"'")))
        place = match.end()
        if place < len(line) and line[place] in "\"'":
            place += 1
    return _with_units_behind(pairs) if _END.fullmatch(line, place) else []


def _with_units_behind(pairs: Sequence[tuple[str, str]]) -> list[tuple[str, str]]:
    """The same with a unit that stands before a name, as in `t=40 ms pwm=3`, behind the bare number before it.

    One letter but `s` may as well be the beginning of a name, as in `t=40 V in=3`.
    """
    moved: list[tuple[str, str]] = []
    for name, value in pairs:
        word, _, rest = name.partition(" ")
        before = _WITH_UNIT.fullmatch(moved[-1][1]) if moved and rest else None
        if before and not before["unit"] and is_unit(word) and (len(word) > 1 or word == "s"):
            moved[-1] = moved[-1][0], f"{moved[-1][1]} {word}"
            name = rest.strip()
        moved.append((name, value))
    return moved


def _numbers_with_units(line: str) -> list[str]:
    """The cells of a row of numbers that may have units behind them; none where it holds anything else."""
    cells = _cells(line)
    return cells if all(map(_WITH_UNIT.fullmatch, cells)) else []


def _cells(line: str) -> list[str]:
    for mark in (";", "\t", "|", ","):
        if mark in line:
            return [cell.strip() for cell in line.strip().rstrip(mark).split(mark)]
    return line.split()


def _units(rows: Sequence[Sequence[str]]) -> list[str]:
    """The unit behind the numbers of each column, "" where they have none, or not all the same one."""
    units = []
    for column in zip(*rows, strict=True):
        matches = [_WITH_UNIT.fullmatch(cell) for cell in column]
        texts = {match["unit"] if match else "" for match in matches}
        text = texts.pop() if len(texts) == 1 else ""
        units.append(text if text and is_unit(text) else "")
    return units


def _row(cells: Sequence[str], units: Sequence[str]) -> str:
    """A row of values without the units behind them."""
    bare = (
        cell.removesuffix(unit).rstrip() if unit else cell for cell, unit in zip(cells, units, strict=True)
    )
    return SEPARATOR.join(bare)


def _header(names: Sequence[str], units: Sequence[str]) -> str:
    return SEPARATOR.join(
        f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)
    )


def _without_names(content: Sequence[str], names: Sequence[str], units: Sequence[str]) -> BareRows:
    lines, first = [], len(content)
    for k, line in enumerate(content):
        pairs = _pairs(line)
        fits = tuple(name for name, _ in pairs) == tuple(names)
        first = min(first, k) if fits else first
        lines.append(_row([value for _, value in pairs], units) if fits else _short_row(line, names))
    lines.insert(first, _header(names, units))
    sentence = f"Each row names its values; the columns take these names: {quote(names)}."
    return BareRows(lines=lines, header=first, is_new=True, finding=info("labelled-values", sentence))


def _short_row(line: str, names: Sequence[str]) -> str:
    """What is left of a row whose names aren't all there, or in another order: a row that is too short, or text."""
    values = [match["value"] for match in _PAIR.finditer(line) if match["name"].strip() in names]
    return SEPARATOR.join(values[: len(names) - 1]) or line


def _without_units(content: Sequence[str], units: Sequence[str]) -> BareRows:
    lines, first = [], len(content)
    for k, line in enumerate(content):
        cells = _numbers_with_units(line)
        fits = len(cells) == len(units)
        first = min(first, k) if fits else first
        lines.append(_row(cells, units) if fits else SEPARATOR.join(_cells(line)))
    names = _cells(content[first - 1]) if first else []
    is_new = len(names) != len(units)
    if is_new:
        names = [f"column_{number}" for number in range(1, len(units) + 1)]
        lines.insert(first, _header(names, units))
    else:
        first -= 1
        lines[first] = _header(names, units)
    of_columns = ", ".join(f"`{name}` in {unit}" for name, unit in zip(names, units, strict=True) if unit)
    sentence = f"The units follow the numbers: {of_columns}."
    return BareRows(lines=lines, header=first, is_new=is_new, finding=info("labelled-values", sentence))
