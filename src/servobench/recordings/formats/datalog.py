"""The records of a WPILib data log: its entries, and where in the file the values of each are.

A log is a list of records, each with an entry's number, a stamp in µs and a payload. Records of entry 0 start an entry (its name,
its type, a text about it), finish it, so that its number may be used again, or change the text.
Source: WPILib Data Log File Format Specification, version 1.0 (allwpilib, wpiutil/doc/datalog.adoc).
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from servobench.core.errors import FormatError

MAGIC = b"WPILOG"
MOST_BYTES = 2**28
"""The most bytes of a log that is read; a match of three minutes takes some tens of millions."""

MOST_ENTRIES = 20_000

NUMBERS = {"double": "<f8", "float": "<f4", "int64": "<i8", "boolean": "u1"}
"""The types that are numbers; with `[]` behind them, lists of such."""

Whole: TypeAlias = NDArray[np.int64]
Bytes: TypeAlias = NDArray[np.uint8]

_HEADER = struct.Struct("<6sHI")
_START, _FINISH, _METADATA = range(3)
_NOT_A_RECORD = 2**62  # longer than any file


@dataclass(frozen=True, kw_only=True, eq=False)
class Entry:
    """A signal in a log, its records in the order of the file: stamps [µs], places and sizes [bytes] of the payloads, all (N,).

    `name`, `type` and `metadata` stand in the file as they are. `first` and `last` number the records of the file between
    which the entry was open.
    """

    name: str
    type: str
    metadata: str
    stamps: Whole
    places: Whole
    sizes: Whole
    first: int
    last: int

    def at(self, which: NDArray[Any]) -> Entry:
        """Return the entry with only those of its records, in that order."""
        return Entry(
            name=self.name,
            type=self.type,
            metadata=self.metadata,
            stamps=self.stamps[which],
            places=self.places[which],
            sizes=self.sizes[which],
            first=self.first,
            last=self.last,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Log:
    """The content of a file: its entries in the order in which they were started, and its bytes, `data`.

    `unknown` counts records of entries that weren't open; `damage` says why the file couldn't be read to its end, if so.
    """

    entries: tuple[Entry, ...]
    data: Bytes
    unknown: int
    damage: str

    def numbers(self, entry: Entry, dtype: str, width: int = 1) -> NDArray[Any]:
        """Return the payloads (N, width) of an entry whose records all have that many numbers of that type."""
        size = np.dtype(dtype).itemsize * width
        if not len(entry.places):
            return np.empty((0, width), dtype)
        payloads = np.ascontiguousarray(sliding_window_view(self.data, size)[entry.places])
        return payloads.view(dtype)

    def texts(self, entry: Entry) -> list[str]:
        """Return the payloads of an entry as texts."""
        spans = zip(entry.places.tolist(), entry.sizes.tolist(), strict=True)
        return [self.data[place : place + size].tobytes().decode("utf-8", "replace") for place, size in spans]


def read(path: Path) -> Log:
    """Return the log in a file; raises `FormatError` where it's none, or larger than is read."""
    if path.stat().st_size > MOST_BYTES:
        raise FormatError(
            f"{path.name} has {path.stat().st_size} bytes; logs of more than {MOST_BYTES} aren't read. Extract the "
            "part with the tests, with WPILib's or another tool"
        )
    data = path.read_bytes()
    if len(data) < _HEADER.size or not data.startswith(MAGIC):
        raise FormatError(f"{path.name} isn't a WPILib data log: its first bytes differ, or it is cut short")
    _, version, length = _HEADER.unpack_from(data)
    if version >> 8 != 1:
        raise FormatError(
            f"{path.name} is a data log of version {version >> 8}.{version & 255}; only version 1 is read"
        )
    begin = _HEADER.size + length
    if begin > len(data):
        raise FormatError(f"{path.name} is a data log that is cut short in its header")
    records, damage = _records(data, begin)
    return _log(records, damage, path.name)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Records:
    """The records of a file (N,): entry numbers, stamps [µs], places and sizes of payloads [bytes]."""

    data: Bytes
    numbers: NDArray[np.uint32]
    stamps: Whole
    places: NDArray[np.uint32]
    sizes: NDArray[np.uint32]


def _layout(bits: int) -> tuple[int, int, int]:
    """The bytes of a record's size, and where its payload begins, by the bits in its first byte."""
    number, size, stamp = (bits & 3) + 1, (bits >> 2 & 3) + 1, (bits >> 4 & 7) + 1
    payload = 1 + number + size + stamp
    return 1 + number, 1 + number + size, payload if bits < 128 else _NOT_A_RECORD


