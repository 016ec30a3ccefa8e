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
    Column,
    Heading,
    distinct,
    heading,
    quoted,
    recording_of,
    with_unit,
)
from servobench.recordings.formats.extras import library
from servobench.recordings.formats.unpacking import MOST_BYTES
from servobench.recordings.recording import Recording, Source

_OURS = "servobench"  # the property of the file with all that recordings know beside their samples
_MOST_SCALES = 100  # steps of a channel's scaling, and numbers in the table or polynomial of one
_FRACTIONS = 2.0**64  # of a second, in a time stamp
_LARGEST_WHOLE = 2.0**53  # from here on a float can't tell each whole number from the next


@final
@FORMATS.member("tdms")
@dataclass(frozen=True, kw_only=True)
class Tdms:
    """TDMS files: a recording for each group, of its channels of numbers and time stamps, scaled as their properties say.

    An index file (`.tdms_index`) beside the file isn't needed, and isn't read.
    """

    suffixes: ClassVar[tuple[str, ...]] = (".tdms",)

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
            with _told_as_format_error(path.name):
                file = nptdms.TdmsFile.open(data, raw_timestamps=True)
                _check_sizes(file, len(data.getvalue()))
                groups = {group.name: group.channels() for group in file.groups()}
                ours = file.properties.get(_OURS)
            if isinstance(ours, str) and metadata.SCHEMA in ours:
                return _own(ours, groups, path.name)
            recordings = [_foreign(group, channels, path) for group, channels in groups.items() if channels]
            with _told_as_format_error(path.name):
                cut = file.file_status.incomplete_final_segment
        return _with_something(recordings, cut, path)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write each recording as a group, its times as channels, and all they know as a property of the file."""
        nptdms = library("nptdms", "npTDMS", "labview", path.name)
        described: list[dict[str, Any]] = []
        objects: list[Any] = []
        groups = _names([recording.name for recording in recordings])
        for recording, group in zip(recordings, groups, strict=True):
            channels, samples = _channels_to_write(recording)
            described.append({"recording": metadata.described(recording), "group": group, "samples": samples})
            objects.append(nptdms.GroupObject(group))
            objects.extend(
                nptdms.ChannelObject(group, each.heading.name, each.values, _unit_property(each.heading.unit))
                for each in channels
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


@contextmanager
def _told_as_format_error(name: str) -> Iterator[None]:
    """Around calls of npTDMS and nothing else: it tells of damage by whatever error it runs into."""
    try:
        yield
    except FormatError:
        raise
    except Exception as error:
        said = str(error) or type(error).__name__
        raise FormatError(f"{name} is no TDMS file, or a damaged one: {said[:200]}") from error


def _check_sizes(file: Any, size: int) -> None:
    """Raise `ValueError` where a file of `size` bytes says that it has more than it can have."""
    total = 0
    for path, known in (("the file", file), *((each.path, each) for each in file.groups())):
        _check_scales(path, known.properties)
    for channel in (channel for group in file.groups() for channel in group.channels()):
        _check_scales(channel.path, channel.properties)
        width = getattr(channel.data_type, "size", None) or 1
        # The scalers of DAQmx may take several channels out of the same bytes.
        if not 0 <= len(channel) * width <= max(size, 0):
            raise ValueError(
                f"{channel.path} says that it has {len(channel)} values, in a file of {size} bytes"
            )
        total += len(channel)
    if 8 * total > MOST_BYTES:
        raise ValueError(f"it has {total} values; more than {MOST_BYTES // 8} aren't read")


def _check_scales(path: str, properties: Any) -> None:
    for key, value in properties.items():
        counts = key == "NI_Number_Of_Scales" or (key.startswith("NI_Scale[") and key.endswith("_Size"))
        if counts and not (isinstance(value, int | np.integer) and 0 <= value <= _MOST_SCALES):
            raise ValueError(f"the property {key} of {path} is {value!r}; expected 0 to {_MOST_SCALES}")


def _with_something(recordings: Sequence[Recording | str], cut: bool, path: Path) -> tuple[Recording, ...]:
    """The recordings, told that the last segment is cut short; raises `FormatError` where there are only sentences."""
    found = [each for each in recordings if isinstance(each, Recording)]
    if not found:
        why = (
            "; ".join(each for each in recordings if isinstance(each, str))
            or "it has no groups with channels"
        )
        raise FormatError(f"{path.name} has no channels of numbers: {why}")
    if len(found) == 1:
        found = [replace(found[0], name=path.stem)]
    if cut:
        sentence = "The file ends before its last segment does; it is read as far as it goes."
        found = [each.with_findings(info("recording-cut-short", sentence)) for each in found]
    return tuple(found)


def _foreign(group: str, channels: Sequence[Any], path: Path) -> Recording | str:
    """The recording that a group is, or the sentence that says why it is none."""
    if len(channels) > LARGEST_TABLE:
        raise FormatError(
            f"{path.name}: group {group!r} has {len(channels)} channels; more than {LARGEST_TABLE} are no recording"
        )
    zero = _zero(channels, path.name)
    columns: list[Column] = []
    skipped: list[str] = []
    findings: list[Finding] = []
    for channel in channels:
        found = _column(channel, zero, path.name)
        if isinstance(found, Column) and isinstance(unit := channel.properties.get("unit_string"), str):
            head, told = with_unit(found.heading, unit)
            found = found if found.is_time else replace(found, heading=head)
            findings.extend(told)
        if isinstance(found, str):
            skipped.append(f"{channel.name} ({found})")
        else:
            columns.append(found)
    if not columns:
        return f"group {quoted([group])} has {quoted(skipped)}"
    if skipped:
        findings.append(
            info("channel-skipped", f"Channels that aren't numbers aren't read: {quoted(skipped)}.")
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
    with _told_as_format_error(name):
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
            with _told_as_format_error(name):
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
    """What is to be known of whole numbers that a float can't tell from the next."""
    whole = {
        heading(each.name).name
        for each in channels
        if getattr(each.data_type, "__name__", "") in {"Int64", "Uint64"}
    }
    large = [
        each.heading.name
        for each in columns
        if each.heading.name in whole and np.abs(each.values).max() >= _LARGEST_WHOLE
    ]
    if not large:
        return []
    sentence = f"Whole numbers too large to be kept to the last digit: {quoted(large)}."
    return [info("integer-rounded", sentence)]


