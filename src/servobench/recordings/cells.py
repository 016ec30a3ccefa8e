"""Numbers from an array or a column in memory, of any type with numbers or times; missing values become NaN."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any, TypeAlias

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError

Cells: TypeAlias = np.ndarray[Any, np.dtype[Any]]


def to_numbers(name: str, values: Any) -> tuple[Array | None, bool]:
    """Return the values as numbers, of the same shape, and whether they are times by their type; None where they are none.

    Dates become seconds since the first one, durations seconds. What a mask hides, None and not-a-time are NaN.
    Raises `UsageError` for complex numbers, of which a part would be lost; `name` is what the message calls them.
    """
    if np.ma.isMaskedArray(values):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    try:
        cells = np.asarray(values)
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
    moments = _moments(cells)
    if moments is not None:
        return moments, True
    try:
        return np.array(
            [np.nan if cell is None else cell for cell in cells.ravel()], dtype=np.float64
        ).reshape(cells.shape), False
    except (TypeError, ValueError, OverflowError):  # texts, lists, objects; whole numbers without end
        return None, False


def mostly_numbers(column: Any) -> tuple[Array | None, dict[int, str]]:
    """Return a column (N,) of which at least half are numbers, NaN where one is a text, and those texts by row.

    None and no texts for any other column.
    """
    cells = np.asarray(column)
    if cells.dtype.kind != "O" or cells.ndim != 1:
        return None, {}
    values, texts = np.full(len(cells), np.nan), {}
    for row, cell in enumerate(cells):
        try:
            values[row] = np.nan if cell is None else float(cell)
        except (TypeError, ValueError):
            texts[row] = str(cell)
        except OverflowError:  # its digits may be too many even for a text
            texts[row] = "a number beyond all floats"
    return (values, texts) if 2 * len(texts) <= len(cells) else (None, {})


def _moments(cells: Cells) -> Array | None:
    """Seconds since the first of Python's own moments, of one time zone, several or none; None for any other objects."""
    flat = cells.ravel()
    if not len(flat) or not all(isinstance(cell, datetime) for cell in flat):
        return None
    # Moments of one zone are subtracted by the clock on the wall, which is set back once a year.
    moments = [cell.astimezone(UTC) if cell.tzinfo is not None else cell for cell in flat]
    first = next((cell for cell in moments if cell == cell), moments[0])  # not-a-time equals nothing
    try:
        return np.array([(cell - first).total_seconds() for cell in moments], dtype=np.float64).reshape(
            cells.shape
        )
    except TypeError:  # some have a time zone and some haven't
        return None


def _seconds(cells: Cells) -> Array:
    """Dates as seconds since the first of them, durations as seconds; NaN for not-a-time."""
    known = ~np.isnat(cells)
    if cells.dtype.kind == "M" and known.any():
        cells = cells - cells[known][0]
    return np.where(known, cells.astype("timedelta64[ns]").astype(np.int64) * 1e-9, np.nan)
