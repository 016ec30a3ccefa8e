"""The description of a recording in a native file: JSON texts in MCAP metadata records, each with a checksum.

Information known at the start comes before the first sample (`Opening`), so that a torn file can still be read; the reason for
the end comes after the last one (`Ending`). Events come in between, before the samples that they concern (`RecordedEvent`).
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import cache
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from servobench.core.channels import Channel, DeviceInfo
from servobench.core.finding import Finding
from servobench.recordings.native.mcap import Damaged
from servobench.recordings.recording import Event, Source, Stopped

OPENING = "servobench.recording/1"
ENDING = "servobench.recording.end/1"
HAPPENING = "servobench.recording.event/1"
_CHECKSUM = "crc32"


@dataclass(frozen=True, kw_only=True)
class Group:
    """Channels that share their times: the MCAP channel `number` and its topic.

    A row of the group is the time and then a value of each channel; without times (`timed` False) it is the values alone.
    """

    number: int
    topic: str
    channels: tuple[str, ...]
    timed: bool

    @property
    def columns(self) -> int:
        """The numbers in a row."""
        return len(self.channels) + self.timed


@dataclass(frozen=True, kw_only=True)
class Roles:
    """The names of input, output and reference; `input_before` and `chain` are those of `Recording`."""

    input: str | None = None
    output: str | None = None
    input_before: float | None = None
    chain: str = ""
    reference: str | None = None


@dataclass(frozen=True, kw_only=True)
class Opening:
    """A recording's description before the first sample: the fields of `Recording`, and how its samples are stored.

    Of the recording its `name`, `channels`, `source`, `info` of the device, text of the `experiment`, `findings` and `versions`;
    `roles` are those of its channels. `groups` are those of channels that share their times.

    Log times count from `log_time_zero` [s]. For a group without times they are the numbers of the samples, counted from 0.
    """

    name: str
    channels: tuple[Channel, ...]
    groups: tuple[Group, ...]
    source: Source
    roles: Roles = field(default_factory=Roles)
    info: DeviceInfo | None = None
    experiment: str = ""
    findings: tuple[Finding, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    log_time_zero: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Ending:
    """A recording's end: why it `stopped`, all findings, the rows of each group and the events."""

    stopped: Stopped
    findings: tuple[Finding, ...]
    rows: tuple[int, ...]
    events: int = 0


@dataclass(frozen=True, kw_only=True)
class RecordedEvent:
    """An event of a recording and its number in it, counted from 0, so that none can be lost unnoticed."""

    number: int
    event: Event


T = TypeVar("T", Opening, Ending, RecordedEvent)


def entries(description: Opening | Ending | RecordedEvent) -> dict[str, bytes]:
    """Return a description as the entries of a metadata record."""
    texts = {key: _json(value) for key, value in asdict(description).items()}
    return {**texts, _CHECKSUM: _checksum(texts)}


def parse_description(kind: type[T], entries: Mapping[str, bytes]) -> T:
    """Return the description in the entries of a metadata record; raises `Damaged`."""
    texts = {key: value for key, value in entries.items() if key != _CHECKSUM}
    if entries.get(_CHECKSUM) != _checksum(texts):
        raise Damaged("the checksum of a description is wrong")
    known = {each.name for each in fields(kind)}
    try:
        values = {key: json.loads(value) for key, value in texts.items() if key in known}
        description: T = _adapters()[kind].validate_python(values)
    except (ValidationError, ValueError, RecursionError) as error:
        raise Damaged("a description is incomplete") from error
    return description


@cache
def _adapters() -> Mapping[type, TypeAdapter[Any]]:
    return {kind: TypeAdapter(kind) for kind in (Opening, Ending, RecordedEvent)}


def _json(value: object) -> bytes:
    """A value as JSON in UTF-8.

    A lone surrogate, which stands for a byte in a file's name that is no text, has no UTF-8; its escape is JSON, too.
    """
    return json.dumps(_finite(value), ensure_ascii=False, allow_nan=False).encode("utf-8", "backslashreplace")


def _finite(value: Any) -> Any:
    """The same value with the numbers that JSON lacks as texts, which are read back as numbers."""
    if isinstance(value, float) and value - value != 0.0:
        return str(value)
    if isinstance(value, dict):
        return {key: _finite(content) for key, content in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(content) for content in value]
    return value


def _checksum(entries: Mapping[str, bytes]) -> bytes:
    content = b"".join(key.encode() + b"\0" + value + b"\0" for key, value in entries.items())
    return f"{zlib.crc32(content):08x}".encode()
