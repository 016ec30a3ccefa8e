"""Thousands separators in the cells of a text table: apostrophes and spaces between groups of three digits.

They are never decimal marks, so that a number with them has one meaning. Points and commas have two, and aren't read so.
Source: SI brochure, 5.4.4 (a thin space between groups); Swiss spreadsheets write an apostrophe.
"""

from __future__ import annotations

import re

from servobench.core.finding import Finding, info

_APOSTROPHES = "'’\x92"  # the last is the second in Windows-1252, where a file is read as Latin-1
_SPACES = "\u00a0\u2009\u202f"  # no-break, thin, and both; a plain blank may separate columns
_MARK = re.compile(f"[{_APOSTROPHES}{_SPACES}]")

GROUPED_DIGITS = rf"[1-9][0-9]{{0,2}}(?P<mark>{_MARK.pattern})[0-9]{{3}}(?:(?P=mark)[0-9]{{3}})*"
"""The pattern of a whole number without its sign whose digits are grouped, such as `4'400`."""


def has_mark(text: str) -> bool:
    """Return whether a text holds a character that may separate thousands."""
    return _MARK.search(text) is not None


def without_marks(number: str) -> str:
    """Return a number without the characters that separate thousands."""
    return _MARK.sub("", number)


def about_thousands(number: str) -> Finding:
    """Return the finding on numbers that are written as this one is, with separators between thousands."""
    is_spaced = any(space in number for space in _SPACES)
    what, shown = ("spaces", "\u00a0") if is_spaced else ("apostrophes", "'")
    sentence = f"The {what} inside numbers separate thousands: {_MARK.sub(shown, number)} is read as {without_marks(number)}."
    return info("thousands-separated", sentence)
