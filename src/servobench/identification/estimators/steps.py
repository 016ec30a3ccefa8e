"""Steps of the input, read as in textbooks: steady values give gain and offset, a rule gives the time constant.

K = Δω/Δu,   u₀ = u - ω/K,   τ by a `Rule` from the part of Δω that is covered at each time after the step

The first two follow from ω = K (u - u₀), which holds in steady state; each rule gives its own source.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset

Rule: TypeAlias = Callable[[Array, Array], float]
"""Time since the step (N,) [s] and the part of the way that is covered (N,) -> time constant [s], NaN where it can't be read."""

TEXTBOOK = "derivative | lowpass 50 rad/s"  # how the paper makes a speed of the encoder's counts
_JUMP = 0.1  # of the input's range, from one sample to the next: what is a step and not a slope
_LONGEST_JUMP = 3  # samples
_HELD = 0.05  # of a step: how near to its level the input stays, but for one sample in twenty
_TAIL = 0.2  # of the time at a level: its end, over which the steady value is averaged
_SETTLED = 5.0  # time constants at a level; e^-5 = 0.7 % of the step is left then
_CLEAR = 5.0  # times the scatter about the steady value: the smallest step of the speed that is read


@dataclass(frozen=True, kw_only=True)
class Step:
    """A jump of the input of one record from a level to another, and how long each level was held [s].

    The level `before` held from `earlier` to `start`, the level `after` from then to `end`; where the record begins with the
    jump, `earlier` is `start`.
    """

    record: int
    earlier: float
    start: float
    end: float
    before: float
    after: float

    @property
    def held(self) -> float:
        """The shorter of the times [s] that the two levels were held; a step at the very start comes after a long rest."""
        now = self.end - self.start
        return now if self.earlier == self.start else min(now, self.start - self.earlier)

    def samples(self, t: Array) -> slice:
        """Return which samples at times t (N,) [s] show the step, that at its start included."""
        return _between(t, self.start, self.end)

    def steady(self, t: Array, speed: Array) -> tuple[Array, Array]:
        """Return the speeds, of those (N,) at t (N,) [s], in the last part of the time at the level before, and at that after."""
        ends = []
        for begin, end in ((self.earlier, self.start), (self.start, self.end)):
            part = speed[_between(t, end - _TAIL * (end - begin), end)]
            ends.append(part if len(part) else speed[: self.samples(t).start + 1][-1:])
        return ends[0], ends[1]


@dataclass(frozen=True, kw_only=True, eq=False)
class Readings:
    """The n steps that could be read, and those that were left out, each with why.

    `values` (n, 3) are what each one gave: gain, time constant [s], lost input.
    """

    steps: tuple[Step, ...]
    values: Array
    left_out: tuple[tuple[Step, str], ...]

    @property
    def mean(self) -> Array:
        """The mean over the steps (3,)."""
        return np.asarray(self.values.mean(axis=0), dtype=np.float64)

    @property
    def through_standstill(self) -> bool:
        """Whether the steps begin, end or pass at rest, so that nothing tells what friction takes."""
        return bool(np.isnan(self.values[:, 2]).any())


def input_steps(data: Dataset, record: int = 0) -> list[Step]:
    """Return the steps of a record's input: jumps of more than a tenth of its range between levels that it then holds."""
    levels = np.append(data.input_before, data.u)
    jumps = np.flatnonzero(np.abs(np.diff(levels)) > _JUMP * max(float(np.ptp(levels)), 1e-300))
    # A jump that takes two or three samples, as behind an average, is one.
    first = jumps[np.diff(jumps, prepend=-2) > 1]
    last = jumps[np.diff(jumps, append=len(levels) + 1) > 1]
    begins, ends = np.append(0, last), np.append(first, len(data.u))
    times = np.append(data.t_input, max(data.t_output[-1], data.t_input[-1]))
    held = [
        data.u[a:b] if b > a else np.array([data.input_before]) for a, b in zip(begins, ends, strict=True)
    ]
    level = [float(np.median(each)) for each in held]
    steps = []
    for n in range(1, len(held)):
        size = abs(level[n] - level[n - 1])
        spread = max(float(np.percentile(np.abs(held[k] - level[k]), 95)) for k in (n - 1, n))
        if spread <= _HELD * size and last[n - 1] - first[n - 1] < _LONGEST_JUMP:
            start = float(times[first[n - 1]])
            steps.append(
                Step(
                    record=record,
                    earlier=float(times[begins[n - 1]]) if first[n - 1] else start,
                    start=start,
                    end=float(times[ends[n]]),
                    before=level[n - 1],
                    after=level[n],
                )
            )
    return steps


def textbook_speed(y: Array, data: Dataset) -> Array:
    """Return output y (M,) of a record as a speed (M,): as it stands, or a position differenced and put through 50/(s + 50)."""
    return y if data.kind == "speed" else Chain.parse(TEXTBOOK)(y, data.t_output)


def time_at(t: Array, part: Array, level: float) -> float:
    """Return when a part of the way (N,) passes a level, by straight lines between samples at t (N,) [s]; NaN where it doesn't.

    Where noise makes it pass several times, the median of these times.
    """
    above = part >= level
    k = np.flatnonzero(above[1:] != above[:-1])
    if not len(k):
        return float("nan")
    return float(np.median(t[k] + (level - part[k]) / (part[k + 1] - part[k]) * (t[k + 1] - t[k])))


