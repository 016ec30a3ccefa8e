"""The tests of WPILib's SysId in a log: a text that names the test under way splits the log.

Source: WPILib, docs.wpilib.org, "Creating an Identification Routine"; SysIdRoutineLog writes the state once in each loop of a
test, after that loop's measurements, and `none` at the end.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info
from servobench.recordings.formats.columns import quote
from servobench.recordings.formats.roles import quantity_of
from servobench.recordings.formats.times import GAP
from servobench.recordings.recording import Recording, Series

NONE = "none"
STATES = frozenset({"quasistatic-forward", "quasistatic-reverse", "dynamic-forward", "dynamic-reverse", NONE})
"""The entries of such a text."""

AT_REST = "The test began at rest, as SysId requires, and its first speed is almost 0: the fit begins there, with zero input."
"""The finding for a test that `begins_at_rest`."""
_SAME_LOOP = 0.5  # of the time between two loops
_SLOW = 0.01  # of the largest speed in a test: one that turns at first turns faster

_NAMES = {
    "voltage": ("voltage-",),
    "position": ("position-", "angle-"),
    "speed": ("velocity-", "angular-velocity-"),
}
_PREFIX = "sysid-test-state"


@dataclass(frozen=True, kw_only=True)
class States:
    """A text in a log that says which test is under way: its `name` in the log, its times t (N,) [s], sorted, and its values."""

    name: str
    t: Array
    values: Sequence[str]


@dataclass(frozen=True, kw_only=True)
class Test:
    """A test, its `name`, from `start` until before `end` [s]; in the time from `free` on no other was under way before it."""

    name: str
    start: float
    end: float
    free: float


def begins_at_rest(speed: Array) -> bool:
    """Return whether a test with a speed (N,), in any unit, begins with a shaft that rests, as its routine asks for."""
    magnitudes = np.abs(speed[np.isfinite(speed)])
    return bool(len(magnitudes) and magnitudes[0] <= _SLOW * magnitudes.max())


def tests(states: Sequence[States]) -> tuple[Test, ...]:
    """Return the tests in the order of their starts; a name that comes again gets a number.

    Where several texts name tests, those of several mechanisms, the mechanism stands before a test's name.
    """
    runs = [run for each in states for run in _runs(each, len(states) > 1)]
    runs.sort(key=lambda run: run.start)
    counts: Counter[str] = Counter()
    named = []
    for run in runs:
        counts[run.name] += 1
        free = max((other.end for other in runs if other.end <= run.start), default=-np.inf)
        name = run.name if counts[run.name] == 1 else f"{run.name} {counts[run.name]}"
        named.append(replace(run, name=name, free=free))
    return tuple(named)


def _runs(states: States, with_mechanism: bool) -> list[Test]:
    """The stretches in which the text says the same, without those in which it says that there's no test."""
    mechanism = states.name.rpartition("/")[2].removeprefix(_PREFIX).strip("-_ ")
    before = f"{mechanism} " if with_mechanism and mechanism else ""
    values = np.array(states.values)
    begins = np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]]))
    ends = [*states.t[begins[1:]].tolist(), np.inf]
    return [
        Test(name=before + states.values[k], start=float(states.t[k]), end=end, free=-np.inf)
        for k, end in zip(begins.tolist(), ends, strict=True)
        if states.values[k] != NONE
    ]


def split(recording: Recording, sections: Sequence[Test], texts: Sequence[str]) -> tuple[Recording, ...]:
    """Return a recording for each test, with the channels that have samples in it; `texts` are the names of what named them."""
    sentence = (
        f"The log is split by {quote(texts)} into its tests: {quote(test.name for test in sections)}. The rest isn't "
        "read."
    )
    finding = info("log-split", sentence)
    parts = (_part(recording, test, finding) for test in sections)
    return tuple(part for part in parts if part.series)


def _part(recording: Recording, test: Test, finding: Finding) -> Recording:
    series, held = [], []
    for each in recording.series:
        within, holds = _within(each, test)
        if len(within.values):
            series.append(within)
        if holds:
            held.append(each.channel.name)
    findings = [*recording.findings, finding]
    if held:
        sentence = (
            f"At the start of the test {quote(held)} had the value logged last before it, which is used as the "
            "first sample: a value holds until the next one."
        )
        findings.append(info("value-held", sentence))
    at_rest = [begins_at_rest(each.values) for each in _entries_of(series, "speed")]
    if at_rest and all(at_rest):
        findings.append(info("starts-at-rest", AT_REST))
    return replace(
        recording,
        name=test.name,
        series=tuple(series),
        input=_the_only(_entries_of(series, "voltage")),
        output=_the_only(_entries_of(series, "position")),
        starts_at_rest=bool(at_rest) and all(at_rest),
        findings=tuple(findings),
    )


def _entries_of(series: Sequence[Series], quantity: str) -> list[Series]:
    """The channels of SysId's own entries that measure something: a name is `voltage-motor-mechanism`."""
    return [
        each
        for each in series
        if each.channel.name.rpartition("/")[2].startswith(_NAMES[quantity])
        and quantity_of(each.channel.unit) == quantity
    ]


def _the_only(series: Sequence[Series]) -> str | None:
    return series[0].channel.name if len(series) == 1 else None


def _within(series: Series, test: Test) -> tuple[Series, bool]:
    """The samples of a channel in a test, and whether the first is one that was noted before and still held at the start.

    A channel that goes on at its usual steps needs no such sample. One that was last noted within the test before, or earlier,
    mustn't have it: SysId's own entries are silent between tests, and what stands there last is not what was there next.
    The measurements of the first loop come just before the name of its test, and belong to it.
    """
    t = series.t if series.t is not None else np.empty(0)
    begin, end = np.searchsorted(t, [test.start, test.end])
    if begin and test.free <= t[begin - 1] and test.start - t[begin - 1] < _SAME_LOOP * _usual(t[begin:end]):
        begin -= 1
    inside = t[begin:end]
    within = replace(series, values=series.values[begin:end], t=inside)
    if begin == 0 or t[begin - 1] < test.free or (begin < len(t) and t[begin] == test.start):
        return within, False
    usual = _usual(inside)
    following = t[begin] if begin < end else test.end
    if following - t[begin - 1] <= GAP * usual:
        return within, False
    values = np.concatenate([[series.values[begin - 1]], within.values])
    return replace(series, values=values, t=np.concatenate([[test.start], inside])), True


def _usual(t: Array) -> float:
    """The usual time [s] between two of the times t (N,), 0 where there are none."""
    return float(np.median(np.diff(t))) if len(t) > 1 else 0.0
