"""Numbers from an array or a column in memory, of any type with numbers or times; missing values become NaN."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError

Cells: TypeAlias = np.ndarray[Any, np.dtype[Any]]


def to_numbers(name: str, given: Any) -> tuple[Array | None, bool]:
    """Return the values as numbers, of the same shape, and whether they are times by their type; None where they are none.

    Dates become seconds since the first one, durations seconds. What a mask hides, None and not-a-time are NaN.
    Raises `UsageError` for complex numbers, of which a part would be lost; `name` is what the message calls them.
    """
    if np.ma.isMaskedArray(given):
        given = np.ma.filled(given.astype(np.float64), np.nan)
    try:
        cells = np.asarray(given)
    except ValueError:  # rows of several lengths
        return None, False
    if cells.dtype.kind == "c":
        raise UsageError(f"{name} holds complex numbers; expected real ones, such as {name}.real")
    if cells.dtype.kind in "mM":
        return _seconds(cells), True
    if cells.dtype.kind in "biuf":
        return cells.astype(np.float64), False
    if cells.dtype.kind != "O":  # texts
        return None, False
    try:
        return np.array(
            [np.nan if cell is None else cell for cell in cells.ravel()], dtype=np.float64
        ).reshape(cells.shape), False
    except (TypeError, ValueError):  # texts, lists, objects
        return None, False


def _seconds(cells: Cells) -> Array:
    """Dates as seconds since the first of them, durations as seconds; NaN for not-a-time."""
    known = ~np.isnat(cells)
    if cells.dtype.kind == "M" and known.any():
        cells = cells - cells[known][0]
    return np.where(known, cells.astype("timedelta64[ns]").astype(np.int64) * 1e-9, np.nan)
