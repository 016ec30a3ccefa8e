"""The times of samples: their steps, their problems, and which samples can be used."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Finding, info

GAP = 2.5
"""A step of more than this many median steps is a gap: at least two samples are missing."""

UNEVEN = 0.05
"""Steps are uneven where the 1st and the 99th percentile lie further apart than this share of the median."""


_OUT_OF_ORDER = 0.1  # of the rows
_EVEN = 0.5  # of the median step, by which the steps of a busy logger's clock differ from it
_MOSTLY = 0.9  # of the steps; of numbers that differ by chance fewer are even
_DIGITS = 7  # of a mean step: clocks are off by more than a millionth
_LONGEST = float(np.finfo(np.float64).max) / 4


@dataclass(frozen=True, kw_only=True)
class TimeBase:
    """Statistics of the times of a channel with `samples` samples, `non_finite` of them not finite.

    `start`, `end` and the steps are in s; `shortest_step`, `median_step`, `p99_step` (99 % are no longer) and `longest_step`
    are those that go forward, None where there are none. `backward` counts the steps that go back, `duplicates` those of zero,
    `gaps` those longer than `GAP` median steps.
    """

    samples: int
    non_finite: int
    start: float | None
    end: float | None
    shortest_step: float | None
    median_step: float | None
    p99_step: float | None
    longest_step: float | None
    gaps: int
    duplicates: int
    backward: int


def time_base(t: Array) -> TimeBase:
    """Return what times t (N,) [s] are like."""
    finite = t[np.isfinite(t)]
    steps = _steps(finite)
    forward = steps[steps > 0]
    some = len(forward) > 0
    median = float(np.median(forward)) if some else None
    return TimeBase(
        samples=len(t),
        non_finite=len(t) - len(finite),
        start=float(finite[0]) if len(finite) else None,
        end=float(finite[-1]) if len(finite) else None,
        shortest_step=float(forward.min()) if some else None,
        median_step=median,
        p99_step=float(np.percentile(forward, 99)) if some else None,
        longest_step=float(forward.max()) if some else None,
        gaps=int(np.count_nonzero(forward > GAP * median)) if median is not None else 0,
        duplicates=int(np.count_nonzero(steps == 0)),
        backward=int(np.count_nonzero(steps < 0)),
    )


@dataclass(frozen=True, kw_only=True)
class MeanStep:
    """The mean `step` [s] of times, which the rounding of the times leaves uncertain by `resolution` [s]."""

    step: float
    resolution: float

    @property
    def figure(self) -> float:
        """The step [s] with as few digits as the resolution allows: 0.1 where it is 0.1003 s, uncertain by 0.0025 s."""
        figures = (float(f"{self.step:.{digits}g}") for digits in range(1, _DIGITS))
        return next((each for each in figures if abs(each - self.step) <= self.resolution), self.step)


def mean_step(t: Array) -> MeanStep | None:
    """Return the mean step of times t (N,) [s] that may be rounded, repeats included; None where they never grow.

    Steps back are left out, and so is a pause of more than half the recording.
    """
    steps = _steps(t[np.isfinite(t)])
    steps = steps[steps >= 0]
    with np.errstate(over="ignore"):
        steps = steps[steps <= 0.5 * steps.sum()]
    if not (steps > 0).any():
        return None
    # The ends are rounded to a whole number of the smallest step at best.
    return MeanStep(step=float(steps.mean()), resolution=float(steps[steps > 0].min()) / len(steps))


def time_findings(t: Array, rows: NDArray[np.int64] | None = None) -> tuple[Finding, ...]:
    """Return what is wrong with times t (N,) [s], one finding for each kind.

    `rows` (N,) are the rows of the file that they stand in; without them they are counted from 1.
    """
    if rows is None:
        rows = np.arange(1, len(t) + 1)
    findings = []
    broken = ~np.isfinite(t)
    if broken.any():
        findings.append(_finding("time-not-finite", "No finite time", rows[broken]))
    t, rows = t[~broken], rows[~broken]
    steps, later = _steps(t), rows[1:]
    if (steps == 0).any():
        findings.append(_finding("time-duplicate", "The same time as in the row before", later[steps == 0]))
    if (steps < 0).any():
        findings.append(
            _finding("time-not-increasing", "An earlier time than in the row before", later[steps < 0])
        )
    return (*findings, *_about_steps(steps, later))


def _steps(t: Array) -> Array:
    """The steps between finite times; one too long for a float, as only a damaged file has it, is as long as can be averaged."""
    with np.errstate(over="ignore"):
        return np.clip(np.diff(t), -_LONGEST, _LONGEST)


def _about_steps(steps: Array, later: NDArray[np.int64]) -> list[Finding]:
    """Gaps and uneven steps; `later` are the rows at the end of each step."""
    forward = steps[steps > 0]
    if len(forward) < 2:
        return []
    findings = []
    median = float(np.median(forward))
    gaps = steps > GAP * median
    if gaps.any():
        what = f"A gap of up to {steps.max():.4g} s, where the median step is {median:.4g} s, before"
        findings.append(_finding("time-gap", what, later[gaps], preposition=""))
    low, high = np.percentile(forward, [1, 99])
    if high - low > UNEVEN * median:
        sentence = f"The sample time isn't even: its median is {median:.4g} s, 98 % of the steps lie between "
        findings.append(info("time-uneven", sentence + f"{low:.4g} s and {high:.4g} s."))
    return findings


def _finding(code: str, what: str, rows: NDArray[np.int64], preposition: str = " in") -> Finding:
    return info(code, f"{what}{preposition} {in_words(rows)}.", rows=(int(rows[0]), int(rows[-1])))


def in_words(rows: NDArray[np.int64], noun: str = "row") -> str:
    """Return rows (N,) in words: `row 7`, `rows 7 to 9` or `12 rows from 7 to 90`; or samples, or what the noun says."""
    first, last = int(rows[0]), int(rows[-1])
    if len(rows) == 1:
        return f"{noun} {first}"
    if last - first == len(rows) - 1:
        return f"{noun}s {first} to {last}"
    return f"{len(rows)} {noun}s from {first} to {last}"


def is_out_of_order(t: Array) -> bool:
    """Return whether times t (N,) [s] go back so often that the rows are out of order, and not of several runs."""
    return bool(np.sum(np.diff(t) < 0) > _OUT_OF_ORDER * len(t))


def sorts_evenly(t: Array) -> bool:
    """Return whether finite times t (N,) [s] are evenly spaced once they are sorted, as those of shuffled rows are."""
    steps = _steps(np.sort(t))
    median = float(np.median(steps)) if len(steps) else 0.0
    return median > 0 and bool(np.mean(np.abs(steps - median) <= _EVEN * median) > _MOSTLY)


def keep_increasing(t: Array) -> NDArray[np.bool_]:
    """Return which samples (N,) to keep so that their times t [s] increase everywhere and as many as possible stay.

    Of equal times one after the other the first stays. Beyond that the samples kept are a longest increasing subsequence
    (Schensted 1961), so that a single wild time costs one sample and not all that come after it.
    """
    keep = np.isfinite(t)
    indices = np.flatnonzero(keep)
    keep[indices[1:][_steps(t[indices]) == 0]] = False
    indices = np.flatnonzero(keep)
    if (_steps(t[indices]) > 0).all():
        return keep
    chosen = _longest_increasing(t[indices].tolist())
    keep[:] = False
    keep[indices[chosen]] = True
    return keep


def _longest_increasing(values: list[float]) -> list[int]:
    """The indices of a longest strictly increasing subsequence, by patience sorting."""
    tails: list[float] = []
    tail_at: list[int] = []
    before = [-1] * len(values)
    for k, value in enumerate(values):
        place = bisect_left(tails, value)
        if place:
            before[k] = tail_at[place - 1]
        if place == len(tails):
            tails.append(value)
            tail_at.append(k)
        elif value < tails[place]:
            tails[place], tail_at[place] = value, k
    chosen = []
    k = tail_at[-1] if tail_at else -1
    while k >= 0:
        chosen.append(k)
        k = before[k]
    return chosen[::-1]
