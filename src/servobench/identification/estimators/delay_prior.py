"""The prior of a delay, and its use where the data don't determine the delay.

On a ramp from rest the output is that of K (u - rate · d - u_c): delay d and Coulomb voltage u_c can't be separated, and a
search ends anywhere along their valley. A delay belongs to the loop, not to the motor. A controller that computes for a whole
tick acts a sample later (Åström and Wittenmark 1997, chapter 9), a bus or a servo's own loop takes about 10 ms more (the servo
of fra233 and the Lego motors among the real recordings: 3 to 16 ms). So the prior is

    d ~ Cauchy(one sample time, scale s),   s = max(2 sample times, 10 ms)

whose tails are so heavy that it hardly affects a delay that the data determine: a delay of 20 scales costs 12 in twice the
log-likelihood, about as much as Schwarz's criterion asks of two parameters. If the data determine the delay to a quarter of s,
nothing is done. Otherwise the delay is the one with the largest posterior, where twice the log-likelihood is n/κ ln(sum of
squares), with κ for the colour of the residuals, and its uncertainty is s: a normal prior with that standard deviation in the
covariance (docs/decisions/0041-delay-expected.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.covariance import effective_samples
from servobench.identification.estimators.least_squares import (
    Layout,
    Minimum,
    information,
    jacobian_and_residual,
    lowest,
    square_jacobians,
)
from servobench.identification.estimators.least_squares import at as point_at
from servobench.identification.models.base import Prediction, Structure
from servobench.identification.models.first_motion import rests_at_first
from servobench.recordings.measurement.dataset import Dataset

CODE = "delay-expected"
TOLD = 0.25  # of the prior's scale: a delay that is known better is the data's own
_USUAL = 4.0  # scales from its middle: a delay that is further away has to be worth it
_RARE, _LONG = 8.0, 0.5  # scales from its middle, and s: nothing that drives a motor is as late
_USUAL_SURPRISE = 2.0 * float(np.log1p(_USUAL**2))
_AS_LIKELY = 9.0  # in twice the logarithm of the posterior: places that lie further apart aren't in doubt
_AS_WELL = 1.1  # times the sum of squares
_ROUNDED = 0.4  # of a count: residuals that are smaller are mostly rounding, whose standard deviation is 0.29
_APART = 0.02  # of the prior's scale: delays that lie closer together are one
_STARTS = 3  # of a search with a delay that is held
# Steps of a search at a held delay, which may creep along a valley full of kinks: the best of them goes on.
_STEPS = 30
_SHORTEST = 0.01  # s, of the prior's scale
_AS_GOOD_AS_NONE = 0.1  # of a sample time, which is the prior's middle
_NEARLY_ONE = 0.6  # of a sample time: a shorter delay is a part of one


@dataclass(frozen=True, kw_only=True)
class DelayPrior:
    """The prior of the delay, number `at` of the parameters: its `middle` and its `scale` [s]."""

    at: int
    middle: float
    scale: float
    along: Array | None = None
    """The change of the joint vector (P + ΣQ,) with the delay between separate places that explain the data equally well."""

    def is_rare(self, delay: float) -> bool:
        """Return whether nothing that drives a motor is as late [s]: eight scales from the middle, or half a second and two."""
        return abs(delay - self.middle) > min(_RARE * self.scale, max(_LONG, 2.0 * self.scale))

    def penalty(self, delay: float) -> float:
        """Return twice the negative logarithm of the prior's density at a delay [s], but for a constant."""
        return 2.0 * float(np.log1p(((delay - self.middle) / self.scale) ** 2))


def prior_of_delay(structure: Structure, data: Sequence[Dataset]) -> DelayPrior | None:
    """Return what is expected of the delay that the loop adds to what the device says; None for a structure without one."""
    names = [parameter.name for parameter in structure.parameters]
    if "delay" not in names:
        return None
    step = max(min(record.sample_time, record.input_step) for record in data)
    return DelayPrior(at=names.index("delay"), middle=step, scale=max(2.0 * step, _SHORTEST))


def where_expected(
    structure: Structure, data: Sequence[Dataset], minimum: Minimum, sd: float, prior: DelayPrior
) -> tuple[Minimum, DelayPrior] | None:
    """Return the place with the largest posterior where the data don't tell the delay, and None where they do.

    `sd` is the standard deviation [s] that they give it by themselves. The prior comes along, with the way to other places that
    are as good, where there are such.
    """
    delay, is_told = float(minimum.theta[prior.at]), sd < TOLD * prior.scale
    if is_told and abs(delay - prior.middle) < _USUAL * prior.scale:
        return _one_of_several(structure, data, minimum, prior)
    shrunk = delay
    if np.isfinite(sd):
        shrunk += (prior.middle - delay) * sd**2 / (sd**2 + prior.scale**2)
    samples = _samples(data, minimum)
    apart = abs(shrunk - prior.middle) > _APART * prior.scale
    values = (prior.middle, shrunk) if apart else (shrunk,)
    held = _minima_at(structure, data, minimum, prior.at, values)
    best = _likeliest(data, held, prior, samples)
    if structure.friction:
        # An input that climbs in stairs determines parts of a sample: beside each held place one fits better.
        settled = [lowest(structure, data, (each.theta,)) for each in held]
        likeliest = _likeliest(data, (best, *settled), prior, samples)
        if likeliest is not best:
            best, prior = likeliest, replace(prior, along=slope_with_delay(likeliest, minimum, prior))
    is_elsewhere = abs(float(best.theta[prior.at]) - delay) > _APART * prior.scale
    if (is_elsewhere or not is_told) and _likeliest(data, (minimum, best), prior, samples) is best:
        return best, prior
    return None if is_told else (minimum, replace(prior, along=None))


