"""The evidence of a finite record on stability, and its limits.

BIBO stability is a sentence about every bounded input and all time; a record has one input and an end. So no record proves or
disproves it. A record can only show how its output behaved while the input was constant. With the slopes c₁ and c₂ of two
successive equal parts, their middles Δ apart, the remaining mode goes as e^(λt) with

    λ = ln(c₂/c₁)/Δ

which follows from c₂ = c₁ e^(λΔ). An integrator has λ = 0. Every pole within the interval of λ fits the record as well. If the
logarithm of the slope changes by less than half as much as a quarter of the stretch earlier, there is more than one mode: the
response to the last change of the input is still dying out, and may explain the whole change. Then the interval contains zero,
too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from servobench.core.arguments import check_type
from servobench.core.channels import Array
from servobench.core.rounding import TWO_SIDED, plain, round_value, with_unit
from servobench.recordings.measurement.dataset import Dataset

_FEWEST = 20  # samples in a part whose slope is estimated
_NOTHING = 1e-9  # of the largest output: less is how numbers are rounded
_MOST = 6  # stretches of constant input, the longest
_NEVER = (
    "No finite record proves that a system is stable or unstable: stability is about every bounded input over all "
    "time, and this is one input over {}."
)


@dataclass(frozen=True, kw_only=True)
class Slope:
    """The slope of the output over a part of a stretch, and half of its 95 % interval, in the output's unit per second.

    `value` is the slope, `half` what is to be added and taken off for the interval's ends.
    """

    value: float
    half: float

    @property
    def is_zero(self) -> bool:
        """Whether zero is within the interval."""
        return abs(self.value) <= self.half


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Constant input from `start` to `end` [s], its `level`, and the output's `slopes` in the third and fourth quarter.

    `exponent` is the 95 % interval of λ [1/s]; None where one of the slopes may be zero, or the sign changes. A `sentence` says
    what all of that means.
    """

    start: float
    end: float
    level: float
    slopes: tuple[Slope, Slope]
    exponent: tuple[float, float] | None
    sentence: str


@dataclass(frozen=True, kw_only=True)
class RecordReport:
    """A record's evidence on stability.

    `input_bound` is the largest input, either way, `output_range` the smallest and the largest output, each in its unit;
    `stretches` are the longest times of constant input in their order, and `sentences` say all of it, with what it doesn't prove.
    """

    input_bound: float
    output_range: tuple[float, float]
    stretches: tuple[Stretch, ...]
    sentences: tuple[str, ...]


def bibo(data: Dataset) -> RecordReport:
    """Return what a record with a bounded input shows about the bounds of its output, and no more than that,
    in sentences.

    >>> import servobench as sb
    >>> with sb.connect("twin") as motor:
    ...     recording = sb.run(sb.Experiment(duration="3 s"), motor)
    >>> bibo(sb.measure(recording)).input_bound
    3.0
    """
    check_type("data", data, Dataset, "a Dataset, which measure() makes of a recording")
    bound = float(np.abs(np.append(data.u, data.input_before)).max())
    low, high = float(data.y.min()), float(data.y.max())
    stretches = _stretches(data)
    return RecordReport(
        input_bound=bound,
        output_range=(low, high),
        stretches=stretches,
        sentences=(
            f"Over {with_unit(data.duration, 's', 3)} the input stayed within ±{with_unit(bound, data.input_unit, 3)}, the "
            f"{data.kind} between {with_unit(low, data.output_unit, 3)} and {with_unit(high, data.output_unit, 3)}.",
            *(stretch.sentence for stretch in stretches),
            *(() if stretches else (_without_stretch(data),)),
            _NEVER.format(with_unit(data.duration, "s", 3)),
        ),
    )


def _stretches(data: Dataset) -> tuple[Stretch, ...]:
    """The longest times of constant input, in their order."""
    changes = np.flatnonzero(np.diff(data.u)) + 1
    starts = data.t_input[np.r_[0, changes]]
    ends = np.append(data.t_input[changes], max(data.t_output[-1], data.t_input[-1]))
    levels = data.u[np.r_[0, changes]]
    stretches = []
    for start, end, level in zip(starts, ends, levels, strict=True):
        quarter = 0.25 * (end - start)
        parts = [(start + n * quarter, start + (n + 1) * quarter) for n in (1, 2, 3)]
        inside = [(data.t_output >= a) & (data.t_output <= b) for a, b in parts]
        if min(int(keep.sum()) for keep in inside) >= _FEWEST:
            slopes = [_slope(data.t_output[keep], data.y[keep], data.quantum) for keep in inside]
            stretches.append(_judge(data, float(start), float(end), float(level), slopes))
    longest = sorted(stretches, key=lambda stretch: stretch.start - stretch.end)[:_MOST]
    return tuple(sorted(longest, key=lambda stretch: stretch.start))