def read_step(step: Step, t: Array, speed: Array, rule: Rule) -> Array:
    """Return gain, time constant [s] and lost input (3,) that one step of a speed (N,) at times t (N,) [s] shows."""
    first, last = (float(part.mean()) for part in step.steady(t, speed))
    if step.after == step.before or last == first:  # levels that differ by rounding only
        return np.full(3, np.nan)
    gain = (last - first) / (step.after - step.before)
    here = step.samples(t)
    return np.array(
        [gain, rule(t[here] - step.start, (speed[here] - first) / (last - first)), step.after - last / gain]
    )


def read_steps(data: Sequence[Dataset], rule: Rule) -> Readings:
    """Return what the settled steps of all records show.

    Steps between two speeds in the same direction are taken by preference; with none of them, those that begin, pass or end at
    rest, where the lost input is NaN. Raises `NotIdentifiable` where there are no steps, or none settles.
    """
    steps = [step for n, record in enumerate(data) for step in input_steps(record, n)]
    if not steps:
        raise NotIdentifiable(
            "the input has no steps to read: it never jumps to another level and stays there. Record a square wave, "
            "or use output_error, which takes any input"
        )
    speeds = [textbook_speed(record.y, record) for record in data]
    good, left_out = [], []
    for step in steps:
        t, speed = data[step.record].t_output, speeds[step.record]
        value = read_step(step, t, speed, rule)
        why = _obstacle(step, t, speed, value)
        if why:
            left_out.append((step, why))
        else:
            good.append((step, value, _one_way(step, t, speed)))
    if not good:
        raise NotIdentifiable(f"{omission_text(left_out)}; {_advice(left_out, data, speeds)}")
    chosen = [each for each in good if each[2]] or good
    values = np.array([value if one_way else [*value[:2], np.nan] for _, value, one_way in chosen])
    return Readings(steps=tuple(step for step, _, _ in chosen), values=values, left_out=tuple(left_out))


def _between(t: Array, start: float, end: float) -> slice:
    """The samples with start <= t <= end: the one at the end was latched before the next step acted."""
    return slice(int(np.searchsorted(t, start)), int(np.searchsorted(t, end, side="right")))


def _obstacle(step: Step, t: Array, speed: Array, value: Array) -> str:
    """The reason why a step can't be read; empty if it can."""
    before, after = step.steady(t, speed)
    scatter = max(float(before.std()), float(after.std()))
    if abs(float(after.mean() - before.mean())) < _CLEAR * scatter:
        return "can't be distinguished from the scatter of the speed"
    if not np.isfinite(value).all() or value[1] <= 0:
        return "can't be read from so few samples"
    return "" if step.held >= _SETTLED * value[1] else "did not settle"


def _one_way(step: Step, t: Array, speed: Array) -> bool:
    """Whether the motor turns the same way before and after, by more than a fiftieth of the faster speed."""
    first, last = (float(part.mean()) for part in step.steady(t, speed))
    return first * last > 0.02 * max(abs(first), abs(last)) ** 2


def omission_text(left_out: Sequence[tuple[Step, str]]) -> str:
    """Return what became of steps that couldn't be read, with the times of the first few; without a full stop."""
    sentences = []
    for why in dict.fromkeys(why for _, why in left_out):
        times = [f"{step.start:.4g} s" for step, reason in left_out if reason == why]
        more = f" and {len(times) - 3} more" if len(times) > 3 else ""
        some = f"the step at {times[0]}" if len(times) == 1 else f"the steps at {', '.join(times[:3])}{more}"
        sentences.append(f"{some} {why}")
    return "; ".join(sentences)


def _advice(left_out: Sequence[tuple[Step, str]], data: Sequence[Dataset], speeds: Sequence[Array]) -> str:
    """Advice on how long to hold each level, from the step that was held longest."""
    step = max((step for step, _ in left_out), key=lambda step: step.held)
    tau = apparent_time_constant(step, data[step.record].t_output, speeds[step.record])
    wait = "until the speed no longer changes"
    if np.isfinite(tau):
        wait = f"for about {_SETTLED * tau:.2g} s, five time constants"
    now = f"the longest was held for {step.held:.3g} s"
    return f"hold each level {wait} ({now}), or use output_error, which needs no steady values"


def apparent_time_constant(step: Step, t: Array, speed: Array) -> float:
    """Return the time constant [s] that a step which hasn't settled seems to have, NaN where there is no telling.

    `speed` (N,) is that at times t (N,) [s].

    For e^(-t/τ) the means over three equal times T/3 have the differences' ratio e^(-T/(3τ)), whatever the steady value.
    """
    here = step.samples(t)
    third = (here.stop - here.start) // 3
    if third == 0:
        return float("nan")
    a, b, c = (float(part.mean()) for part in speed[here][: 3 * third].reshape(3, third))
    ratio = (c - b) / (b - a) if b != a else float("nan")
    lasts = float(t[here.start + third] - t[here.start])
    return float(-lasts / np.log(ratio)) if 0.0 < ratio < 0.95 else float("nan")
