"""LabVIEW's TDMS files, of as many segments as they have; one segment is written.

A group is a recording and a channel of a group a channel of it. A waveform has its own times, from its start, offset and
increment; the zero of a recording's times is the earliest start or time stamp in its group.
Source: National Instruments, "TDMS File Format Internal Structure", and the waveform properties of its LabVIEW help.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, final

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import FormatError
from servobench.core.finding import Finding, info
from servobench.recordings.formats import metadata
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.columns import (
    LARGEST_TABLE,
    LARGEST_WHOLE,
    Column,
    distinct,
    heading,
    quote,
    recording_of,
    with_unit,
)
from servobench.recordings.formats.extras import format_errors, library
from servobench.recordings.recording import Recording, Source

_OURS = "servobench"  # the property of the file with all that recordings know beside their samples
_FRACTIONS = 2.0**64  # of a second, in a time stamp


@final
@FORMATS.member("tdms")
@dataclass(frozen=True, kw_only=True)
class Tdms:
    """TDMS files: a recording for each group, of its channels of numbers and time stamps, scaled as their properties say.

    An index file (`.tdms_index`) beside the file isn't needed, and isn't read.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".tdms",)
    written: ClassVar[tuple[str, ...]] = suffixes
    by_library: ClassVar[bool] = True

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file begins like a TDMS file."""
        return head.startswith(b"TDSm")

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return a recording for each group with channels of numbers; raises `FormatError` where there is none.

        Raises `UsageError` where npTDMS isn't installed.
        """
        nptdms = library("nptdms", "npTDMS", "labview", path.name)
        # From memory, where a read beyond the end gives less; from the disk npTDMS would make room for it first.
        data = io.BytesIO(path.read_bytes())
        with _quiet():
            with format_errors(path.name, "TDMS"):
                file = nptdms.TdmsFile.open(data, raw_timestamps=True)
                groups = {group.name: group.channels() for group in file.groups()}
                ours = file.properties.get(_OURS)
            if isinstance(ours, str) and metadata.SCHEMA in ours:
                return _own(ours, groups, path.name)
            recordings = [_foreign(group, channels, path) for group, channels in groups.items() if channels]
            with format_errors(path.name, "TDMS"):
                cut = file.file_status.incomplete_final_segment
        return _require_recordings(recordings, cut, path)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write each recording as a group, its times as channels, and all they know as a property of the file."""
        nptdms = library("nptdms", "npTDMS", "labview", path.name)
        described: list[dict[str, Any]] = []
        objects: list[Any] = []
        groups = _names([recording.name for recording in recordings])
        for recording, group in zip(recordings, groups, strict=True):
            table = metadata.table_of(recording, _names)
            described.append({"group": group, **table.description})
            objects.append(nptdms.GroupObject(group))
            objects.extend(
                nptdms.ChannelObject(group, name, values, _unit_property(table.units[name]))
                for name, values in table.columns.items()
            )
        text = metadata.as_text({"schema": metadata.SCHEMA, "recordings": described})
        with path.open("wb") as file, nptdms.TdmsWriter(file) as writer:
            writer.write_segment([nptdms.RootObject({_OURS: text}), *objects])


@contextmanager
def _quiet() -> Iterator[None]:
    """npTDMS writes warnings to standard error; what matters of them is a finding or an error here."""
    from nptdms.log import log_manager

    before = log_manager.log_level
    log_manager.set_level(logging.CRITICAL + 1)
    try:
        with np.errstate(all="ignore"):  # a scaling may overflow
            yield
    finally:
        log_manager.set_level(before)


def _require_recordings(
    recordings: Sequence[Recording | str], cut: bool, path: Path
) -> tuple[Recording, ...]:
    """The recordings, with a finding if the last segment is truncated; raises `FormatError` if there are none."""
    readable = [each for each in recordings if isinstance(each, Recording)]
    if not readable:
        why = (
            "; ".join(each for each in recordings if isinstance(each, str))
            or "it has no groups with channels"
        )
        raise FormatError(f"{path.name} has no channels of numbers: {why}")
    if len(readable) == 1:
        readable = [replace(readable[0], name=path.stem)]
    if cut:
        sentence = "The file ends inside its last segment; it is read up to there."
        readable = [each.with_findings(info("recording-cut-short", sentence)) for each in readable]
    return tuple(readable)


def _foreign(group: str, channels: Sequence[Any], path: Path) -> Recording | str:
    """The recording that a group is, or the sentence that says why it is none."""
    if len(channels) > LARGEST_TABLE:
        raise FormatError(
            f"{path.name}: group {group!r} has {len(channels)} channels; expected at most {LARGEST_TABLE} in a "
            "recording"
        )
    zero = _zero(channels, path.name)
    columns: list[Column] = []
    skipped: list[str] = []
    findings: list[Finding] = []
    for channel in channels:
        column = _column(channel, zero, path.name)
        if isinstance(column, Column) and isinstance(unit := channel.properties.get("unit_string"), str):
            head, unit_findings = with_unit(column.heading, unit)
            column = column if column.is_time else replace(column, heading=head)
            findings.extend(unit_findings)
        if isinstance(column, str):
            skipped.append(f"{channel.name} ({column})")
        else:
            columns.append(column)
    if not columns:
        return f"group {quote([group])} has {quote(skipped)}"
    if skipped:
        findings.append(
            info("channel-skipped", f"Channels that aren't numbers aren't read: {quote(skipped)}.")
        )
    findings.extend(_about_whole_numbers(columns, channels))
    findings.extend(_about_waveforms(columns, channels))
    source = Source(name=path.name, format="tdms")
    return recording_of(columns, name=group or path.stem, source=source, findings=findings)


def _column(channel: Any, zero: int | None, name: str) -> Column | str:
    """The column that a channel is, or what it is instead. `zero` is where the times of its group begin, as a stamp."""
    kind = getattr(channel.data_type, "__name__", "no type")
    if not len(channel):
        return "empty"
    with format_errors(name, "TDMS"):
        if kind not in {"TimeStamp", "DaqMxRawData"} and channel.data_type.nptype is None:
            return "text" if kind == "String" else kind
        values = channel[:] if kind == "TimeStamp" else np.asarray(channel[:])
    head = heading(channel.name)
    if kind == "TimeStamp":
        return Column(heading=replace(head, unit="s"), values=_seconds(values, zero or 0), is_time=True)
    if values.dtype.kind not in "biuf":
        return "complex numbers" if values.dtype.kind == "c" else f"of type {values.dtype}"
    values = np.array(values, dtype=np.float64)
    return Column(heading=head, values=values, t=_waveform_times(channel.properties, len(values), zero))


def _waveform_times(properties: Any, count: int, zero: int | None) -> Array | None:
    """The times of a waveform's samples; None where the channel has no increment and so is no waveform."""
    step, offset = (_number(properties.get(key)) for key in ("wf_increment", "wf_start_offset"))
    if step is None or step <= 0.0:
        return None
    start = _stamp(properties.get("wf_start_time"))
    begin = (0.0 if start is None or zero is None else (start - zero) / _FRACTIONS) + (offset or 0.0)
    t: Array = begin + step * np.arange(count, dtype=np.float64)
    return t


