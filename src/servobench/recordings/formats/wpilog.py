"""WPILib's data log (.wpilog), in which each signal has its own times and a value holds until the next."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, final

import numpy as np

from servobench.core.channels import Array, Channel
from servobench.core.errors import FormatError, UsageError
from servobench.core.finding import Finding, info, warning
from servobench.core.parameter_names import plain_words
from servobench.core.units import is_unit
from servobench.recordings.formats import datalog
from servobench.recordings.formats.base import FORMATS
from servobench.recordings.formats.columns import LARGEST_TABLE, LARGEST_WHOLE, distinct, heading, quote
from servobench.recordings.formats.datalog import NUMBERS, Entry, Log
from servobench.recordings.formats.sysid_tests import STATES, States, split, tests
from servobench.recordings.formats.times import GAP
from servobench.recordings.recording import Recording, Series, Source

_MOST_CHANNELS = 100  # of one entry that is a list
_MANY = 0.05  # of the steps that are gaps, from which on they aren't pauses between tests
_FEWEST = 10  # samples that it takes to say how a channel was noted


@final
@FORMATS.member("wpilog")
@dataclass(frozen=True, kw_only=True)
class WpiLog:
    """WPILib data logs. Each entry of numbers is a channel with its own times; a log of SysId is a recording for each test."""

    suffixes: ClassVar[tuple[str, ...]] = (".wpilog",)
    written: ClassVar[tuple[str, ...]] = ()
    by_library: ClassVar[bool] = False

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file begins like a data log."""
        return head.startswith(datalog.MAGIC)

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recording in a log, or one for each test of SysId in it; raises `FormatError`."""
        log = datalog.read(path)
        return _foreign(log, path)

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Raise `UsageError`: no other program than WPILib's makes them."""
        raise UsageError(
            f"{path.name}: data logs of WPILib aren't written; end the name in .csv, .mat or .mcap"
        )


def _foreign(log: Log, path: Path) -> tuple[Recording, ...]:
    entries, join_findings = _join(log.entries)
    channels: list[_Channel] = []
    skipped: list[str] = []
    states: list[States] = []
    for entry in entries:
        entry_channels = list(_channels(log, entry))
        channels.extend(entry_channels)
        if (named := _states(log, entry)) is not None:
            states.append(named)
        elif not entry_channels:
            skipped.append(f"{entry.name} ({entry.type if len(entry.stamps) else 'no value'})")
    if not channels:
        raise FormatError(
            f"{path.name} is a data log without an entry of numbers; it has {quote(skipped) or 'none'}"
        )
    if len(channels) > LARGEST_TABLE:
        raise FormatError(
            f"{path.name} has {len(channels)} channels; more than {LARGEST_TABLE} aren't read: extract the part that you need"
        )
    names, renamed = distinct([each.name for each in channels])
    findings = [*join_findings, *renamed, *_about_file(log, skipped), *_about_channels(channels)]
    series = tuple(
        Series(channel=Channel(name=name, unit=each.unit), values=each.values, t=each.t)
        for name, each in zip(names, channels, strict=True)
    )
    source = Source(name=path.name, format="wpilog")
    whole = Recording(name=path.stem, series=series, source=source, findings=tuple(findings))
    found_tests = tests(states)
    return split(whole, found_tests, [each.name for each in states]) or (whole,)


def _join(entries: Sequence[Entry]) -> tuple[list[Entry], list[Finding]]:
    """The entries, those that go on under the same name and type after they were finished as one."""
    by_name: dict[tuple[str, str], list[Entry]] = {}
    continued: dict[str, None] = {}
    for entry in entries:
        alike = by_name.setdefault((entry.name, entry.type), [])
        before = next((k for k, each in enumerate(alike) if each.last <= entry.first), None)
        if before is None:
            alike.append(entry)
            continue
        continued[entry.name] = None
        first = alike[before]
        alike[before] = Entry(
            name=entry.name,
            type=entry.type,
            metadata=entry.metadata or first.metadata,
            stamps=np.concatenate([first.stamps, entry.stamps]),
            places=np.concatenate([first.places, entry.places]),
            sizes=np.concatenate([first.sizes, entry.sizes]),
            first=first.first,
            last=entry.last,
        )
    joined = sorted((each for alike in by_name.values() for each in alike), key=lambda each: each.first)
    if not continued:
        return joined, []
    sentence = (
        f"Entries that were finished and started again are read as one channel each: {quote(continued)}."
    )
    return joined, [info("entry-continued", sentence)]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Channel:
    """A channel before it has a name of its own, with what is to be known of it.

    `back` counts the samples whose stamps were earlier than one before, `odd` those without the size of the type. `rounded` says
    that some are whole numbers too large for a float.
    """

    name: str
    unit: str | None
    from_name: bool
    values: Array
    t: Array
    back: int
    odd: int
    rounded: bool


