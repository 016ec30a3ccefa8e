"""MCAP files of other programs: ROS 2 bags and Foxglove's JSON. One recording, each topic with its own times.

A number in a message is the channel `topic.field`; in a message like sensor_msgs/JointState, with a list of names and lists of
values, it is `joint.position`, `.velocity`, `.effort`. If all messages of a topic have a header with a stamp, that is their
time; otherwise it is the log time. Source: ROS 2, common_interfaces, sensor_msgs/msg/JointState.msg and
std_msgs/msg/Header.msg.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, ClassVar, final

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Channel
from servobench.core.errors import FormatError, UsageError
from servobench.core.finding import Finding, info, warning
from servobench.recordings.formats import db3_messages
from servobench.recordings.formats.bag_folder import METADATA, bag_files, is_metadata
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.columns import LARGEST_TABLE, distinct, printable, quote
from servobench.recordings.formats.mcap_messages import Message, Reading, Topic, messages
from servobench.recordings.native.reader import is_foreign_mcap
from servobench.recordings.recording import Recording, Series, Source

MOST_NUMBERS = 20_000_000
_MOST_ELEMENTS = 100  # of one list in a message; what is longer is an image or a scan
_DEEPEST = 16
_JOINT_UNITS = {"position": "rad", "velocity": "rad/s", "effort": None}
_JOINT_FIELDS = {
    "position": "position", "positions": "position", "velocity": "velocity", "velocities": "velocity",
    "effort": "effort", "efforts": "effort",
}  # fmt: skip
_PARTS = ("", "actual", "feedback", "desired", "reference", "output")  # of a trajectory controller's state
_SAYS_NOTHING = ("header", "layout")  # of the motor: a time, and how a list is folded
_CLOCKS_APART = 1e9  # ns, from which on two clocks aren't the same


@dataclass(kw_only=True)
class _Gathered:
    """The numbers of a topic: of each field the values and the messages they stood in; of each message its two times [ns]."""

    topic: Topic
    logged: array[int] = field(default_factory=lambda: array("q"))
    stamped: array[int] = field(default_factory=lambda: array("q"))
    fields: dict[str, tuple[array[float], array[int]]] = field(default_factory=dict)
    broken: int = 0
    too_long: set[str] = field(default_factory=set)
    is_of_joints: bool = False

    def add(self, message: Message) -> int:
        """Take a message; return how many numbers it had."""
        try:
            content = message.topic.decoder(message.data) if message.topic.decoder else None
            numbers = list(self._numbers(content))
            stamp = _stamp(content)
        except Exception:  # a decoder tells of bytes that don't fit by errors of many types
            self.broken += 1
            return 0
        number = len(self.logged)
        self.logged.append(message.log_time)
        self.stamped.append(stamp)
        for name, value in numbers:
            if name not in self.fields and len(self.fields) >= LARGEST_TABLE:
                continue
            values, places = self.fields.setdefault(name, (array("d"), array("l")))
            values.append(value)
            places.append(number)
        return len(numbers)

    def _numbers(self, content: Any) -> Iterator[tuple[str, float]]:
        names = _joints_of(content)
        if not names:
            yield from self._flat("", content, 0)
            return
        self.is_of_joints = True
        for part in _PARTS:
            inner = getattr(content, part, None) if part else content
            for field_name, what in _JOINT_FIELDS.items():
                values = getattr(inner, field_name, None)
                if isinstance(values, str) or not hasattr(values, "__len__") or values is None:
                    continue
                for joint, value in zip(names, values, strict=False):
                    yield f"{joint}.{part}.{what}".replace("..", "."), float(value)

    def _flat(self, name: str, value: Any, depth: int) -> Iterator[tuple[str, float]]:
        """The numbers in a value by the names of the fields that lead to them; those of a header say nothing of the motor."""
        if isinstance(value, bool | int | float):
            yield name, float(value)
        elif isinstance(value, str) or value is None or depth > _DEEPEST:
            return
        elif isinstance(value, dict) or hasattr(value, "__slots__"):
            keys = value if isinstance(value, dict) else value.__slots__
            for key in keys:
                if key not in _SAYS_NOTHING:
                    inner = value[key] if isinstance(value, dict) else getattr(value, key)
                    yield from self._flat(f"{name}.{key}".lstrip("."), inner, depth + 1)
        elif isinstance(value, bytes) or len(value) > _MOST_ELEMENTS:
            self.too_long.add(name)
        else:
            for k, inner in enumerate(value, 1):
                yield from self._flat(f"{name}_{k}", inner, depth + 1)

    @property
    def times(self) -> NDArray[np.int64]:
        """The times of the messages [ns]."""
        return np.array(self.stamped if self.has_stamps else self.logged, dtype=np.int64)

    @property
    def has_stamps(self) -> bool:
        """Whether each message has a stamp of its own."""
        return bool(self.stamped) and min(self.stamped) > 0


def _joints_of(content: Any) -> list[str]:
    """The joints that a message like a JointState names, whose parallel lists belong to them; none for any other message."""
    for key in ("name", "joint_names"):
        names = getattr(content, key, None)
        if isinstance(names, list) and names and all(isinstance(each, str) for each in names):
            return names
    return []


def _stamp(content: Any) -> int:
    """The stamp in a message's header [ns], 0 where it has none."""
    inner = content
    for key in ("header", "stamp"):
        inner = inner.get(key) if isinstance(inner, dict) else getattr(inner, key, None)
    if inner is None:
        return 0
    seconds, rest = (
        (inner.get("sec", 0), inner.get("nanosec", inner.get("nsec", 0)))
        if isinstance(inner, dict)
        else (inner.sec, inner.nanosec)
    )
    stamp = int(seconds or 0) * 10**9 + int(rest or 0)
    return stamp if 0 < stamp < 2**63 else 0


