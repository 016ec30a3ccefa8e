"""Tables in memory: a DataFrame of pandas or polars, an Arrow table, an xarray Dataset, a dict of arrays, a structured array."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar, final

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.finding import Finding, info
from servobench.recordings.adapters.base import ADAPTERS
from servobench.recordings.cells import mostly_numbers, to_numbers
from servobench.recordings.formats.columns import Column, heading, quote, recording_of
from servobench.recordings.formats.times import in_words
from servobench.recordings.recording import Recording, Source


@final
@ADAPTERS.member("tables")
class Tables:
    """A table: each column of numbers is a channel, whose unit may stand in the column's name. A named index is a column, too.

    Dates and durations become seconds since the first one. What isn't a number in a row is NaN.
    """

    accepted: ClassVar[str] = "a DataFrame (pandas, polars, Arrow, xarray), a dict of arrays"

    def accepts(self, data: object) -> bool:
        """Return whether it is a table of any of these kinds."""
        return (
            isinstance(data, Mapping)
            or (isinstance(data, np.ndarray) and data.dtype.names is not None)
            or _is_xarray(data)
            or _is_frame(data)
        )

    def recordings(self, data: Any) -> tuple[Recording, ...]:
        """Return the table as a recording; raises `UsageError` where it has no column of numbers."""
        columns, left_out, findings = [], [], []
        for name, cells in _columns(data):
            values, is_time = _numbers(name, cells)
            if values is None:
                values, texts = mostly_numbers(cells)
                findings += [_about_texts(name, texts)] if texts else []
            if values is None:
                left_out.append(name)
            else:
                column_heading = replace(heading(name), unit="s") if is_time else heading(name)
                columns.append(Column(heading=column_heading, values=values, is_time=is_time))
        kind = type(data).__name__
        if not columns:
            named = f": it has {quote(left_out)}" if left_out else ""
            raise UsageError(
                f"the {kind} has no column of numbers{named}; expected the times, the input and the output"
            )
        lengths = sorted({len(column.values) for column in columns})
        if len(lengths) > 1:
            raise UsageError(
                f"the columns of the {kind} have {lengths[0]} to {lengths[-1]} rows; expected the same number in each"
            )
        if left_out:
            findings.append(
                info("columns-not-numbers", f"Columns without numbers are left out: {quote(left_out)}.")
            )
        return (
            recording_of(columns, name=kind, source=Source(name=kind, format="memory"), findings=findings),
        )


def _is_xarray(data: object) -> bool:
    """Whether it is a Dataset or a DataArray of xarray, without importing that."""
    xarray = sys.modules.get("xarray")
    return xarray is not None and isinstance(data, xarray.Dataset | xarray.DataArray)


def _is_frame(data: object) -> bool:
    from narwhals import DataFrame, from_native
    from narwhals.exceptions import NarwhalsError

    try:
        return isinstance(from_native(data, eager_only=True, pass_through=True), DataFrame)
    except NarwhalsError as error:
        raise UsageError(f"the {type(data).__name__} can't be read as a table: {error}") from None


def _columns(data: Any) -> Iterator[tuple[str, Any]]:
    """The columns by name; raises `UsageError` for more dimensions than the one along which the samples lie."""
    if _is_xarray(data):
        if len(data.dims) != 1:
            raise UsageError(
                f"the {type(data).__name__} has the dimensions {', '.join(map(str, data.dims)) or 'none'}; expected only "
                "that of the samples: select a value of each of the others first"
            )
        held = data if hasattr(data, "data_vars") else data.to_dataset(name=data.name or "value")
        yield from ((str(name), each.values) for name, each in held.variables.items())
        return
    if isinstance(data, Mapping):
        if data and all(isinstance(cells, Mapping) or _is_frame(cells) for cells in data.values()):
            name, table = next(iter(data.items()))
            raise UsageError(
                f"{name!r} is a {type(table).__name__}, but a dict holds the columns of one recording; give several recordings "
                "as a list: list(data.values())"
            )
        yield from ((str(name), cells) for name, cells in data.items())
        return
    if isinstance(data, np.ndarray):
        yield from ((name, data[name]) for name in data.dtype.names or ())
        return
    yield from _frame_columns(data)


def _frame_columns(data: Any) -> Iterator[tuple[str, Any]]:
    """The columns of a frame, the index before them where it has a name or holds times."""
    from narwhals import from_native, maybe_get_index

    frame = from_native(data, eager_only=True)
    index = maybe_get_index(frame)
    if index is not None:
        cells = (
            index.to_numpy("datetime64[ns]") if getattr(index, "tz", None) is not None else np.asarray(index)
        )
        if index.name is not None or cells.dtype.kind in "mM":
            yield str(index.name if index.name is not None else "index"), cells
    for column in frame.iter_columns():
        yield str(column.name), column.to_numpy()


def _numbers(name: str, cells: Any) -> tuple[Array | None, bool]:
    """The values (N,) as numbers, None where they are none, and whether they are times by their type."""
    values, is_time = to_numbers(f"the column {name!r}", cells)
    if values is not None and values.ndim != 1:
        raise UsageError(
            f"the column {name!r} has shape {values.shape}; expected one value in each row, (N,)"
        )
    return values, is_time


def _about_texts(name: str, texts: Mapping[int, str]) -> Finding:
    first = next(iter(texts.values()))
    rows = in_words(np.array(list(texts), dtype=np.int64) + 1)
    sentence = f"Text where a number should be, such as {first[:40]!r}, read as NaN: {rows}, in `{name}`."
    return info("cell-not-a-number", sentence)