def _slope(t: Array, y: Array, quantum: float | None) -> Slope:
    """A straight line through a part.

    The interval is that of least squares with residuals that follow each other with a correlation ρ (variance times
    (1 + ρ)/(1 - ρ)); and no less than what errors of rounding, half a quantum each, can make of a slope at the worst.
    """
    x = t - t.mean()
    weights = x / float(x @ x)
    slope = float(weights @ y)
    left = y - y.mean() - slope * x
    variance = float(left @ left) / (len(t) - 2)
    rho = float(left[1:] @ left[:-1] / (left @ left)) if variance > 0 else 0.0
    inflation = max((1 + rho) / (1 - min(rho, 0.99)), 1.0)
    half = TWO_SIDED * math.sqrt(variance * inflation * float(weights @ weights))
    # What has no quantum is rounded to a float, and its times are.
    rounding = max(quantum or 0.0, 16 * float(np.finfo(np.float64).eps * np.abs(y).max()))
    worst = 0.5 * rounding * float(np.abs(weights).sum())
    return Slope(value=slope, half=max(half, worst))


def _judge(data: Dataset, start: float, end: float, level: float, slopes: Sequence[Slope]) -> Stretch:
    before, one, two = slopes
    unit = f"{data.output_unit}/s".replace("/s/s", "/s²")
    held = f"From {plain(start, 3)} to {with_unit(end, 's', 3)} the input was {with_unit(level, data.input_unit, 3)}"
    exponent = None
    if one.is_zero and two.is_zero:
        most = abs(two.value) + two.half
        noticeable = most * (end - start) > _NOTHING * float(np.abs(data.y).max())
        within = f", to less than {with_unit(most, unit, 2)} at the end" if noticeable else ""
        sentence = f"{held}, and in the second half of that the {data.kind} stayed where it was{within}. {_at_rest(data, level)}"
    elif two.is_zero:
        sentence = f"{held}, and the {data.kind} came to rest. {_at_rest(data, level)}"
    elif one.is_zero or one.value * two.value < 0:
        sentence = f"{held}, and the {data.kind} turned back or started late: no single pole explains that."
    else:
        exponent = _exponent(before, one, two, 0.25 * (end - start))
        grown = f"{held}, and at the end the {data.kind} was still changing by {round_value(two.value, two.half, unit)}"
        sentence = f"{grown}. {_course(exponent)}"
    return Stretch(start=start, end=end, level=level, slopes=(one, two), exponent=exponent, sentence=sentence)


def _exponent(before: Slope, one: Slope, two: Slope, apart: float) -> tuple[float, float]:
    """The 95 % interval of λ, to first order in the slopes' relative errors, which are independent."""
    spread = math.hypot(one.half / one.value, two.half / two.value)
    centre = math.log(two.value / one.value)
    earlier = one.value / before.value if before.value else 0.0
    if earlier <= 0 or abs(centre) <= 0.5 * abs(math.log(earlier)):
        return (min(centre, 0.0) - spread) / apart, (max(centre, 0.0) + spread) / apart
    return ((centre - spread) / apart, (centre + spread) / apart)


def _course(exponent: tuple[float, float]) -> str:
    low, high = exponent
    within = f"between {plain(low, 2)} and {plain(high, 2)} 1/s"
    if low > 0:
        return (
            f"It got faster, as with a pole {within}, to the right; or the response to the last change wasn't over. "
            "The record doesn't show how it continues."
        )
    if high < 0:
        return f"It got slower, as with a pole {within}, which is consistent with a stable system."
    return (
        f"That is proportional to time, like an integrator's response to a constant. A pole anywhere {within} fits "
        f"as well: a system that levels off with a time constant of {with_unit(-1 / low, 's', 2)} or more looks the "
        "same so far."
    )


def _at_rest(data: Dataset, level: float) -> str:
    if level == 0 and data.kind == "position":
        return "That is no sign of stability: an integrator holds its value too, and so does friction."
    return "For this input the output stayed bounded; that says nothing about other inputs."


def _without_stretch(data: Dataset) -> str:
    return (
        "The input was never constant for long enough to read a slope. A bounded output for this input says nothing "
        "about other inputs: an integrator's output is bounded for a zero-mean sinusoid and unbounded for a "
        "constant."
    )