def _likeliest(
    data: Sequence[Dataset], places: Sequence[Minimum], prior: DelayPrior, samples: float
) -> Minimum:
    """The place with the largest posterior, or one with a more usual delay that explains the counts as well."""
    best = min(places, key=lambda each: _loss(data, each, prior, samples))
    usual = [each for each in places if _is_as_good(data, each, best)]
    return min((best, *usual), key=lambda each: prior.penalty(float(each.theta[prior.at])))


def _is_as_good(data: Sequence[Dataset], one: Minimum, best: Minimum) -> bool:
    """Whether a place explains counts as well as the best one, but for rounding that lasts.

    While a shaft stands or sets off slowly its reading is off by the same amount for many samples. With a delay that stands for
    friction a model may creep there, and follow that. It is a single error, and counts as many in the sum of squares.
    """
    if not all(record.quantum for record in data):
        return False
    cost, least = (sum(map(_cost_beside_rest, data, each.predictions)) for each in (one, best))
    rounding = sum(len(record.y) * (_ROUNDED * (record.quantum or 0.0)) ** 2 for record in data)
    return cost <= min(_AS_WELL * least, rounding)


def _cost_beside_rest(record: Dataset, prediction: Prediction) -> float:
    """The sum of squares of a record, without the rounding of its first rest: a constant of up to half a count."""
    residual = jacobian_and_residual(record, prediction)[1]
    first = record.first_motion
    if first is None or not prediction.valid.all():
        return float(residual @ residual)
    rests = record.t_output < first.effect
    moving, standing = float(residual[~rests].mean()), float(residual[rests].mean())
    most = 0.5 * (record.quantum or 0.0)
    apart = float(np.clip(standing - moving, -most, most))
    return float(np.sum((residual - moving - apart * rests) ** 2))


def slope_with_delay(one: Minimum, other: Minimum, prior: DelayPrior) -> Array | None:
    """Return the change of the joint vector (P + ΣQ,) a second of delay from one place to another; None if the delay is the same.

    Two searches that end at one delay, but for rounding, may leave friction and gain elsewhere in their valley, and the quotient
    would be that by nothing.
    """
    change = other.theta - one.theta
    return change / change[prior.at] if abs(change[prior.at]) > _APART * prior.scale else None


def _one_of_several(
    structure: Structure, data: Sequence[Dataset], minimum: Minimum, prior: DelayPrior
) -> tuple[Minimum, DelayPrior] | None:
    """The likeliest of several places that a delay is told at, each to a part of a sample; None where there is only one.

    A shaft that friction holds while its input climbs sets off at the same time if the input climbs one stair less, a sample
    later.
    """
    if not (structure.friction and any(rests_at_first(record) for record in data)):
        return None
    delay, step = float(minimum.theta[prior.at]), max(record.input_step for record in data)
    values = (prior.middle, delay - step, delay + step)
    held = _minima_at(structure, data, minimum, prior.at, values)
    samples = _samples(data, minimum)
    settled = [lowest(structure, data, (each.theta,)) for each in held]

    def is_in_doubt(each: Minimum) -> bool:
        apart = (
            abs(each.theta[prior.at] - delay) / step
        )  # as many places are as good, and together they are likelier
        less = abs(_loss(data, each, prior, samples) - _loss(data, minimum, prior, samples))
        return bool(apart > 0.5 and less < _AS_LIKELY + 2.0 * np.log(max(apart, 1.0)))

    others = [each for each in settled if is_in_doubt(each)]
    if not others:
        return None
    best = _likeliest(data, (minimum, *others), prior, samples)
    other = others[0] if best is minimum else minimum
    return best, replace(prior, along=slope_with_delay(best, other, prior))


def surprise(fit: Fit) -> float:
    """Return twice the negative logarithm of the prior's density at the delay of a fit, 0 at its middle or without a delay."""
    prior = prior_of_delay(fit.model.structure, [record.data for record in fit.records])
    return 0.0 if prior is None else prior.penalty(float(fit.model.theta[prior.at]))


def prior_of(fit: Fit) -> DelayPrior | None:
    """Return the prior that holds the delay of a fit, None where the data tell the delay by themselves."""
    if not any(each.code == CODE for each in fit.findings):
        return None
    return prior_of_delay(fit.model.structure, [record.data for record in fit.records])


