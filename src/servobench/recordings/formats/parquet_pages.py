"""What the pages of a Parquet file say of their own size, read before anything is decompressed.

A page says in its header how many bytes it comes to, and a library makes room for so many; a file of a few bytes can claim
gigabytes, or hold them (a page of zeros). Only metadata are read here, and not through pyarrow: what it says of a column ends the
whole process where a damaged file's statistics don't fit (`RowGroupMetaData.column` lets a C++ exception through).
Source: Apache Parquet, parquet.thrift (FileMetaData, RowGroup, ColumnChunk, ColumnMetaData, PageHeader).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from servobench.recordings.formats import thrift

_LONGEST_FOOTER = 2**24  # bytes
# The numbers of the fields that matter, by struct.
_ROW_GROUPS = 4
_COLUMNS = 1
_META_DATA = 3
_PATH, _TOTAL_COMPRESSED_SIZE, _DATA_PAGE_OFFSET, _DICTIONARY_PAGE_OFFSET = 3, 7, 9, 11
_UNCOMPRESSED_PAGE_SIZE, _COMPRESSED_PAGE_SIZE = 2, 3


def uncompressed_size(data: bytes, wanted: set[str]) -> int:
    """Return the bytes that the pages of the wanted columns (`a.b` for a field of a struct) of a file come to.

    Raises `ValueError` where the file's metadata are damaged.
    """
    size = int.from_bytes(data[-8:-4], "little")
    if not 0 < size <= min(len(data) - 12, _LONGEST_FOOTER):
        raise ValueError(f"its metadata take {size} bytes, in a file of {len(data)}")
    known, _ = thrift.struct(data, len(data) - 8 - size)
    return sum(_size_of_pages(data, start, end) for start, end in _chunks(known, wanted))


def _chunks(known: dict[int, Any], wanted: set[str]) -> Iterator[tuple[int, int]]:
    """Where the wanted columns of each row group begin and end in the file."""
    for group in _structs(known, _ROW_GROUPS):
        for column in _structs(group, _COLUMNS):
            chunk = column.get(_META_DATA)
            if not isinstance(chunk, dict):
                raise ValueError("the metadata of a column are encrypted, or missing")
            path = chunk.get(_PATH)
            names = path if isinstance(path, list) else []
            if (
                b".".join(each for each in names if isinstance(each, bytes)).decode("utf-8", "replace")
                in wanted
            ):
                start = _integer(chunk, _DATA_PAGE_OFFSET)
                if chunk.get(_DICTIONARY_PAGE_OFFSET):
                    # A column of no rows may have a dictionary alone: its data begin nowhere, which is written as 0.
                    dictionary = _integer(chunk, _DICTIONARY_PAGE_OFFSET)
                    start = min(start, dictionary) if start else dictionary
                yield start, start + _integer(chunk, _TOTAL_COMPRESSED_SIZE)


def _structs(fields: dict[int, Any], number: int) -> list[dict[int, Any]]:
    found = fields.get(number, [])
    if not isinstance(found, list) or not all(isinstance(each, dict) for each in found):
        raise ValueError(f"field {number} of its metadata is no list of structs")
    return found


def _integer(fields: dict[int, Any], number: int) -> int:
    found = fields.get(number)
    if not isinstance(found, int) or found < 0:
        raise ValueError(
            f"field {number} of its metadata is {found!r}; expected a size, or a place in the file"
        )
    return found


def _size_of_pages(data: bytes, start: int, end: int) -> int:
    """The bytes that the pages between two places of a file come to."""
    if end > len(data):
        raise ValueError(f"a column ends at byte {end} of a file of {len(data)} bytes")
    total = 0
    at = start
    while at < end:
        header, at = thrift.struct(data, at)
        total += _integer(header, _UNCOMPRESSED_PAGE_SIZE)
        at += _integer(header, _COMPRESSED_PAGE_SIZE)
    return total