def _number(value: object) -> float | None:
    if isinstance(value, int | float | np.number) and np.isfinite(value):
        return float(value)
    return None


def _stamp(value: object) -> int | None:
    """A time stamp in fractions of a second since 1904; None for another value, and for 1904 itself, which means "not set"."""
    seconds, fractions = (getattr(value, part, None) for part in ("seconds", "second_fractions"))
    if seconds is None or fractions is None or not int(seconds):
        return None
    return int(seconds) * 2**64 + int(fractions)


def _zero(channels: Sequence[Any], name: str) -> int | None:
    """The earliest start of a waveform, or first time stamp, in a group; None where it has neither."""
    starts = []
    for channel in channels:
        if getattr(channel.data_type, "__name__", "") == "TimeStamp" and len(channel):
            with format_errors(name, "TDMS"):
                starts.append(_stamp(channel[0]))
        step = _number(channel.properties.get("wf_increment"))
        if step is not None and step > 0.0:
            starts.append(_stamp(channel.properties.get("wf_start_time")))
    return min((each for each in starts if each is not None), default=None)


def _seconds(stamps: Any, zero: int) -> Array:
    """Time stamps in s since `zero`; whole seconds and fractions apart, so that no digit is lost to the years since 1904."""
    whole, part = divmod(zero, 2**64)
    seconds: Array = (stamps.seconds - np.int64(whole)).astype(np.float64)
    seconds += (stamps.second_fractions.astype(np.float64) - float(part)) / _FRACTIONS
    return seconds


def _about_whole_numbers(columns: Sequence[Column], channels: Sequence[Any]) -> list[Finding]:
    """Findings on whole numbers that a float can't distinguish from the next."""
    whole = {
        heading(each.name).name
        for each in channels
        if getattr(each.data_type, "__name__", "") in {"Int64", "Uint64"}
    }
    large = [
        each.heading.name
        for each in columns
        if each.heading.name in whole and np.abs(each.values).max() >= LARGEST_WHOLE
    ]
    if not large:
        return []
    sentence = f"Whole numbers too large to be kept to the last digit: {quote(large)}."
    return [info("integer-rounded", sentence)]


def _about_waveforms(columns: Sequence[Column], channels: Sequence[Any]) -> list[Finding]:
    waveforms = [column.heading.name for column in columns if column.t is not None]
    if not waveforms:
        return []
    sentence = f"Times come from the start and increment of the waveforms {quote(waveforms)}"
    stamps = [_stamp(channel.properties.get("wf_start_time")) for channel in channels]
    starts = [each for each in stamps if each is not None]
    if len(set(starts)) > 1:
        sentence += f"; their starts differ by up to {(max(starts) - min(starts)) / _FRACTIONS:.4g} s"
    return [info("waveform-times", f"{sentence}.")]


def _names(names: Sequence[str]) -> tuple[str, ...]:
    """Names that differ, as TDMS can hold them."""
    plain, _ = distinct([metadata.as_utf_8(name) for name in names])
    return plain


def _unit_property(unit: str | None) -> dict[str, str]:
    return {} if unit is None else {"unit_string": metadata.as_utf_8(unit)}


def _own(text: str, groups: dict[str, Sequence[Any]], name: str) -> tuple[Recording, ...]:
    """The recordings in a file of ours; raises `FormatError` where they aren't what its property says."""

    def recording(one: Any) -> Recording:
        channels = {channel.name: channel for channel in groups[one["group"]]}
        return metadata.recording_of_table(one, lambda label: _values(channels[label], name), name)

    described = metadata.from_text(text, name)
    try:
        return tuple(recording(one) for one in described["recordings"])
    except (KeyError, TypeError) as error:
        raise FormatError(f"{name}: its property `{_OURS}` doesn't describe the file ({error!r})") from None


def _values(channel: Any, name: str) -> Array:
    with format_errors(name, "TDMS"):
        values = channel[:]
    if values.dtype.kind != "f":
        raise ValueError(f"{channel.name!r} has values of type {values.dtype}")
    return np.array(values, dtype=np.float64)
