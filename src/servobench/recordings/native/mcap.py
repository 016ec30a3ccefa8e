"""MCAP, the container of the native file: its records as bytes, and a chunk of equal rows as one NumPy array.

No file is opened here. A record is its opcode (one byte), the length of what follows (eight bytes), and that; numbers are
little-endian; texts (in UTF-8), maps and arrays have their length in bytes before them (four bytes).
Source: the MCAP format specification, version 0.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from typing import Any, TypeAlias

import numpy as np
import zstandard
from numpy.typing import NDArray

from servobench.core.channels import Array

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEAD = 9  # bytes: opcode and length
LARGEST_CHUNK = 16 << 20  # bytes, decompressed; ours have a sixteenth, and none that is larger is read
LARGEST_RECORD = 64 << 20  # bytes; no more is read into memory at once
LATEST = 2**63 - 2**10  # ns; the largest double below 2**63, where other readers keep a signed number
ZSTD_LEVEL = -3
INDEX_ENTRY = 16  # bytes of a message in the index behind its chunk

Messages: TypeAlias = NDArray[np.void]


class Op(IntEnum):
    """The opcodes of the records that occur in our files."""

    HEADER = 0x01
    FOOTER = 0x02
    SCHEMA = 0x03
    CHANNEL = 0x04
    MESSAGE = 0x05
    CHUNK = 0x06
    MESSAGE_INDEX = 0x07
    CHUNK_INDEX = 0x08
    STATISTICS = 0x0B
    METADATA = 0x0C
    METADATA_INDEX = 0x0D
    DATA_END = 0x0F


class Damaged(Exception):
    """Invalid bytes; the reader of the file decides what that means for it."""


def record(op: Op, *parts: bytes) -> bytes:
    """Return a whole record of these parts."""
    return struct.pack("<BQ", op, sum(map(len, parts))) + b"".join(parts)


def prefix_length(content: str | bytes) -> bytes:
    """Return a text, or the bytes of a map or an array, with the length before it."""
    raw = content if isinstance(content, bytes) else content.encode()
    return struct.pack("<I", len(raw)) + raw


def header(library: str) -> bytes:
    """Return the first record; no profile is claimed, as we keep to none."""
    return record(Op.HEADER, prefix_length(""), prefix_length(library))


def schema(number: int, name: str, definition: str) -> bytes:
    """Return the record of a message definition in the language of ROS 2."""
    return record(
        Op.SCHEMA,
        struct.pack("<H", number),
        prefix_length(name),
        prefix_length("ros2msg"),
        prefix_length(definition),
    )


def channel(number: int, schema_number: int, topic: str) -> bytes:
    """Return the record of a channel of CDR messages, without metadata of its own."""
    return record(
        Op.CHANNEL,
        struct.pack("<HH", number, schema_number),
        prefix_length(topic),
        prefix_length("cdr"),
        struct.pack("<I", 0),
    )


def metadata(name: str, entries: Mapping[str, bytes]) -> bytes:
    """Return a metadata record; the values are UTF-8 already."""
    pairs = b"".join(prefix_length(key) + prefix_length(value) for key, value in entries.items())
    return record(Op.METADATA, prefix_length(name), prefix_length(pairs))


def read_metadata(body: bytes) -> tuple[str, dict[str, bytes]]:
    """Return name and entries of a metadata record's body; raises `Damaged`."""
    name, rest = _split(memoryview(body))
    pairs, rest = _split(rest)
    if rest:
        raise Damaged("a metadata record is longer than what it holds")
    entries = {}
    while pairs:
        key, pairs = _split(pairs)
        value, pairs = _split(pairs)
        entries[_decode(key)] = bytes(value)
    return _decode(name), entries


def read_header(body: bytes) -> str:
    """Return the library that the header's body names; raises `Damaged`."""
    _, rest = _split(memoryview(body))
    return _decode(_split(rest)[0])