@final
@FORMATS.member("rosbag")
@dataclass(frozen=True, kw_only=True)
class RosBag:
    """ROS 2 bags (folders, .mcap, .db3) and Foxglove's MCAP files: the numbers in their messages (the extra `ros2`)."""

    suffixes: ClassVar[tuple[str, ...]] = (".mcap", ".db3")
    written: ClassVar[tuple[str, ...]] = ()
    by_library: ClassVar[bool] = True

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file is an MCAP file whose header names another program, an SQLite file, or the metadata of a bag."""
        return is_foreign_mcap(head) or head.startswith(db3_messages.MAGIC) or is_metadata(path, head)

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recording in a file; raises `FormatError` where it has no number that can be read."""
        return read(path)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Raise `UsageError`: what is written to an MCAP file is a recording of ours."""
        raise UsageError(
            f"{path.name}: ROS bags can't be written; servobench writes .mcap files in its own format `mcap`"
        )


def read(path: Path) -> tuple[Recording, ...]:
    """Return the recording in a file; raises `FormatError` where there is no number in it, or what reads it isn't installed."""
    reading = Reading()
    topics: dict[tuple[str, str], _Gathered] = {}
    count = 0
    for message in _messages(path, reading):
        if message.topic.decoder is None:
            continue
        key = message.topic.name, message.topic.schema
        count += topics.setdefault(key, _Gathered(topic=message.topic)).add(message)
        if count > MOST_NUMBERS:
            raise FormatError(
                f"{path.name} has more than {MOST_NUMBERS} numbers; extract the topics that you need (mcap filter)"
            )
    with_numbers = [each for each in topics.values() if each.fields]
    skipped = _topics_without_channel(reading, topics)
    if not with_numbers:
        raise FormatError(
            f"{path.name} is a bag without readable messages of numbers; its topics: {quote(skipped) or 'none'}"
        )
    series, back = _series(with_numbers)
    if len(series) > LARGEST_TABLE:
        raise FormatError(
            f"{path.name} has {len(series)} channels, more than {LARGEST_TABLE}; extract the topics that you need"
        )
    names, renamed = distinct([each.channel.name for each in series])
    named = tuple(
        Series(channel=Channel(name=name, unit=each.channel.unit), values=each.values, t=each.t)
        for name, each in zip(names, series, strict=True)
    )
    findings = [*_about_file(reading, skipped), *renamed, *_about_topics(with_numbers, back)]
    source = Source(name=path.name, format="rosbag")
    name = path.parent.name if path.name == METADATA else path.stem
    return (Recording(name=name, series=named, source=source, findings=tuple(findings)),)


def _messages(path: Path, reading: Reading) -> Iterator[Message]:
    """The messages of a file, or of all files of a bag whose metadata it is; each file has its own numbers for the topics."""
    if path.name != METADATA:
        with path.open("rb") as file:
            in_sqlite = file.read(len(db3_messages.MAGIC)) == db3_messages.MAGIC
        yield from (db3_messages.messages if in_sqlite else messages)(path, reading)
        return
    for part in bag_files(path):
        own = Reading()
        yield from _messages(part, own)
        begin = len(reading.topics)
        reading.topics.update({begin + k: topic for k, topic in enumerate(own.topics.values())})
        reading.lost += own.lost
        reading.damage = reading.damage or (f"{part.name}: {own.damage}" if own.damage else "")


