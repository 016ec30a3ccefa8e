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
from servobench.recordings.formats.times import GAP
from servobench.recordings.recording import Recording, Series

NONE = "none"
STATES = frozenset({"quasistatic-forward", "quasistatic-reverse", "dynamic-forward", "dynamic-reverse", NONE})
"""What such a text can say."""

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


def tests(states: Sequence[States]) -> tuple[Test, ...]:
    """Return the tests in the order of their starts; a name that comes again gets a number.

    Where several texts name tests, those of several mechanisms, the mechanism stands before a test's name.
    """
    runs = [run for each in states for run in _runs(each, len(states) > 1)]
    runs.sort(key=lambda run: run.start)
    seen: Counter[str] = Counter()
    named = []
    for run in runs:
        seen[run.name] += 1
        free = max((other.end for other in runs if other.end <= run.start), default=-np.inf)
        name = run.name if seen[run.name] == 1 else f"{run.name} {seen[run.name]}"
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


def split(recording: Recording, found: Sequence[Test], texts: Sequence[str]) -> tuple[Recording, ...]:
    """Return a recording for each test, with the channels that have samples in it; `texts` are the names of what named them."""
    sentence = (
        f"The log is split by {quote(texts)} into its tests: {quote(test.name for test in found)}. The rest isn't "
        "read."
    )
    told = info("log-split", sentence)
    parts = (_part(recording, test, told) for test in found)
    return tuple(part for part in parts if part.series)


def _part(recording: Recording, test: Test, told: Finding) -> Recording:
    series, held = [], []
    for each in recording.series:
        within, holds = _within(each, test)
        if len(within.values):
            series.append(within)
        if holds:
            held.append(each.channel.name)
    findings = [*recording.findings, told]
    if held:
        sentence = (
            f"At the start of the test {quote(held)} had the value logged last before it, which is used as the "
            "first sample: a value holds until the next one."
        )
        findings.append(info("value-held", sentence))
    return replace(recording, name=test.name, series=tuple(series), findings=tuple(findings))


def _within(series: Series, test: Test) -> tuple[Series, bool]:
    """The samples of a channel in a test, and whether the first is one that was noted before and still held at the start.

    A channel that goes on at its usual steps needs no such sample. One that was last noted within the test before, or earlier,
    mustn't have it: SysId's own entries are silent between tests, and what stands there last is not what was there next.
    """
    t = series.t if series.t is not None else np.empty(0)
    begin, end = np.searchsorted(t, [test.start, test.end])
    inside = t[begin:end]
    within = replace(series, values=series.values[begin:end], t=inside)
    if begin == 0 or t[begin - 1] < test.free or (begin < len(t) and t[begin] == test.start):
        return within, False
    steps = np.diff(inside)
    usual = float(np.median(steps)) if len(steps) else 0.0
    following = t[begin] if begin < end else test.end
    if following - t[begin - 1] <= GAP * usual:
        return within, False
    values = np.concatenate([[series.values[begin - 1]], within.values])
    return replace(series, values=values, t=np.concatenate([[test.start], inside])), True