def _about_waveforms(columns: Sequence[Column], channels: Sequence[Any]) -> list[Finding]:
    waveforms = [column.heading.name for column in columns if column.t is not None]
    if not waveforms:
        return []
    sentence = f"Times come from the start and increment of the waveforms {quoted(waveforms)}"
    stamps = [_stamp(channel.properties.get("wf_start_time")) for channel in channels]
    starts = [each for each in stamps if each is not None]
    if len(set(starts)) > 1:
        sentence += f"; their starts differ by up to {(max(starts) - min(starts)) / _FRACTIONS:.4g} s"
    return [info("waveform-times", f"{sentence}.")]


def _names(names: Sequence[str]) -> tuple[str, ...]:
    """Names that differ, as TDMS can hold them: without what UTF-8 doesn't have."""
    plain, _ = distinct([name.encode("utf-8", "replace").decode("utf-8") for name in names])
    return plain


def _unit_property(unit: str | None) -> dict[str, str]:
    return {} if unit is None else {"unit_string": unit.encode("utf-8", "replace").decode("utf-8")}


def _channels_to_write(recording: Recording) -> tuple[list[Column], list[list[str | None]]]:
    """The channels of a group, times first seen first, and for each series the names of its values and its times."""
    series = recording.series
    times: dict[bytes, int] = {}
    for each in series:
        if each.t is not None:
            times.setdefault(each.t.tobytes(), len(times))
    labels = [f"t_{k + 1}" if k else "t" for k in range(len(times))]
    names = _names([*labels, *(each.channel.name for each in series)])
    values: dict[str, tuple[Array, str | None]] = {
        names[k]: (np.frombuffer(content), "s") for content, k in times.items()
    }
    samples: list[list[str | None]] = []
    for name, each in zip(names[len(times) :], series, strict=True):
        values[name] = (each.values, each.channel.unit)
        samples.append([name, None if each.t is None else names[times[each.t.tobytes()]]])
    columns = [
        Column(heading=Heading(name=name, unit=unit), values=content)
        for name, (content, unit) in values.items()
    ]
    return columns, samples


def _own(text: str, groups: dict[str, Sequence[Any]], name: str) -> tuple[Recording, ...]:
    """The recordings in a file of ours; raises `FormatError` where they aren't what its property says."""
    described = metadata.from_text(text, name)
    recordings = []
    try:
        for one in described["recordings"]:
            channels = {channel.name: channel for channel in groups[one["group"]]}
            samples = [
                (_values(channels[values], name), None if times is None else _values(channels[times], name))
                for values, times in one["samples"]
            ]
            recordings.append(metadata.restored(one["recording"], samples, name))
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(
            f"{name}: what its property `{_OURS}` says of its channels isn't so ({error!r})"
        ) from None
    return tuple(recordings)


def _values(channel: Any, name: str) -> Array:
    with _told_as_format_error(name):
        values = channel[:]
    if values.dtype.kind != "f":
        raise ValueError(f"{channel.name!r} has values of type {values.dtype}")
    return np.array(values, dtype=np.float64)
