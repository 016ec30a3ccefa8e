"""Scope data of a block of rows in one compiled pass: blocks are small, and caches are cold when one arrives."""

from __future__ import annotations

import math

from servobench.core.channels import Array
from servobench.core.compiled import compiled
from servobench.recordings.measurement.kernels import slopes, unwrap_block

BEFORE = 4
"""The numbers that are carried from block to block: time [s], counts, wraps, position [rad] of the last row."""


@compiled
def display_block(
    rows: Array, columns: Array, counts: int, modulus: float, radians: float, before: Array, into: Array
) -> None:
    """Fill `into` (C, N), N at least 1: the columns of rows (N, K), and last position [rad], its slope [rad/s], and times dt [s].

    `columns` (2, K) are the columns of `rows` that are as they were, and their rows of `into`; the rest becomes NaN. `counts` is
    the column of rows with the counts, which wrap at `modulus`, 0 for never; `radians` are those of a count, NaN where nobody
    knows. `before` (4,) is what the last call left, all NaN before the first; dt[0] is 0 then, and the slope is NaN. Nothing is
    returned: the way back of an array costs as much as all of this.
    """
    into[:] = math.nan
    for k in range(columns.shape[1]):
        into[columns[1, k]] = rows[:, columns[0, k]]
    position, slope, dt = into[-3], into[-2], into[-1]
    known = 1 if math.isnan(before[0]) else 0
    if known:
        before[0], before[1], before[2] = rows[0, 0], rows[0, counts], 0.0
    for k in range(len(rows)):
        dt[k] = rows[k, 0] - (rows[k - 1, 0] if k else before[0])
    count = rows[:, counts].copy()
    if modulus > 0.0:
        before[2], count = unwrap_block(count, before[1], before[2], modulus)
    position[:] = radians * count
    slope[:] = slopes(position, before[3], dt, known)
    slope[:known] = math.nan
    before[0], before[1], before[3] = rows[-1, 0], rows[-1, counts], position[-1]


@compiled
def count_flags(rows: Array, late: int, saturated: int) -> tuple[int, float]:
    """Return in how many rows (N, C) column `late` is 1, and the time, column 0 [s], of the last with `saturated` 1, or NaN."""
    count, last = 0, math.nan
    for k in range(len(rows)):
        count += rows[k, late] == 1.0
        if rows[k, saturated] == 1.0:
            last = rows[k, 0]
    return count, last
