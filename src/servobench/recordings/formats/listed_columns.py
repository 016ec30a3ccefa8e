"""The columns as comments above a table list them, one below the other: a number and a name each, such as `% 2 speed (m/s)`."""

from __future__ import annotations

import re
from collections.abc import Mapping

_ENTRY = re.compile(r"(?:col(?:umn)?\.? ?)?(\d{1,3}) ?[:.)=-]? +(\S.*)", re.IGNORECASE)


def column_names(comments: Mapping[int, str], columns: int) -> dict[int, str]:
    """Return the names of so many columns by the rows of the comments that list them, in order; none where none do.

    The numbers run from 1 to that of the columns, or from 0 to one below. `comments` are the texts by row, without their marks.
    """
    for first in (1, 0):
        names: dict[int, str] = {}
        for row, text in sorted(comments.items()):
            entry = _ENTRY.fullmatch(" ".join(text.split()))
            if entry and int(entry[1]) == first + len(names):
                names[row] = entry[2]
            elif entry:
                names = {row: entry[2]} if int(entry[1]) == first else {}
            if len(names) == columns:
                return names
    return {}
