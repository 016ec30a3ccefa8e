"""What the pages of a Parquet file say of their own size, read before anything is decompressed.

A page says in its header how many bytes it comes to, and a library makes room for so many; a file of a few bytes can claim
gigabytes, or hold them (a page of zeros). Only the headers are read here.
Source: Apache Parquet, parquet.thrift (PageHeader), and Apache Thrift, "Thrift compact protocol".
"""

from __future__ import annotations

_BOOLEANS, _BYTE, _INTEGERS, _DOUBLE, _BINARY, _LISTS, _MAP, _STRUCT = (
    (1, 2),
    3,
    (4, 5, 6),
    7,
    8,
    (9, 10),
    11,
    12,
)
_DEEPEST = 16
_UNCOMPRESSED, _COMPRESSED = 2, 3  # fields of a page's header


def uncompressed_size(data: bytes, start: int, end: int) -> int:
    """Return the bytes that the pages between two places of a file come to; raises `ValueError` where they are damaged."""
    if not 0 <= start <= end <= len(data):
        raise ValueError(f"a column from byte {start} to {end}, in a file of {len(data)} bytes")
    total = 0
    at = start
    while at < end:
        sizes: dict[int, int] = {}
        try:
            at = _struct(data, at, sizes, 0)
        except IndexError:
            raise ValueError("the header of a page is cut short") from None
        if _UNCOMPRESSED not in sizes or sizes.get(_COMPRESSED, -1) < 0 or sizes[_UNCOMPRESSED] < 0:
            raise ValueError("the header of a page doesn't say its size")
        total += sizes[_UNCOMPRESSED]
        at += sizes[_COMPRESSED]
    return total


def _struct(data: bytes, at: int, integers: dict[int, int], depth: int) -> int:
    """The place behind a struct; its own fields that are integers are put into `integers` by their numbers."""
    if depth > _DEEPEST:
        raise ValueError("the header of a page is nested too deep")
    number = 0
    while data[at]:
        step, kind = divmod(data[at], 16)
        at += 1
        if step:
            number += step
        else:
            number, at = _signed(data, at)
        if kind in _INTEGERS:
            integers[number], at = _signed(data, at)
        elif kind not in _BOOLEANS:  # whose value stands in the type
            at = _skipped(data, at, kind, depth)
    return at + 1


def _skipped(data: bytes, at: int, kind: int, depth: int) -> int:
    """The place behind a value of some type."""
    if kind == _BYTE or kind in _BOOLEANS:
        return at + 1
    if kind in _INTEGERS:
        return _varint(data, at)[1]
    if kind == _DOUBLE:
        return at + 8
    if kind == _BINARY:
        length, at = _varint(data, at)
        return at + length
    if kind == _STRUCT:
        return _struct(data, at, {}, depth + 1)
    if kind in _LISTS:
        count, inner = divmod(data[at], 16)
        at += 1
        if count == 15:
            count, at = _varint(data, at)
        return _elements(data, at, count, (inner,), depth)
    if kind == _MAP:
        count, at = _varint(data, at)
        if not count:
            return at
        return _elements(data, at + 1, count, divmod(data[at], 16), depth)
    raise ValueError(f"the header of a page has a field of the unknown type {kind}")


def _elements(data: bytes, at: int, count: int, kinds: tuple[int, ...], depth: int) -> int:
    """The place behind so many elements; each takes at least a byte, so that the end of the file ends a lie about them."""
    if depth > _DEEPEST:
        raise ValueError("the header of a page is nested too deep")
    for _ in range(count):
        for kind in kinds:
            if at >= len(data):
                raise IndexError
            at = _skipped(data, at, kind, depth + 1)
    return at


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """An unsigned integer, seven bits a byte and the lowest first; and the place behind it."""
    value = shift = 0
    while data[at] & 0x80:
        value |= (data[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if shift > 63:
            raise ValueError("the header of a page has an integer of more than 64 bits")
    return value | data[at] << shift, at + 1


def _signed(data: bytes, at: int) -> tuple[int, int]:
    """A signed integer, in zigzag order: 0, -1, 1, -2 and so on."""
    value, at = _varint(data, at)
    return (value >> 1) ^ -(value & 1), at
