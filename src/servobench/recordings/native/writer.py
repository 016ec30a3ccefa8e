"""Writes recordings to the native file, at once or during a run."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import numpy as np

from servobench._version import __version__
from servobench.core.channels import Array, Channel
from servobench.core.errors import UsageError
from servobench.core.finding import Finding
from servobench.recordings.native import mcap
from servobench.recordings.native.description import (
    ENDING,
    HAPPENING,
    OPENING,
    Ending,
    Group,
    Opening,
    RecordedEvent,
    Roles,
    entries,
)
from servobench.recordings.native.mcap_file import McapFile
from servobench.recordings.recording import Event, Recording, Series, Stopped

MOST_ROWS = 4096  # in a chunk
CHUNK_BYTES = mcap.LARGEST_CHUNK // 16


@dataclass(frozen=True, kw_only=True)
class Together:
    """Names of channels that share their times, or that have none (`timed` False)."""

    channels: tuple[str, ...]
    timed: bool = True


class RecordingWriter:
    """Writes recordings, one after the other, to a native file that can be read whatever happens to the writing.

    `path` is where the file is once it is closed; until then, and permanently after an error, `.part` follows its name.
    What `append` was given outlives this process, and a power cut about a second later.
    `now` is the clock of that second. Raises `UsageError` where there is a part already, and `StorageError`, with the part kept,
    where nothing more can be written.
    """

    def __init__(self, path: str | os.PathLike[str], *, now: Callable[[], float] = time.monotonic) -> None:
        self._file = McapFile(path, library=f"servobench {__version__}", now=now)
        self._topics: dict[str, int] = {}
        self._opening: Opening | None = None
        self._events = 0
        self._blanks: dict[int, mcap.Messages] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give the file its name after success, leave it as a part after an error."""
        if kind is None:
            self.close()
        else:
            self.abandon()

    def begin(self, opening: Recording, together: Sequence[Together], *, earliest: float = 0.0) -> None:
        """Begin a recording with all that is known of it: everything but its samples, its events and why it stopped.

        Each channel of `opening` stands in one of `together`, which is what `append` counts. `earliest` is the earliest time to
        come [s], if that is before 0. Raises `UsageError` where a channel has no place, or the recording before has no end.
        """
        if self._opening is not None:
            raise UsageError(
                f"{self._file.path}: {self._opening.name!r} has to end before {opening.name!r} begins"
            )
        channels = tuple(series.channel for series in opening.series)
        placed = sorted(name for each in together for name in each.channels)
        if placed != sorted(channel.name for channel in channels):
            raise UsageError(
                f"{opening.name!r} has the channels {', '.join(repr(channel.name) for channel in channels)}, but "
                f"these channels have a place in the file: {', '.join(map(repr, placed)) or 'none'}"
            )
        groups = tuple(
            self._group(opening.name, each, number) for number, each in enumerate(together, self._next)
        )
        begun = Opening(
            name=opening.name,
            channels=channels,
            groups=groups,
            source=opening.source,
            roles=Roles(
                input=opening.input,
                output=opening.output,
                input_before=opening.input_before,
                chain=opening.chain,
                reference=opening.reference,
            ),
            info=opening.info,
            experiment=opening.experiment,
            findings=opening.findings,
            versions=dict(opening.versions),
            log_time_zero=min(0.0, float(np.floor(earliest))),
        )
        self._file.add_metadata(OPENING, entries(begun))
        for group in groups:
            self._file.add_channel(group.topic, _definition(group, channels))
        self._blanks.clear()
        self._opening = begun
        self._events = 0

    def append(self, group: int, rows: Array) -> None:
        """Write rows (N, C) of one group, the place of it in `together`: the time [s], if it has times, and the values."""
        opening = self._make_opening()
        target = opening.groups[group]
        if rows.ndim != 2 or rows.shape[1] != target.columns:
            raise UsageError(f"{target.topic}: rows of shape {rows.shape}; expected (N, {target.columns})")
        blank = self._blank(target)
        most = len(blank)
        for start in range(0, len(rows), most):
            block = rows[start : start + most]
            first = self._file.count(target.number)
            if target.timed:
                times = mcap.log_time(block[:, 0], opening.log_time_zero)
            else:
                times = np.arange(first, first + len(block), dtype=np.uint64)
            self._file.add_messages(mcap.messages(target.number, first, times, block, blank))

    def event(self, event: Event) -> None:
        """Write what happened; before the samples that it concerns, so that a torn file has no sample without it."""
        self._make_opening()
        self._file.add_metadata(HAPPENING, entries(RecordedEvent(number=self._events, event=event)))
        self._events += 1

    def end(self, stopped: Stopped, findings: Iterable[Finding] = ()) -> None:
        """End the recording: why it stopped, and all its findings, those that it began with among them."""
        rows = tuple(self._file.count(group.number) for group in self._make_opening().groups)
        ending = Ending(stopped=stopped, findings=tuple(findings), rows=rows, events=self._events)
        self._file.add_metadata(ENDING, entries(ending))
        self._opening = None

    def close(self) -> None:
        """Finish the file and give it its name; raises `StorageError`, with the part kept, where that can't be done."""
        self._file.close()

    def abandon(self) -> None:
        """Leave the part as it is; never raises, and does nothing to a closed file."""
        self._file.abandon()

    def _blank(self, group: Group) -> mcap.Messages:
        """The largest chunk of a group, to be written in again and again."""
        if group.number not in self._blanks:
            most = max(1, min(MOST_ROWS, CHUNK_BYTES // mcap.row_type(group.columns).itemsize))
            self._blanks[group.number] = mcap.blank_messages(group.number, most, group.columns)
        return self._blanks[group.number]

    def _make_opening(self) -> Opening:
        if self._opening is None:
            raise UsageError(f"{self._file.path}: no recording has begun: begin() comes first")
        return self._opening

    @property
    def _next(self) -> int:
        return self._file.channels + 1

    def _group(self, recording: str, together: Together, number: int) -> Group:
        name = together.channels[0] if len(together.channels) == 1 else "samples"
        topic = _unique(f"/{_topic(recording)}/{_topic(name)}", self._topics)
        return Group(number=number, topic=topic, channels=together.channels, timed=together.timed)


def save(recordings: Sequence[Recording], path: str | os.PathLike[str]) -> None:
    """Write recordings to a native file, in place of an earlier file of that name.

    Raises `UsageError` for no recordings, `StorageError` where the file can't be written.
    """
    if not recordings:
        raise UsageError(f"{path}: there is no recording to write")
    with RecordingWriter(path) as writer:
        for recording in recordings:
            groups = _group_series(recording.series)
            together = [
                Together(channels=tuple(each.channel.name for each in group), timed=group[0].t is not None)
                for group in groups
            ]
            writer.begin(recording, together, earliest=_earliest(recording))
            for event in recording.events:
                writer.event(event)
            for place, group in enumerate(groups):
                times = group[0].t
                columns = [*([] if times is None else [times]), *(each.values for each in group)]
                for start in range(0, len(columns[0]), MOST_ROWS):
                    writer.append(
                        place, np.column_stack([column[start : start + MOST_ROWS] for column in columns])
                    )
            writer.end(recording.stopped, recording.findings)


def _group_series(series: Iterable[Series]) -> list[list[Series]]:
    """Series in groups that share their times to the bit, or their length where they have no times."""
    groups: dict[tuple[bytes | None, int], list[Series]] = {}
    for each in series:
        times = None if each.t is None else each.t.tobytes()
        groups.setdefault((times, len(each.values)), []).append(each)
    return list(groups.values())


def _earliest(recording: Recording) -> float:
    """The earliest finite time of a recording [s]; 0 where there is none."""
    times = [t[np.isfinite(t)] for each in recording.series if (t := each.t) is not None]
    return min((float(t.min()) for t in times if len(t)), default=0.0)


def _definition(group: Group, channels: Sequence[Channel]) -> str:
    """The message of a group in the language of ROS 2: a line for each column, with the channel's own name as a comment."""
    units = {channel.name: channel.unit for channel in channels}
    taken: dict[str, int] = {}
    lines = [f"float64 {_unique('t', taken)}  # time [s]"] if group.timed else []
    for name in group.channels:
        comment = name if units[name] is None else f"{name} [{units[name]}]"
        lines.append(f"float64 {_unique(_field(name), taken)}  # {_one_line(comment)}")
    return "\n".join(lines) + "\n"


def _field(name: str) -> str:
    """A name as ROS 2 takes it for a field: lower case, digits, and single underscores between them."""
    plain = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    return plain if plain[:1].isalpha() else f"channel_{plain}".rstrip("_")


def _topic(name: str) -> str:
    """A name as ROS 2 takes it for a part of a topic."""
    plain = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return plain if plain[:1].isalpha() else f"recording_{plain}".rstrip("_")


def _unique(wanted: str, taken: dict[str, int]) -> str:
    """The name that is wanted, with a number behind it where it's taken; it is taken from then on.

    `taken` keeps the last number of each name, so that a thousand alike don't cost a million tries.
    """
    number = taken.get(wanted, 0) + 1
    while (name := wanted if number == 1 else f"{wanted}_{number}") in taken:
        number += 1
    taken[wanted] = number
    taken.setdefault(name, 1)
    return name


def _one_line(comment: str) -> str:
    """A comment without line ends, and without what UTF-8 can't hold."""
    return " ".join(comment.split()).encode("utf-8", "replace").decode()
