"""Thrift's compact protocol, in which Parquet writes what it knows of itself.

Source: Apache Thrift, "Thrift compact protocol".
"""

from __future__ import annotations

from typing import Any

_TRUE, _FALSE, _BYTE, _INTEGERS, _DOUBLE, _BINARY, _LISTS, _MAP, _STRUCT = (
    1,
    2,
    3,
    (4, 5, 6),
    7,
    8,
    (9, 10),
    11,
    12,
)
_DEEPEST = 32
_LONGEST = 10**6  # elements of a list


def struct(data: bytes, at: int, depth: int = 0) -> tuple[dict[int, Any], int]:
    """Return the fields of the struct at a place by their numbers, and the place behind it.

    Integers are `int`, lists `list`, structs `dict`, texts `bytes`; floats and maps, which nobody here asks for, are None.
    Raises `ValueError` where it is damaged.
    """
    if depth > _DEEPEST:
        raise ValueError("its metadata are nested too deep")
    fields: dict[int, Any] = {}
    number = 0
    while kind := _byte(data, at):
        step, kind = divmod(kind, 16)
        at += 1
        if step:
            number += step
        else:
            number, at = _signed(data, at)
        if kind in {_TRUE, _FALSE}:  # of a field, whose value is its type
            fields[number] = kind == _TRUE
        else:
            fields[number], at = _value(data, at, kind, depth)
    return fields, at + 1


def _value(data: bytes, at: int, kind: int, depth: int) -> tuple[Any, int]:
    """The value of some type at a place, and the place behind it."""
    if kind in {_TRUE, _FALSE, _BYTE}:
        return _byte(data, at), at + 1
    if kind in _INTEGERS:
        return _signed(data, at)
    if kind == _DOUBLE:
        return None, at + 8
    if kind == _BINARY:
        length, at = _varint(data, at)
        if at + length > len(data):
            raise ValueError("a text of its metadata is cut short")
        return data[at : at + length], at + length
    if kind in _LISTS:
        count, inner = divmod(_byte(data, at), 16)
        count, at = _varint(data, at + 1) if count == 15 else (count, at + 1)
        return _elements(data, at, count, (inner,), depth + 1)
    if kind == _MAP:
        count, at = _varint(data, at)
        kinds = divmod(_byte(data, at), 16) if count else ()
        _, at = _elements(data, at + 1 if count else at, count, kinds, depth + 1)
        return None, at
    if kind == _STRUCT:
        return struct(data, at, depth + 1)
    raise ValueError(f"its metadata have a field of the unknown type {kind}")


def _elements(data: bytes, at: int, count: int, kinds: tuple[int, ...], depth: int) -> tuple[list[Any], int]:
    """So many elements of a list, or keys and values of a map one after the other; and the place behind them."""
    if depth > _DEEPEST or count > _LONGEST:
        raise ValueError(f"its metadata have a list of {count} elements, or lists nested too deep")
    values = []
    for _ in range(count):
        for kind in kinds:
            value, at = _value(data, at, kind, depth)
            values.append(value)
    return values, at


def _byte(data: bytes, at: int) -> int:
    if not 0 <= at < len(data):
        raise ValueError("its metadata are cut short")
    return data[at]


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """An unsigned integer, seven bits a byte and the lowest first; and the place behind it."""
    value = shift = 0
    while (byte := _byte(data, at)) & 0x80:
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if shift > 63:
            raise ValueError("its metadata have an integer of more than 64 bits")
    return value | byte << shift, at + 1


def _signed(data: bytes, at: int) -> tuple[int, int]:
    """A signed integer, in zigzag order: 0, -1, 1, -2 and so on; and the place behind it."""
    value, at = _varint(data, at)
    return (value >> 1) ^ -(value & 1), at
