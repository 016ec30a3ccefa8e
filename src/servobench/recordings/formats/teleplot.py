"""Logs of Teleplot, a value a line: `>speed:1709642096010:3.25§rpm` is a name, a time in ms, a value and a unit.

Source: Alexandre Brehmer, github.com/nesnes/teleplot, README.md.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, NoReturn, final

import numpy as np
from numpy.typing import NDArray

from servobench.core.errors import FormatError, UsageError
from servobench.core.finding import Finding, info
from servobench.recordings.formats import text_table
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.columns import (
    LARGEST_TABLE,
    Column,
    Heading,
    heading,
    recording_of,
    with_unit,
)
from servobench.recordings.formats.times import in_words
from servobench.recordings.recording import Recording, Source

_NUMBER = r"[+-]?[0-9]{1,20}(?:\.[0-9]*)?(?:e[+-]?[0-9]{1,3})?"
_POINTS = rf"{_NUMBER}:{_NUMBER}(?:;{_NUMBER}:{_NUMBER})*"
_LINE = re.compile(
    rf"\s*>?(?P<name>[^\W\d][^:;|§]*):(?P<points>{_POINTS});?(?:§(?P<unit>[^|]*))?(?:\|.*)?\s*", re.IGNORECASE
)
_FEWEST = 2  # lines by which a file is recognised


@final
@FORMATS.member("teleplot")
@dataclass(frozen=True, kw_only=True)
class Teleplot:
    """Logs of Teleplot: one recording, in which each name has times of its own. They are read and not written."""

    suffixes: ClassVar[tuple[str, ...]] = (".txt",)
    written: ClassVar[tuple[str, ...]] = ()
    by_library: ClassVar[bool] = False

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file begins with a name, a time and a value in each line."""
        lines = head.decode("utf-8-sig", "replace").splitlines()[:-1]
        return len(lines) >= _FEWEST and all(
            line.startswith(">") and _LINE.fullmatch(line) for line in lines[:20]
        )

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recording; raises `FormatError` where no line has a name, a time and a value."""
        data = path.read_bytes()
        text_table.check_lines(data, path.name)
        text, findings = text_table.decode(data, path.name)
        points: dict[str, list[tuple[float, float]]] = {}
        units: dict[str, str] = {}
        others = []
        for row, line in enumerate(text.split("\n"), 1):
            match = _LINE.fullmatch(line)
            if match is None:
                others += [row] if line.strip() else []
                continue
            points.setdefault(match["name"], []).extend(map(_point, match["points"].split(";")))
            units.setdefault(match["name"], match["unit"] or "")
        if not 0 < len(points) <= LARGEST_TABLE:
            raise FormatError(
                f"{path.name} has {len(points)} names with times and values; expected 1 to {LARGEST_TABLE}"
            )
        return (_recording(points, units, np.array(others, dtype=np.int64), path, findings),)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> NoReturn:
        """Raise `UsageError`: a log of Teleplot can't hold what a recording knows."""
        raise UsageError(f"{path.name}: logs of Teleplot can't be written; write .mcap, .mat or .csv instead")


def _point(text: str) -> tuple[float, float]:
    """The time [ms] and the value in `time:value`."""
    time, _, value = text.partition(":")
    return float(time), float(value)


def _recording(
    points: dict[str, list[tuple[float, float]]],
    units: dict[str, str],
    others: NDArray[np.int64],
    path: Path,
    findings: tuple[Finding, ...],
) -> Recording:
    """The recording of points by name, with the times in s since the first of all."""
    first = min(time for each in points.values() for time, _ in each)
    columns: list[Column] = []
    notes: list[Finding] = []
    for name, each in points.items():
        t, values = np.array(each).T
        label, about_unit = with_unit(heading(name), units[name])
        notes += about_unit
        columns.append(
            Column(heading=Heading(name=label.name, unit=label.unit), values=values, t=1e-3 * (t - first))
        )
    if len(others):
        sentence = f"Lines that aren't a name, a time and a value aren't read: {in_words(others)}."
        notes.append(info("rows-text", sentence, rows=(int(others[0]), int(others[-1]))))
    source = Source(name=path.name, format="teleplot")
    return recording_of(columns, name=path.stem, source=source, findings=(*findings, *notes))
