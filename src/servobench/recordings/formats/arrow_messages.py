"""The messages of an Arrow stream: where each ends, and how many bytes its compressed buffers say that they come to.

A library makes room for what a buffer says of itself before it decompresses it; a file of a few bytes can claim gigabytes, or
hold them. Only the lengths are read here.
Source: Apache Arrow, format/Message.fbs and "Encapsulated message format"; FlatBuffers, "Internals".
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

_CONTINUATION = 0xFFFFFFFF
_DICTIONARY, _RECORDS = 2, 3  # kinds of header
_KEPT = -1  # the length that says that a buffer isn't compressed after all


@dataclass(frozen=True, kw_only=True)
class Message:
    """A message of a stream: its metadata (a FlatBuffer), where its body begins, and where it ends."""

    metadata: bytes
    body: int
    end: int


def next_message(stream: bytes, at: int) -> Message | None:
    """Return the message at a place; one without metadata is the end of the stream, None a message that isn't whole.

    Raises `ValueError` where it is damaged.
    """
    start = at + 4
    if len(stream) < start:
        return None
    (size,) = struct.unpack_from("<I", stream, at)
    if size == _CONTINUATION:  # which streams before Arrow 0.15 don't have
        start = at + 8
        if len(stream) < start:
            return None
        (size,) = struct.unpack_from("<I", stream, at + 4)
    if size == 0:
        return Message(metadata=b"", body=start, end=start)
    if len(stream) < start + size:
        return None
    metadata = stream[start : start + size]
    body = _integer(metadata, "q", _field(metadata, _root(metadata), 3))
    if body < 0:
        raise ValueError(f"a message has a body of {body} bytes")
    end = start + size + body
    return Message(metadata=metadata, body=start + size, end=end) if end <= len(stream) else None


def uncompressed_size(message: Message, stream: bytes) -> int:
    """Return the bytes that a message's buffers come to; raises `ValueError` where its metadata is damaged."""
    metadata, root = message.metadata, _root(message.metadata)
    kind = _integer(metadata, "B", _field(metadata, root, 1))
    header = _table(metadata, _field(metadata, root, 2))
    if kind == _DICTIONARY:
        header = _table(metadata, _field(metadata, header, 1))
    elif kind != _RECORDS:
        return 0
    total = message.end - message.body
    if not _field(metadata, header, 3):  # no compression
        return total
    place = _field(metadata, header, 2)
    buffers = _table(metadata, place)
    for k in range(_integer(metadata, "I", buffers)):
        offset, length = (
            _integer(metadata, "q", buffers + 4 + 16 * k),
            _integer(metadata, "q", buffers + 12 + 16 * k),
        )
        if length < 8:
            continue
        if not 0 <= offset <= offset + length <= message.end - message.body:
            raise ValueError(f"a buffer of {length} bytes at byte {offset} of a shorter body")
        said = _integer(stream, "q", message.body + offset)
        if said < _KEPT:
            raise ValueError(f"a compressed buffer says that it comes to {said} bytes")
        total += max(said, 0)
    return total


def _integer(data: bytes, kind: str, at: int) -> int:
    """An integer of a kind of `struct` at a place; 0 at place 0, where a field that isn't there has its default."""
    if at == 0:
        return 0
    if not 0 < at <= len(data) - struct.calcsize(kind):
        raise ValueError("the metadata of a message lead out of it")
    value: int = struct.unpack_from(f"<{kind}", data, at)[0]
    return value


def _root(metadata: bytes) -> int:
    """The place of the table at the root."""
    if len(metadata) < 8:
        raise ValueError("the metadata of a message are cut short")
    return int(struct.unpack_from("<I", metadata)[0])


def _table(metadata: bytes, at: int) -> int:
    """The place of the table, or vector, that a field at a place leads to."""
    if at == 0:
        raise ValueError("the metadata of a message lack a part")
    return at + _integer(metadata, "I", at)


def _field(metadata: bytes, table: int, number: int) -> int:
    """The place of a table's field, 0 where the table doesn't have it."""
    layout = table - _integer(metadata, "i", table)
    if 4 + 2 * number >= _integer(metadata, "H", layout):
        return 0
    offset = _integer(metadata, "H", layout + 4 + 2 * number)
    return table + offset if offset else 0
