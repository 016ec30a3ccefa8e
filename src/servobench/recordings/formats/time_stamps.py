"""Time stamps and times of day in cells of a text table, as seconds from the first of them.

Source: ISO 8601, dates as year, month and day, times to the second or finer, with or without a zone.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import date

import numpy as np

from servobench.core.channels import Array

_DAY = 86_400
_CLOCK = r"(?P<hour>[01]?[0-9]|2[0-3]):(?P<minute>[0-5][0-9]):(?P<second>[0-5][0-9]|60)(?:[.,](?P<part>[0-9]{1,12}))?"
_DATE = r"(?P<year>[0-9]{4})[-/](?P<month>[0-9]{2})[-/](?P<day>[0-9]{2})"
_ZONE = r"(?P<zone>Z|[+-][0-9]{2}:?[0-9]{2})?"
_STAMP = re.compile(rf"(?:{_DATE}[T ]\s*)?{_CLOCK}\s*{_ZONE}", re.IGNORECASE)


STAMP_FORMS = "time stamps are read in the form of '12:34:56.789' or '2024-03-05 12:34:56.789'"
"""What a message says to somebody whose times are written in another form."""


def resembles_stamp(cell: str) -> bool:
    """Return whether a cell may be meant as a time of day: it has digits on both sides of a colon."""
    return re.search(r"[0-9]:[0-9]", cell) is not None


def is_stamp(cell: str) -> bool:
    """Return whether a cell is a time stamp, with or without a date."""
    return _parse(cell) is not None


def seconds_from_first(cells: Sequence[str]) -> Array:
    """Return seconds (N,) from the first time stamp in cells, NaN where a cell is none.

    A time of day without a date that is more than half a day earlier than the one before is on the next day.
    """
    t = np.full(len(cells), np.nan)
    days, before, first = 0, 0, None
    for k, cell in enumerate(cells):
        stamp = _parse(cell)
        if stamp is None:
            continue
        whole, part, dated = stamp
        if first is None:
            first = (whole, part)
        elif not dated and whole + days * _DAY < before - _DAY // 2:
            days += 1
        before = whole + (0 if dated else days * _DAY)
        # The seconds are subtracted as whole numbers: since the year 1 a float has no microseconds left.
        t[k] = (before - first[0]) + (part - first[1])
    return t


def _parse(cell: str) -> tuple[int, float, bool] | None:
    """Whole seconds, the part of a second, and whether there is a date; None for what is no time stamp."""
    match = _STAMP.fullmatch(cell)
    if match is None:
        return None
    days = 0
    if match["year"]:
        try:
            days = date(int(match["year"]), int(match["month"]), int(match["day"])).toordinal()
        except ValueError:  # there is no such day
            return None
    clock = 3600 * int(match["hour"]) + 60 * int(match["minute"]) + int(match["second"])
    whole = _DAY * days + clock - _offset(match["zone"] or "")
    return whole, float(f"0.{match['part'] or 0}"), bool(match["year"])


def _offset(zone: str) -> int:
    """A zone's offset from universal time, positive to the east [s]."""
    if zone in {"", "Z", "z"}:
        return 0
    hours, minutes = int(zone[1:3]), int(zone[-2:])
    return (3600 * hours + 60 * minutes) * (-1 if zone.startswith("-") else 1)
