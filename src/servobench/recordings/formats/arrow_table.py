"""Tables of Apache Arrow, which Parquet and Arrow files hold: the recording that one is, and the one that a recording becomes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import FormatError, UsageError
from servobench.core.finding import Finding, info
from servobench.recordings.formats import metadata
from servobench.recordings.formats.columns import (
    LARGEST_TABLE,
    LARGEST_WHOLE,
    Column,
    distinct,
    heading,
    quote,
    recording_of,
    with_unit,
)
from servobench.recordings.formats.extras import format_errors, library
from servobench.recordings.formats.times import in_words
from servobench.recordings.formats.unpacking import MOST_BYTES
from servobench.recordings.recording import Recording, Source

_OURS = b"servobench"  # the entry of the schema's metadata with all that a recording knows beside its samples
_DEEPEST = 16  # structs inside structs
_NANOSECONDS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


def pyarrow(module: str, name: str) -> Any:
    """Return a module of pyarrow for the file `name`; raises `UsageError` where it isn't installed."""
    return library(module, "pyarrow", "parquet", name)


def check_size(rows: int, columns: int) -> None:
    """Raise `ValueError` where a table of so many rows and columns of numbers is more than is read."""
    if columns > LARGEST_TABLE:
        raise ValueError(f"it has {columns} columns; expected at most {LARGEST_TABLE} channels")
    if rows < 0 or 8 * rows * max(columns, 1) > MOST_BYTES:
        raise ValueError(
            f"it says that it has {rows} rows of {columns} columns; more than {MOST_BYTES // 8} numbers aren't read"
        )


@dataclass(frozen=True, kw_only=True)
class Leaf:
    """A column of a table, or a field of a struct in one (`a.b`): the path of names to it, and what it holds.

    `skipped` says what it is where a recording has no place for it.
    """

    path: tuple[str, ...]
    field: Any
    skipped: str = ""

    @property
    def name(self) -> str:
        """The name with dots between."""
        return ".".join(self.path)


def leaves(schema: Any, name: str) -> tuple[Leaf, ...]:
    """Return the columns of a schema, those of structs included, in their order; `name` is the file's."""
    types = pyarrow("pyarrow.types", name)
    return tuple(leaf for field in schema for leaf in _leaves(field, (), types))


def _leaves(field: Any, above: tuple[str, ...], types: Any) -> Iterator[Leaf]:
    path = (*above, field.name)
    if types.is_struct(field.type) and field.type.num_fields and len(path) < _DEEPEST:
        for inner in field.type:
            yield from _leaves(inner, path, types)
        return
    kind = field.type.value_type if types.is_dictionary(field.type) else field.type
    numeric = (
        types.is_boolean, types.is_integer, types.is_floating, types.is_decimal,
        types.is_timestamp, types.is_duration, types.is_time,
    )  # fmt: skip
    if any(test(kind) for test in numeric):
        yield Leaf(path=path, field=field)
    else:
        yield Leaf(path=path, field=field, skipped=_in_words(kind, types))


def _in_words(kind: Any, types: Any) -> str:
    if types.is_string(kind) or types.is_large_string(kind):
        return "text"
    return "empty" if types.is_null(kind) else str(kind)[:60]


def recording_in(batches: Sequence[Any], schema: Any, path: Path, format: str) -> Recording:
    """Return the recording in the record batches of a file; raises `FormatError` where it has no columns of numbers.

    `schema` is the file's; the batches may lack columns of it that a recording has no place for.
    """
    pa = pyarrow("pyarrow", path.name)
    with format_errors(path.name, format):
        for batch in batches:
            batch.validate(
                full=True
            )  # offsets and indices into other buffers can be anything in a damaged file
        check_size(sum(batch.num_rows for batch in batches), 1)
        table = pa.Table.from_batches(batches) if batches else schema.empty_table()
    ours = (schema.metadata or {}).get(_OURS)
    if ours is not None and metadata.SCHEMA.encode() in ours:
        return _own(ours.decode("utf-8", "replace"), table, path.name)
    return _foreign(table, schema, path, format)


