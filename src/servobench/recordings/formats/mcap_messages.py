"""The messages in any MCAP file, with a decoder for each topic.

The records are read by `mcap`, CDR messages of ROS 2 decoded by `mcap-ros2-support` (the extra `ros2`).
Source: the MCAP format specification, version 0.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

from servobench.core.errors import FormatError

Decoder: TypeAlias = Callable[[bytes], Any]


@dataclass(frozen=True, kw_only=True)
class Topic:
    """A channel of messages: its topic's `name`, that of their `schema`, their decoder, or `why_not`."""

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
    """The state of reading a file; its `topics` and `schemas`, by number.

    `damage` says why it couldn't be read to its end, `lost` counts lost chunks.
    """

    topics: dict[int, Topic] = field(default_factory=dict)
    schemas: dict[int, Any] = field(default_factory=dict)
    damage: str = ""
    lost: int = 0


def import_library() -> Any:
    """Return `mcap.records`; raises `FormatError` where it isn't installed."""
    try:
        import mcap.records
        import mcap_ros2.decoder  # noqa: F401
    except ImportError:
        raise FormatError(
            'MCAP files from other programs need mcap and mcap-ros2-support: pip install "servobench[ros2]"'
        ) from None
    return mcap.records


def messages(path: Path, reading: Reading) -> Iterator[Message]:
    """Yield the messages in a file as far as it is whole; `reading` says afterwards what it has and lacks.

    Raises `FormatError` where the libraries aren't installed.
    """
    records = import_library()
    with path.open("rb") as file:
        for record in _records(file, records, reading):
            if isinstance(record, records.Schema):
                reading.schemas[record.id] = record
            elif isinstance(record, records.Channel) and record.id not in reading.topics:
                reading.topics[record.id] = _topic(record, reading.schemas.get(record.schema_id))
            elif isinstance(record, records.Message) and record.channel_id in reading.topics:
                topic = reading.topics[record.channel_id]
                if record.log_time < 2**63:
                    yield Message(topic=topic, log_time=record.log_time, data=record.data)


def _records(file: BinaryIO, records: Any, reading: Reading) -> Iterator[Any]:
    """The records up to the end of the data, those in chunks included; a damaged chunk is left out."""
    from mcap.stream_reader import StreamReader, breakup_chunk

    try:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, records.DataEnd):
                return
            if not isinstance(record, records.Chunk):
                yield record
                continue
            try:
                inside = breakup_chunk(record, validate_crc=True)
            except Exception:  # decompressors tell of damage by errors of many types
                reading.lost += 1
            else:
                yield from inside
    except Exception as error:  # and so does the library of a record that doesn't fit
        reading.damage = str(error) or type(error).__name__


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


def cdr_decoder(name: str, encoding: str, definition: bytes) -> tuple[Decoder | None, str]:
    """Return the decoder of CDR messages of a type with its definition (`ros2msg`), or None and why there is none."""
    return _cdr(import_library().Schema(id=1, name=name, encoding=encoding, data=definition))


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