@cache
def row_type(columns: int) -> np.dtype[np.void]:
    """Return the layout of one message record with that many float64 columns.

    Rows of float64 alone need no padding: CDR aligns by eight bytes, counted from after its own four-byte header.
    """
    fields: list[Any] = [
        ("op", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
        ("cdr", "<u4"),  # 0, 1, 0, 0: plain CDR, little-endian
        ("values", "<f8", (columns,)),
    ]
    return np.dtype(fields)


_CDR_LITTLE_ENDIAN = 0x0100
_CHUNK_HEAD = struct.Struct(
    "<QQQI"
)  # first and last log time, decompressed size, checksum of what is decompressed


def blank_messages(number: int, count: int, columns: int) -> Messages:
    """Return so many message records of channel `number`, with that many columns, that nothing is written in yet."""
    out = np.empty(count, row_type(columns))
    out["op"] = Op.MESSAGE
    out["length"] = out.itemsize - RECORD_HEAD
    out["channel"] = number
    out["cdr"] = _CDR_LITTLE_ENDIAN
    return out


def messages(
    number: int, first: int, log_time: NDArray[np.uint64], rows: Array, blank: Messages | None = None
) -> Messages:
    """Return the message records of channel `number` for rows (N, C), counted on from `first`, at log times (N,) [ns].

    They are written into `blank` ones, if there are any: new memory for each chunk takes as long as filling it.
    """
    out = blank_messages(number, len(rows), rows.shape[1]) if blank is None else blank[: len(rows)]
    out["sequence"] = _sequence(first, len(rows))
    out["log_time"] = out["publish_time"] = log_time
    out["values"] = rows
    return out


def read_messages(data: bytes, number: int, first: int, columns: int) -> Array:
    """Return the rows (N, C) in a chunk's bytes; raises `Damaged` unless they are the messages that have to come next."""
    layout = row_type(columns)
    if not data or len(data) % layout.itemsize:
        raise Damaged("a chunk holds no whole number of samples")
    rows = np.frombuffer(data, layout)
    fixed = {
        "op": Op.MESSAGE,
        "length": layout.itemsize - RECORD_HEAD,
        "channel": number,
        "cdr": _CDR_LITTLE_ENDIAN,
    }
    if any((rows[name] != value).any() for name, value in fixed.items()):
        raise Damaged("a chunk holds something other than samples")
    # Running numbers also bound what a small file may unpack to: they don't compress to less than some bytes a row.
    if (rows["sequence"] != _sequence(first, len(rows))).any():
        raise Damaged("samples are missing before a chunk")
    values: Array = rows["values"]
    return values


def log_time(t: Array, zero: float) -> NDArray[np.uint64]:
    """Return times t (N,) [s] as nanoseconds since `zero` [s], for viewers and for sorting; the exact times are a column.

    What no such number can hold, NaN and times before `zero`, becomes the nearest that can.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # out of range, or a signalling NaN: no matter here
        nanoseconds: Array = np.rint((t - zero) * 1e9)
    if not (nanoseconds.min(initial=0.0) >= 0.0 and nanoseconds.max(initial=0.0) <= LATEST):
        nanoseconds = np.clip(np.nan_to_num(nanoseconds, nan=0.0), 0.0, LATEST)
    return nanoseconds.astype(np.uint64)


@dataclass(frozen=True, kw_only=True)
class Chunk:
    """A chunk of messages of one channel, as its `record` stands in a file, with the `message_index` record behind it.

    `number` is the channel's; `start` and `end` are the first and the last log time [ns], `size` and `compressed_size` the bytes
    of the messages.
    """

    record: bytes
    message_index: bytes
    number: int
    start: int
    end: int
    size: int
    compressed_size: int

    def index(self, offset: int) -> bytes:
        """Return the chunk index record for the summary, for a chunk that begins at that byte of the file."""
        return record(
            Op.CHUNK_INDEX,
            struct.pack("<QQQQ", self.start, self.end, offset, len(self.record)),
            prefix_length(
                struct.pack("<HQ", self.number, offset + len(self.record))
            ),  # where the message index is
            struct.pack("<Q", len(self.message_index)),
            prefix_length("zstd"),
            struct.pack("<QQ", self.compressed_size, self.size),
        )


def compressor() -> zstandard.ZstdCompressor:
    """Return what compresses one chunk after the other."""
    return zstandard.ZstdCompressor(level=ZSTD_LEVEL)


def chunk(rows: Messages, compressor: zstandard.ZstdCompressor) -> Chunk:
    """Return message records, at least one and all of one channel, as a compressed chunk."""
    raw = rows.view(np.uint8).data
    packed = compressor.compress(raw)
    times, number = np.ascontiguousarray(rows["log_time"]), int(rows["channel"][0])
    entries = np.empty(len(rows), [("log_time", "<u8"), ("offset", "<u8")])
    entries["log_time"] = times
    entries["offset"] = np.arange(0, len(raw), rows.itemsize)
    if np.any(times[1:] < times[:-1]):
        entries.sort(order="log_time", kind="stable")
    start, end = int(entries["log_time"][0]), int(entries["log_time"][-1])
    body = record(
        Op.CHUNK,
        _CHUNK_HEAD.pack(start, end, len(raw), zlib.crc32(raw)),
        prefix_length("zstd"),
        struct.pack("<Q", len(packed)),
        packed,
    )
    index = record(Op.MESSAGE_INDEX, struct.pack("<H", number), prefix_length(entries.tobytes()))
    return Chunk(
        record=body,
        message_index=index,
        number=number,
        start=start,
        end=end,
        size=len(raw),
        compressed_size=len(packed),
    )


def decompressor() -> zstandard.ZstdDecompressor:
    """Return what decompresses one chunk after the other."""
    return zstandard.ZstdDecompressor()


def read_chunk(body: bytes, decompressor: zstandard.ZstdDecompressor) -> bytes:
    """Return the decompressed messages of a chunk record's body; raises `Damaged`, also where they would be too many.

    Neither the length that the record claims nor the one that the compressed frame claims is trusted with memory.
    """
    if len(body) < _CHUNK_HEAD.size:
        raise Damaged("a chunk is shorter than its own head")
    _, _, size, crc = _CHUNK_HEAD.unpack_from(body)
    compression, rest = _split(memoryview(body)[_CHUNK_HEAD.size :])
    if bytes(compression) != b"zstd" or len(rest) < 8 or struct.unpack_from("<Q", rest)[0] != len(rest) - 8:
        raise Damaged("the head of a chunk doesn't fit it")
    packed = rest[8:]
    try:
        claimed = zstandard.get_frame_parameters(packed).content_size
        if claimed != size or size > LARGEST_CHUNK:
            raise Damaged("a chunk is larger than any that servobench writes")
        data = decompressor.decompress(packed, max_output_size=size, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise Damaged("a chunk can't be decompressed") from error
    if len(data) != size or zlib.crc32(data) != crc:
        raise Damaged("the checksum of a chunk is wrong")
    return data


def channel_of(data: bytes) -> int:
    """Return the channel of the first message in a chunk's bytes; raises `Damaged`."""
    if len(data) < RECORD_HEAD + 2:
        raise Damaged("a chunk holds no message")
    return int(struct.unpack_from("<H", data, RECORD_HEAD)[0])


def statistics(
    *, counts: Mapping[int, int], schemas: int, metadata: int, chunks: int, start: int, end: int
) -> bytes:
    """Return the statistics record: messages of each channel, numbers of other records, first and last log time [ns]."""
    return record(
        Op.STATISTICS,
        struct.pack("<QHIIII", sum(counts.values()), schemas, len(counts), 0, metadata, chunks),
        struct.pack("<QQ", start, end),
        prefix_length(b"".join(struct.pack("<HQ", number, count) for number, count in counts.items())),
    )


def metadata_index(offset: int, length: int, name: str) -> bytes:
    """Return the summary's pointer to a metadata record."""
    return record(Op.METADATA_INDEX, struct.pack("<QQ", offset, length), prefix_length(name))


def data_end(crc: int) -> bytes:
    """Return the record that ends the data, with the CRC-32 of all bytes before it."""
    return record(Op.DATA_END, struct.pack("<I", crc))


def summary(start: int, records: Iterable[bytes]) -> bytes:
    """Return the summary that begins at byte `start`, with the footer and the magic bytes that end a file."""
    content = b"".join(records)
    head = struct.pack("<BQQQ", Op.FOOTER, 20, start, 0)
    return content + head + struct.pack("<I", zlib.crc32(content + head)) + MAGIC


def _sequence(first: int, count: int) -> NDArray[np.uint32]:
    """Running numbers as MCAP keeps them: four bytes, which wrap."""
    return (first + np.arange(count, dtype=np.uint64)).astype(np.uint32)


def _split(data: memoryview) -> tuple[memoryview, memoryview]:
    """The prefixed bytes at the start of some bytes, and what follows them; views, as copies would cost length squared."""
    if len(data) < 4:
        raise Damaged("a text has no length")
    length = 4 + int(struct.unpack_from("<I", data)[0])
    if len(data) < length:
        raise Damaged("a text is longer than the record that it is in")
    return data[4:length], data[length:]


def _decode(raw: memoryview) -> str:
    try:
        return str(raw, "utf-8")
    except UnicodeDecodeError as error:
        raise Damaged("a text is no UTF-8") from error