def is_only_a_fit(fit: Fit) -> bool:
    """Return whether a delay was taken from its prior far from what is usual: what fits best is no measurement of it."""
    prior = prior_of(fit)
    return prior is not None and abs(float(fit.model.theta[prior.at]) - prior.middle) > prior.scale


def is_usual(fit: Fit) -> bool:
    """Return whether a fit has a delay that needs no excuse."""
    return surprise(fit) < _USUAL_SURPRISE


def finding(minimum: Minimum, prior: DelayPrior) -> Finding:
    """Return what to say of a delay that is expected and not determined.

    Its interval is left to the table of parameters: what is allowed for later, such as a model's error, is part of it.
    """
    value = float(minimum.theta[prior.at])
    usual = abs(value - prior.middle) <= prior.scale
    samples = value / prior.middle
    taken = "zero" if usual and samples < _AS_GOOD_AS_NONE else f"about {with_unit(value, 's', 2)}"
    if usual:
        assumed = f"The delay is assumed to be {taken}, {_in_samples(samples)}as is usual where a computer drives the motor"
    elif value > 0:
        assumed = f"The delay is assumed to be {taken}, which fits best, though so long a delay is rare"
    else:
        assumed = f"The best fit has the output {with_unit(-value, 's', 2)} before its input, as no motor has"
    rare = prior.is_rare(value)
    late = rare and value > 0
    check = " Check that the input is logged when it acts." if late else ""
    # Too early is no evidence of columns out of step here: what that would take is for `doubts.delay` to say.
    return (warning if late else info)(
        CODE,
        f"These data can't separate the delay from friction and the time constant. {assumed}, and the other intervals allow for "
        f"that; to measure the delay, sample a step from rest faster.{check}",
        parameters=("delay", "coulomb_voltage") if prior.along is not None else ("delay",),
    )


def _in_samples(samples: float) -> str:
    """The size of a usual delay in words, empty where there is as good as none."""
    if samples < _AS_GOOD_AS_NONE:
        return ""
    return "a sample time or so, " if samples > _NEARLY_ONE else "a part of a sample time, "


def is_in_several_places(fit: Fit) -> bool:
    """Return whether a delay was taken from its prior because several places, each with a friction of its own, are as good."""
    return any(each.code == CODE and "coulomb_voltage" in each.parameters for each in fit.findings)


def _minima_at(
    structure: Structure, data: Sequence[Dataset], minimum: Minimum, at: int, values: Sequence[float]
) -> list[Minimum]:
    """The minima with the delay held at values within its bounds.

    Each search begins where the others are, where they lead to at first order, and at a guess: a delay that stands for friction
    leads nowhere from its valley, as so much of the input has to be lost in another way.
    """
    layout = Layout(structure, tuple(data))
    lower, upper = (float(bounds[at]) for bounds in structure.bounds(data))
    free = np.arange(len(minimum.theta)) != at
    h = information(layout, square_jacobians(layout, minimum.predictions))
    slope = np.linalg.lstsq(h[np.ix_(free, free)], h[free, at], rcond=None)[0]
    guesses = structure.guesses(data) if structure.friction else ()
    minima = []
    for value in np.unique(np.clip(values, lower, upper)):
        led = minimum.theta.copy()
        led[free] -= slope * (value - minimum.theta[at])
        starts = [np.where(free, start, value) for start in (minimum.theta, led, *guesses)]
        if len(starts) > _STARTS:
            starts.sort(key=lambda start: point_at(layout, start).cost)
        best = lowest(structure, data, starts[:_STARTS], free, _STEPS)
        minima.append(best if best.converged else lowest(structure, data, (best.theta,), free))
    return minima


def _samples(data: Sequence[Dataset], minimum: Minimum) -> float:
    """The number of samples of white noise that the residuals are worth."""
    return sum(
        effective_samples(jacobian_and_residual(record, prediction)[1])
        for record, prediction in zip(data, minimum.predictions, strict=True)
    )


def _loss(data: Sequence[Dataset], minimum: Minimum, prior: DelayPrior, samples: float) -> float:
    """Twice the negative logarithm of the posterior, but for a constant."""
    cost = sum(
        cost_beside_zero(record, jacobian_and_residual(record, prediction)[1])
        for record, prediction in zip(data, minimum.predictions, strict=True)
    )
    penalty = prior.penalty(float(minimum.theta[prior.at]))
    return samples * float(np.log(max(cost, np.finfo(float).tiny))) + penalty


def cost_beside_zero(record: Dataset, residual: Array) -> float:
    """Return the sum of squares of a residual (M,), without what a sensor of the speed shows of a shaft that rests at first.

    That is the zero of a tachometer. A model without friction creeps before it moves, and would follow it for as long as the
    shaft rests, with a delay in place of what holds the shaft.
    """
    squares, first = float(residual @ residual), record.first_motion
    if (
        record.kind != "speed"
        or first is None
        or len(residual) != len(record.y)
        or not rests_at_first(record)
    ):
        return squares
    zero = residual[record.t_output < first.effect]
    return squares - float(zero.sum()) ** 2 / max(len(zero), 1)
