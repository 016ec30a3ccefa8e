"""The blocks of rows in a text table: runs one after the other in one file, with blank lines between them, as gnuplot has them.

A new recording begins where the recognised time goes back after a blank line or repeated names of the columns, and after two
blank lines or more, which separate data sets in gnuplot (`help index`); those must leave at least two rows in every block, or
else they are a way of spacing lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from servobench.core.finding import Finding, info
from servobench.recordings.formats.columns import quote, time_unit
from servobench.recordings.formats.text_table import Table


def blocks(table: Table) -> list[slice]:
    """Return the rows of each block of a table, counted from 0."""
    # Of the rows that are used: how many blank ones stand between each and the one before.
    blank = np.diff(np.searchsorted(table.blank, table.rows))
    begins = set(_usable(np.flatnonzero(blank >= 2) + 1, len(table.rows)))
    times = [k for k, heading in enumerate(table.headings) if time_unit(heading) is not None]
    if len(times) == 1:
        with np.errstate(over="ignore", invalid="ignore"):
            back = np.diff(table.values[:, times[0]]) < 0
        headers = np.diff(np.searchsorted(table.headers, table.rows))
        begins.update((np.flatnonzero((blank + headers >= 1) & back) + 1).tolist())
    edges = [0, *sorted(begins), len(table.rows)]
    return [slice(a, b) for a, b in pairwise(edges)]


def _usable(begins: NDArray[np.int64], rows: int) -> list[int]:
    """The rows that blocks begin in, none where a block would have a single row."""
    edges = np.concatenate(([0], begins, [rows]))
    first_rows: list[int] = begins.tolist() if np.diff(edges).min() >= 2 else []
    return first_rows


def about_blocks(table: Table, rows: Sequence[slice]) -> tuple[Finding, ...]:
    """Return what is to be known of a table that is several recordings."""
    if len(rows) == 1:
        return ()
    begins = quote([str(table.rows[block.start]) for block in rows])
    sentence = f"{_between(table, rows)} separate {len(rows)} blocks of rows, each a recording; they begin in rows {begins}."
    return (info("blocks-apart", sentence),)


def _between(table: Table, rows: Sequence[slice]) -> str:
    """What stands between the blocks."""
    starts = [block.start for block in rows[1:]]
    blank = np.diff(np.searchsorted(table.blank, table.rows))[np.array(starts) - 1]
    return "Blank lines" if blank.all() else "Repeated names of the columns"