def _foreign(table: Any, schema: Any, path: Path, format: str) -> Recording:
    with format_errors(path.name, format):
        all_leaves = leaves(schema, path.name)
    wanted = [leaf for leaf in all_leaves if not leaf.skipped]
    skipped = [f"{leaf.name} ({leaf.skipped})" for leaf in all_leaves if leaf.skipped]
    if not wanted:
        raise FormatError(f"{path.name} has no columns of numbers; it has {quote(skipped) or 'none'}")
    if not table.num_rows:
        raise FormatError(f"{path.name} has no rows, only the columns {quote(leaf.name for leaf in wanted)}")
    with format_errors(path.name, format):
        check_size(table.num_rows, len(wanted))
        arrays = [_array(table, leaf) for leaf in wanted]
        zero = _zero(arrays)
    columns: list[Column] = []
    findings: list[Finding] = []
    units = _units(schema)
    for leaf, array in zip(wanted, arrays, strict=True):
        with format_errors(path.name, format):
            values, is_time = _numbers(array, zero)
        head = heading(leaf.name)
        if is_time:
            head = replace(head, unit="s", from_name=False)
        else:
            head, unit_findings = with_unit(head, _unit(leaf.field) or units.get(leaf.name, ""))
            findings.extend(unit_findings)
        columns.append(Column(heading=head, values=values, is_time=is_time))
        findings.extend(_about_values(head.name, array, values))
    if skipped:
        findings.append(info("column-skipped", f"Columns that aren't numbers aren't read: {quote(skipped)}."))
    if zero is not None:
        began = f", {np.datetime64(zero, 'ns')}" if abs(zero) < 2**63 else ""  # or else beyond the calendar
        findings.append(info("time-stamps", f"Time stamps count from the first one{began}, in s."))
    source = Source(name=path.name, format=format)
    return recording_of(columns, name=path.stem, source=source, findings=findings)


def _array(table: Any, leaf: Leaf) -> Any:
    """The values of a leaf as one array, without dictionary and extension; null wherever a struct around it is null."""
    import pyarrow as pa
    import pyarrow.compute as pc

    top = table.schema.get_all_field_indices(leaf.path[0])
    array = table.column(top[0] if len(top) == 1 else _which(table, leaf))
    if len(leaf.path) > 1:
        array = pc.struct_field(array, list(leaf.path[1:]))
    array = array.combine_chunks() if isinstance(array, pa.ChunkedArray) else array
    if pa.types.is_dictionary(array.type):
        array = array.dictionary_decode()
    return array


def _which(table: Any, leaf: Leaf) -> int:
    """The place of the column with this very field where several have its name."""
    return next(k for k, field in enumerate(table.schema) if field is leaf.field or field.equals(leaf.field))


def _zero(arrays: Sequence[Any]) -> int | None:
    """The earliest first time stamp of all columns, in ns since 1970; None where there is none."""
    import pyarrow as pa

    firsts = []
    for array in arrays:
        if pa.types.is_timestamp(array.type):
            valid = array.drop_null()
            if len(valid):
                firsts.append(valid[0].value * _NANOSECONDS[array.type.unit])
    return min(firsts, default=None)


def _numbers(array: Any, zero: int | None) -> tuple[Array, bool]:
    """The values as floats, NaN where there is none, and whether they are times by their type, which are then in s."""
    import pyarrow as pa

    kind = array.type
    is_time = pa.types.is_timestamp(kind) or pa.types.is_duration(kind) or pa.types.is_time(kind)
    if is_time:
        return _seconds(array, zero if pa.types.is_timestamp(kind) else 0), True
    if pa.types.is_boolean(kind):
        array = array.cast(pa.uint8())
    values = array.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
    return np.array(values, dtype=np.float64), False