def _topics_without_channel(reading: Reading, topics: dict[tuple[str, str], _Gathered]) -> list[str]:
    """The topics that give no channel, and why."""
    skipped = {}
    for topic in reading.topics.values():
        gathered = topics.get((topic.name, topic.schema))
        if topic.decoder is None:
            skipped[topic.name] = topic.why_not
        elif gathered is None or not gathered.fields:
            skipped[topic.name] = _why_empty(gathered)
    return [f"{name} ({why})" for name, why in skipped.items()]


def _why_empty(gathered: _Gathered | None) -> str:
    if gathered is not None and gathered.too_long:
        return f"lists of more than {_MOST_ELEMENTS} numbers"
    return "damaged" if gathered is not None and gathered.broken else "no numbers"


def _series(topics: Sequence[_Gathered]) -> tuple[list[Series], list[str]]:
    """The channels, and the topics whose messages had to be sorted by time."""
    origin = min(int(each.times.min()) for each in topics)
    one_of_joints = sum(each.is_of_joints for each in topics) == 1
    series: list[Series] = []
    back: list[str] = []
    for each in topics:
        t = (each.times - origin) / 1e9
        order = np.argsort(t, kind="stable")
        if (np.diff(t) < 0).any():
            back.append(each.topic.name)
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(len(order))
        for name, (values, places) in each.fields.items():
            at = np.array(places, dtype=np.int64)
            sorting = np.argsort(rank[at], kind="stable")
            unit = _JOINT_UNITS.get(name.rpartition(".")[2]) if each.is_of_joints else None
            full = name if each.is_of_joints and one_of_joints else f"{each.topic.name}.{name}".rstrip(".")
            full = printable(full)
            channel = Channel(name=full, unit=unit)
            series.append(Series(channel=channel, values=np.array(values)[sorting], t=t[at][sorting]))
    return series, back


def _about_file(reading: Reading, skipped: Sequence[str]) -> list[Finding]:
    findings = []
    if reading.damage:
        sentence = f"The file is cut short or damaged: {reading.damage}. What can be read is read."
        findings.append(warning("recording-cut-short", sentence))
    if reading.lost:
        sentence = f"{reading.lost} chunks of messages are damaged and left out."
        findings.append(warning("chunk-damaged", sentence))
    if skipped:
        findings.append(info("topic-skipped", f"Topics that aren't read: {quote(skipped)}."))
    return findings


def _about_topics(topics: Sequence[_Gathered], back: Iterable[str]) -> list[Finding]:
    findings = [_about_origin(min(int(each.times.min()) for each in topics))]
    if any(each.is_of_joints for each in topics):
        sentence = "Joint positions are read in rad and velocities in rad/s, as in ROS for revolute joints."
        findings.append(info("joint-units", sentence))
    logged = [each.topic.name for each in topics if not each.has_stamps]
    if logged:
        sentence = (
            f"These topics have no stamp in their messages, so the log times are used: {quote(logged)}. Log times "
            "are late by the transport, which a fitted delay then includes."
        )
        findings.append(info("time-logged", sentence))
    apart = [
        each.topic.name
        for each in topics
        if each.has_stamps and abs(np.median(np.array(each.logged) - np.array(each.stamped))) > _CLOCKS_APART
    ]
    if logged and apart:
        sentence = (
            f"The stamps in {quote(apart)} differ from the log's clock by more than a second: don't combine "
            f"channels of these topics with those of {quote(logged)}."
        )
        findings.append(warning("clock-differs", sentence))
    if sorted_in := list(back):
        findings.append(
            info("time-sorted", f"Messages out of order were sorted by time: {quote(sorted_in)}.")
        )
    if broken := [f"{each.topic.name} ({each.broken})" for each in topics if each.broken]:
        findings.append(
            warning(
                "message-damaged", f"Messages that don't fit their definition are left out: {quote(broken)}."
            )
        )
    if too_long := [f"{each.topic.name}.{name}" for each in topics for name in sorted(each.too_long)]:
        sentence = f"Lists of more than {_MOST_ELEMENTS} numbers aren't read: {quote(too_long)}."
        findings.append(info("list-skipped", sentence))
    return findings


def _about_origin(origin: int) -> Finding:
    when = f"{origin / 1e9:.9g} s on the file's clock"
    if origin > 10**18:  # after 2001, so counted from 1970
        when = f"{datetime.fromtimestamp(origin // 10**9, UTC):%Y-%m-%d %H:%M:%S} UTC"
    return info("time-origin", f"Times are counted from the first message, at {when}.")