def _channels(log: Log, entry: Entry) -> Iterator[_Channel]:
    """The channels that an entry is: none if it is no number, one, or as many as its lists have places."""
    plain = entry.type.removesuffix("[]")
    dtype = NUMBERS.get(plain)
    if dtype is None or not len(entry.stamps):
        return
    size, width = np.dtype(dtype).itemsize, 1
    if plain != entry.type:
        sizes, counts = np.unique(entry.sizes, return_counts=True)
        width = int(sizes[np.argmax(counts)]) // size
        if not 1 <= width <= _MOST_CHANNELS:
            return
    fitting = entry.at(np.flatnonzero(entry.sizes == size * width))
    odd = len(entry.stamps) - len(fitting.stamps)
    if not len(fitting.stamps):
        return
    stamps = fitting.stamps
    back = int(np.count_nonzero(stamps < np.maximum.accumulate(stamps)))
    if back:
        fitting = fitting.at(np.argsort(stamps, kind="stable"))
    table = log.numbers(fitting, dtype, width).astype(np.float64)
    rounded = plain == "int64" and float(np.abs(table).max()) >= LARGEST_WHOLE
    t = fitting.stamps / 1e6
    unit, from_name = _unit(entry)
    for k in range(width):
        name = f"{entry.name}_{k + 1}" if plain != entry.type else entry.name
        values = np.ascontiguousarray(table[:, k])
        yield _Channel(
            name=name, unit=unit, from_name=from_name, values=values, t=t, back=back, odd=odd, rounded=rounded
        )


def _unit(entry: Entry) -> tuple[str | None, bool]:
    """The unit of an entry, as the text about it says (SysId's do) or else an ending of its name; and whether the latter."""
    metadata: Any = entry.metadata
    if metadata.startswith("{"):
        try:
            content = json.loads(metadata)
        except (ValueError, RecursionError):
            content = {}
        metadata = content.get("unit", content.get("units"))
    if isinstance(metadata, str) and metadata.strip():
        in_words = plain_words(metadata.strip().lower()).replace(" per ", "/")
        for symbol in (metadata.strip(), in_words):
            if is_unit(symbol):
                return symbol, False
    head = heading(entry.name.rpartition("/")[2])
    return (head.unit, True) if head.from_name else (None, False)


def _states(log: Log, entry: Entry) -> States | None:
    """The entry as one that names tests of SysId, if that is all that it says."""
    longest = max(map(len, STATES))
    if entry.type != "string" or not len(entry.stamps) or entry.sizes.max() > longest:
        return None
    entry = entry.at(np.argsort(entry.stamps, kind="stable"))
    values = log.texts(entry)
    if not STATES.issuperset(values) or set(values) == {"none"}:
        return None
    return States(name=entry.name, t=entry.stamps / 1e6, values=values)


def _about_file(log: Log, skipped: Sequence[str]) -> list[Finding]:
    findings = []
    if log.damage:
        sentence = f"The log is cut short or damaged: it ends {log.damage}; what came before is read."
        findings.append(warning("recording-cut-short", sentence))
    if log.unknown:
        sentence = f"{log.unknown} records belong to no started entry and are left out."
        findings.append(warning("record-unknown", sentence))
    if skipped:
        findings.append(info("entry-skipped", f"Entries that aren't numbers aren't read: {quote(skipped)}."))
    return findings


def _about_channels(channels: Sequence[_Channel]) -> list[Finding]:
    """Findings on the channels' values and times, one for several channels with the same."""
    sentences = {
        "time-sorted": (
            [f"{each.name} ({each.back})" for each in channels if each.back],
            "Samples with an earlier stamp than one before were sorted by time: {}.",
        ),
        "time-negative": (
            [each.name for each in channels if each.t[0] < 0],
            "Some stamps are negative, from before the clock's zero, and are kept: {}.",
        ),
        "payload-odd": (
            [f"{each.name} ({each.odd})" for each in channels if each.odd],
            "Samples that don't match their entry's type or list length are left out: {}.",
        ),
        "integer-rounded": (
            [each.name for each in channels if each.rounded],
            "Values too large for a float to keep each whole number: {}.",
        ),
        "unit-in-name": (
            [f"{each.name} in {each.unit}" for each in channels if each.from_name],
            "The endings of names give units: {}.",
        ),
        "values-on-change": (
            [each.name for each in channels if _only_changes(each)],
            "Logged on change, not at even times, so a value holds until the next one and a gap isn't missing "
            "data: {}. Each channel keeps its own times.",
        ),
    }
    return [
        info(code, sentence.format(quote(names))) for code, (names, sentence) in sentences.items() if names
    ]


def _only_changes(channel: _Channel) -> bool:
    """Whether a channel never has the same value twice in a row, and gaps in more than the few places where a log may pause."""
    steps = np.diff(channel.t)
    forward = steps[steps > 0]
    if len(channel.values) < _FEWEST or not len(forward):
        return False
    changed = channel.values[1:] != channel.values[:-1]
    return bool(changed.all() and np.mean(steps > GAP * np.median(forward)) > _MANY)