def _seconds(array: Any, zero: int | None) -> Array:
    """Times of whole units in s since `zero` [ns]; taken away as integers, so that no digit is lost to the years since 1970."""
    import pyarrow as pa

    step = _NANOSECONDS[array.type.unit]
    whole, part = divmod(zero or 0, step)
    integers = array.cast(pa.int32() if pa.types.is_time32(array.type) else pa.int64())
    missing = array.is_null().to_numpy(zero_copy_only=False)
    counted = integers.fill_null(0).to_numpy(zero_copy_only=False).astype(np.int64) - np.int64(whole)
    seconds: Array = counted / (10**9 // step) - part / 1e9
    seconds[missing] = np.nan
    return seconds


def _unit(field: Any) -> str:
    """The unit in a field's own metadata."""
    known = field.metadata or {}
    symbol = known.get(b"unit", known.get(b"units", b""))
    return str(symbol.decode("utf-8", "replace"))


def _units(schema: Any) -> dict[str, str]:
    """The units in the schema's metadata, where they are a JSON object of them by column."""
    known = schema.metadata or {}
    text = known.get(b"units", known.get(b"unit", b""))
    try:
        units = json.loads(text)
    except (ValueError, RecursionError):
        return {}  # a text for people, or for another program: no statement about columns that could be read
    if not isinstance(units, dict):
        return {}
    return {name: unit for name, unit in units.items() if isinstance(unit, str)}


def _about_values(name: str, array: Any, values: Array) -> list[Finding]:
    findings = []
    if array.null_count:
        rows = np.flatnonzero(array.is_null().to_numpy(zero_copy_only=False)) + 1
        sentence = f"Empty cells, read as NaN: {in_words(rows)}, in `{name}`."
        findings.append(info("cell-empty", sentence, rows=(int(rows[0]), int(rows[-1]))))
    if array.type.bit_width == 64 and str(array.type) in {"int64", "uint64"}:
        large = np.abs(values) >= LARGEST_WHOLE
        if large.any():
            sentence = f"`{name}` has whole numbers too large to be kept to the last digit."
            findings.append(info("integer-rounded", sentence))
    return findings


def table_of(recordings: Sequence[Recording], name: str) -> Any:
    """Return the table of one recording: a column for each channel and one for each of their times, filled up with nulls.

    Raises `UsageError` for more than one, whose columns would stand side by side with nothing to tell them apart.
    """
    pa = pyarrow("pyarrow", name)
    if len(recordings) != 1:
        raise UsageError(
            f"{name}: such a table holds one recording and there are {len(recordings)}; "
            "write each to a file of its own, or all of them to an .mcap file"
        )
    (recording,) = recordings
    table = metadata.table_of(recording, _names)
    rows = max(map(len, table.columns.values()), default=0)
    fields = [
        pa.field(name, pa.float64(), metadata=None if unit is None else {"unit": metadata.as_utf_8(unit)})
        for name, unit in table.units.items()
    ]
    text = metadata.as_text({"schema": metadata.SCHEMA, **table.description})
    schema = pa.schema(fields, metadata={_OURS: text.encode("ascii")})
    arrays = [_fill_up(pa, values, rows) for values in table.columns.values()]
    return pa.Table.from_arrays(arrays, schema=schema)


def _fill_up(pa: Any, values: Array, rows: int) -> Any:
    # `pa.array` keeps a NaN that was measured and a cell that isn't there apart.
    array = pa.array(values, type=pa.float64(), from_pandas=False)
    missing = rows - len(values)
    return pa.concat_arrays([array, pa.nulls(missing, pa.float64())]) if missing else array


def _names(names: Sequence[str]) -> tuple[str, ...]:
    plain, _ = distinct([metadata.as_utf_8(name) for name in names])
    return plain


def _own(text: str, table: Any, name: str) -> Recording:
    """The recording in a table of ours; raises `FormatError` where it isn't the one that its schema describes."""

    def column(label: str) -> Array:
        values = table.column(label).combine_chunks().drop_null()
        if str(values.type) != "double":
            raise ValueError(f"column {label!r} isn't floats")
        return np.array(values.to_numpy(zero_copy_only=False), dtype=np.float64)

    return metadata.recording_of_table(metadata.from_text(text, name), column, name)