_LAYOUT = [_layout(bits) for bits in range(256)]


def _records(data: bytes, at: int) -> tuple[_Records, str]:
    """The records from a place on, as far as they are whole; and why that isn't to the end of the file."""
    begins, end = array("I"), len(data)
    # Where a record ends is known only once its head is read, so this loop can't be an array's; all else is.
    append, layout, whole = begins.append, _LAYOUT, int.from_bytes
    while at < end:
        size_from, size_to, payload = layout[data[at]]
        following = at + payload + whole(data[at + size_from : at + size_to], "little")
        if following > end:
            break
        append(at)
        at = following
    damage = "" if at >= end else "in the middle of a record" if data[at] < 128 else "in stray bytes"
    raw = np.frombuffer(data, np.uint8)
    places = np.frombuffer(begins, np.uint32) if begins else np.empty(0, np.uint32)
    bits = raw[places]
    number, size, stamp = (bits & 3) + 1, (bits >> 2 & 3) + 1, (bits >> 4 & 7) + 1
    at_size = places + 1 + number
    at_stamp = at_size + size
    records = _Records(
        data=raw,
        numbers=_whole(raw, places + 1, number, 4).astype(np.uint32),
        stamps=_whole(raw, at_stamp, stamp, 8).view(np.int64),
        places=at_stamp + stamp,
        sizes=_whole(raw, at_size, size, 4).astype(np.uint32),
    )
    return records, damage and f"{damage}, {end - at} bytes before its end"


def _whole(raw: Bytes, places: NDArray[np.uint32], widths: NDArray[Any], most: int) -> NDArray[np.uint64]:
    """The whole numbers, of one to `most` bytes each, that begin at some places."""
    numbers = np.zeros(len(places), np.uint64)
    for k in range(most):
        has = np.flatnonzero(widths > k)
        if not len(has):
            break
        numbers[has] |= raw[places[has] + np.uint32(k)].astype(np.uint64) << np.uint64(8 * k)
    return numbers


@dataclass(kw_only=True)
class _Open:
    """An entry that was started, between two records of the file."""

    number: int
    name: str
    type: str
    metadata: str
    first: int
    last: int = field(default=2**62)


def _log(records: _Records, damage: str, name: str) -> Log:
    order = np.argsort(records.numbers, kind="stable")
    sorted_numbers = records.numbers[order]
    of_control = order[: np.searchsorted(sorted_numbers, 1)]
    entries: list[Entry] = []
    taken = 0
    for each in _open_entries(records, of_control, name):
        begin, end = np.searchsorted(sorted_numbers, [each.number, each.number + 1])
        members = order[begin:end]
        members = members[np.searchsorted(members, each.first) : np.searchsorted(members, each.last)]
        taken += len(members)
        entries.append(
            Entry(
                name=each.name,
                type=each.type,
                metadata=each.metadata,
                stamps=records.stamps[members],
                places=records.places[members].astype(np.int64),
                sizes=records.sizes[members].astype(np.int64),
                first=each.first,
                last=each.last,
            )
        )
    unknown = len(order) - len(of_control) - taken
    return Log(entries=tuple(entries), data=records.data, unknown=unknown, damage=damage)


def _open_entries(records: _Records, of_control: NDArray[np.intp], name: str) -> list[_Open]:
    """The entries that control records start, finish and tell of."""
    opened: list[_Open] = []
    now: dict[int, _Open] = {}
    for k in of_control.tolist():
        place = int(records.places[k])
        payload = records.data[place : place + int(records.sizes[k])].tobytes()
        if len(payload) < 5 or (number := int.from_bytes(payload[1:5], "little")) == 0:
            continue
        if payload[0] in (_START, _FINISH) and number in now:
            now.pop(number).last = k
        texts = list(_texts(payload[5:]))
        if payload[0] == _METADATA and number in now and texts:
            now[number].metadata = texts[0]
        if payload[0] == _START and len(texts) >= 2:
            metadata = texts[2] if len(texts) > 2 else ""
            now[number] = _Open(number=number, name=texts[0], type=texts[1], metadata=metadata, first=k)
            opened.append(now[number])
        if len(opened) > MOST_ENTRIES:
            raise FormatError(f"{name} starts more than {MOST_ENTRIES} entries; such logs aren't read")
    return opened


def _texts(payload: bytes) -> Iterator[str]:
    """The texts in a control record, each with its length before it, as far as they are whole."""
    at = 0
    while at + 4 <= len(payload):
        length = int.from_bytes(payload[at : at + 4], "little")
        at += 4 + length
        if at > len(payload):
            return
        yield payload[at - length : at].decode("utf-8", "replace")
