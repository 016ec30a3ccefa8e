"""The messages in an MCAP file of anybody's, with what a small file may unpack to bounded, and a decoder for each topic.

The records are parsed by `mcap`, CDR messages of ROS 2 decoded by `mcap-ros2-support` (the extra `ros2`).
Source: the MCAP format specification, version 0.
"""

from __future__ import annotations

import io
import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

from servobench.core.errors import FormatError
from servobench.recordings.native.mcap import MAGIC, RECORD_HEAD, Op

LARGEST_CHUNK = 256 << 20  # bytes, decompressed
MOST_BYTES = 1 << 30
"""The most bytes of messages that are read from one file, decompressed."""

Decoder: TypeAlias = Callable[[bytes], Any]


@dataclass(frozen=True, kw_only=True)
class Topic:
    """What messages of a channel are: their topic's `name`, that of their `schema`, their decoder, or `why_not`."""

    name: str
    schema: str
    decoder: Decoder | None
    why_not: str = ""


@dataclass(frozen=True, kw_only=True)
class Message:
    """A message of a topic: its `data` as they stand in the file, and `log_time`, when it was logged [ns]."""

    topic: Topic
    log_time: int
    data: bytes


@dataclass(kw_only=True)
class Reading:
    """What is known of a file while it is read; its `topics` and `schemas`, by number.

    `damage` says why it couldn't be read to its end, `lost` counts lost chunks, `bytes` those of the messages so far.
    """

    topics: dict[int, Topic] = field(default_factory=dict)
    schemas: dict[int, Any] = field(default_factory=dict)
    damage: str = ""
    lost: int = 0
    bytes: int = 0


def import_library() -> Any:
    """Return `mcap.records`; raises `FormatError` where it isn't installed."""
    try:
        import mcap.records
        import mcap_ros2.decoder  # noqa: F401
    except ImportError:
        raise FormatError(
            'MCAP files that others wrote are read with mcap and mcap-ros2-support: say pip install "servobench[ros2]"'
        ) from None
    return mcap.records


def messages(path: Path, reading: Reading) -> Iterator[Message]:
    """Yield the messages in a file as far as it is whole; `reading` says afterwards what it has and lacks.

    Raises `FormatError` where the libraries aren't installed, or the file has more than `MOST_BYTES`.
    """
    records = import_library()
    with path.open("rb") as file:
        size = os.fstat(file.fileno()).st_size
        file.seek(len(MAGIC))
        for op, body in _records(file, size, reading):
            if op == Op.CHUNK:
                inside = _unpacked(body, records, reading)
                for inner, content in _records(io.BytesIO(inside), len(inside), reading):
                    yield from _taken(inner, content, records, reading)
            else:
                yield from _taken(op, body, records, reading)
            if reading.bytes > MOST_BYTES:
                raise FormatError(
                    f"{path.name} has more than {MOST_BYTES} bytes of messages; cut out the topics that are needed (mcap filter)"
                )


def _records(file: BinaryIO, size: int, reading: Reading) -> Iterator[tuple[int, bytes]]:
    """Opcode and body of each record up to the end of the data; bodies whose content isn't needed are empty."""
    needed = {Op.SCHEMA, Op.CHANNEL, Op.MESSAGE, Op.CHUNK}
    while (at := file.tell()) < size:
        head = file.read(RECORD_HEAD)
        op, length = struct.unpack("<BQ", head) if len(head) == RECORD_HEAD else (0, size)
        if length > size - at - RECORD_HEAD or (op in needed and length > LARGEST_CHUNK):
            reading.damage = "it ends in the middle of a record"
            return
        if op in (Op.DATA_END, Op.FOOTER):
            return
        if op in needed:
            yield op, file.read(length)
        else:
            file.seek(length, os.SEEK_CUR)


def _taken(op: int, body: bytes, records: Any, reading: Reading) -> Iterator[Message]:
    """Take a schema or a channel; yield a message."""
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError

    stream = ReadDataStream(io.BytesIO(body))
    try:
        if op == Op.SCHEMA:
            schema = records.Schema.read(stream)
            reading.schemas[schema.id] = schema
        elif op == Op.CHANNEL:
            channel = records.Channel.read(stream)
            if channel.id not in reading.topics:
                schema = reading.schemas.get(channel.schema_id)
                reading.topics[channel.id] = _topic(channel, schema)
        elif op == Op.MESSAGE:
            reading.bytes += len(body)
            message = records.Message.read(stream, len(body))
            if message.channel_id in reading.topics and message.log_time < 2**63:
                topic = reading.topics[message.channel_id]
                yield Message(topic=topic, log_time=message.log_time, data=message.data)
    except (McapError, ValueError, OverflowError, struct.error) as error:
        reading.damage = f"a record is damaged ({error or type(error).__name__})"


def _topic(channel: Any, schema: Any) -> Topic:
    name = "" if schema is None else str(schema.name)
    encoding = str(channel.message_encoding)
    decoder: Decoder | None = None
    why = f"encoded as {encoding}"
    if encoding == "json":
        decoder = json.loads
    elif encoding == "cdr":
        decoder, why = _cdr(schema)
    return Topic(name=str(channel.topic), schema=name, decoder=decoder, why_not=why)


def _cdr(schema: Any) -> tuple[Decoder | None, str]:
    from mcap_ros2.decoder import DecoderFactory

    try:
        with redirect_stderr(io.StringIO()):  # the parser prints there what it raises, too
            decoder = DecoderFactory().decoder_for("cdr", schema)
    except (
        Exception
    ) as error:  # the parser of definitions tells of what it doesn't know by errors of many types
        return None, f"its definition can't be read: {str(error)[:80]}"
    return decoder, "" if decoder else "its definition isn't in ros2msg"


def _unpacked(body: bytes, records: Any, reading: Reading) -> bytes:
    """The records in a chunk; none where it is damaged, or claims more than may be."""
    from mcap.data_stream import ReadDataStream
    from mcap.exceptions import McapError

    try:
        chunk = records.Chunk.read(ReadDataStream(io.BytesIO(body)))
        if chunk.uncompressed_size > LARGEST_CHUNK:
            raise ValueError("it claims too much")
        data = _decompressed(chunk.compression, chunk.data, chunk.uncompressed_size)
        if len(data) != chunk.uncompressed_size:
            raise ValueError("it is of another length than it claims")
        if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise ValueError("its checksum is wrong")
    except (McapError, ValueError, OverflowError, struct.error, RuntimeError):
        reading.lost += 1
        return b""
    return data


def _decompressed(compression: str, data: bytes, size: int) -> bytes:
    """The bytes of a chunk, and no more than one more than it claims; raises `ValueError` or `RuntimeError` where that fails."""
    if compression == "":
        return data
    if compression == "zstd":
        import zstandard

        try:
            return zstandard.ZstdDecompressor().stream_reader(data).read(size + 1)
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from error
    if compression == "lz4":
        import lz4.frame  # type: ignore[import-untyped]

        unpacked: bytes = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        return unpacked
    raise ValueError(f"compressed by {compression}")
