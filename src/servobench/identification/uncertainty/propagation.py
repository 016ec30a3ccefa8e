"""Intervals carried on: from the parameters of a fit to whatever is computed from them.

To first order the variance of f(θ) is g Σ g', with the gradient g of f by the parameters and their covariance Σ (JCGM 100:2008,
section 5.2; the draws below: JCGM 101:2008). Whether that is enough is tried: where f leaves its tangent plane along the axes of
Σ or where it is steepest, parameters are drawn from what the fit says of them, and where f of these draws has other quantiles
than its tangent plane has, f's own quantiles are the interval. That is so for a margin that is infinite for a part of the draws,
for a bend within the interval, and for a parameter whose interval isn't symmetric.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import Fit
from servobench.identification.models.base import Model, Output
from servobench.systems.interop import as_controller
from servobench.systems.margins import Margins, margins, series
from servobench.systems.responses import bandwidth, rise_time
from servobench.systems.sampled_loop import sampled_series_of_each
from servobench.systems.stability.loop_family import margins_of_family
from servobench.systems.transfer_function import TransferFunction

LEVEL = 0.95
Complex: TypeAlias = NDArray[np.complex128]
Method: TypeAlias = Literal["first order", "sampling"]
OfEach: TypeAlias = Callable[[Sequence[Model]], NDArray[Any]]  # values (M, N) of M models
_TRIAL, _FULL = 100, 600  # draws that try the tangent plane, and those that replace it
_BEND = 0.05  # of half an interval: how far its ends may be moved by what the first order leaves out
_ROUNDING = 1e-11  # relative; how far a value may be off by arithmetic alone
_NEAR = 0.98  # cosine between directions, 11°: one is looked at for both
_UNDEFINED = 0.025  # of the draws: so many may have no value; they count as lying where the estimate does
_SEED = 20250  # of the draws; any would do
_OF_THE_LOOP = {
    "gain_margin": "1",
    "phase_margin": "rad",
    "delay_margin": "s",
    "gain_crossover": "rad/s",
    "phase_crossover": "rad/s",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Propagation:
    """Values (N,) of a function of the parameters, their 95 % intervals, and which of these were `sampled`.

    `low` and `high` (N,) are the ends, NaN where a parameter matters that the data don't determine.
    """

    value: Array
    low: Array
    high: Array
    sampled: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Derived:
    """One quantity derived from the parameters, with its 95 % interval and how that was found."""

    value: float
    """The quantity, in its unit."""
    interval: tuple[float, float]
    level: float
    """The probability with which such intervals hold the true value."""
    unit: str
    """SI and spelled out; 1 for a mere ratio."""
    method: Method
    """From the derivatives to first order, or from a sample of parameters."""


def derive(
    fit: Fit, controller: TransferFunction | Any = None, around: Output = "position"
) -> dict[str, Derived]:
    """Return what is usually asked of a motor, by name, each with its interval.

    Of the linear part from input to speed: its poles [1/s] (`pole`, or `pole_1`, `pole_2`, … with `_real` and `_imaginary` for a
    complex one), `bandwidth` [rad/s] and `rise_time` from 10 to 90 % [s]. Of the loop `around` position or speed, as it runs at
    the sample time of the data: the margins and crossovers that `Margins` describes. `controller` is as in `loop_margins`.
    """
    return open_loop(fit) | loop_margins(fit, controller, around)


def open_loop(fit: Fit) -> dict[str, Derived]:
    """Return poles, bandwidth and rise time of the linear part from input to speed; NaN what an integrator doesn't have."""
    poles = fit.model.transfer_function("speed").poles
    places = _places(poles)

    def quantities(models: Sequence[Model]) -> Array:
        systems = [model.transfer_function("speed") for model in models]
        now = match_order(np.array([system.poles for system in systems]), poles)
        parts = [now[:, n].imag if imaginary else now[:, n].real for n, imaginary in places.values()]
        responses = [(bandwidth(system), rise_time(system)) for system in systems]
        return np.column_stack([*parts, np.array(responses)])

    units = dict.fromkeys(places, "1/s") | {"bandwidth": "rad/s", "rise_time": "s"}
    return _by_name(propagate_of_each(fit, quantities), units)


def loop_margins(
    fit: Fit,
    controller: TransferFunction | Any = None,
    around: Output = "position",
    *,
    sample_time: float | None = None,
) -> dict[str, Derived]:
    """Return the margins and crossovers of the loop as it runs, every `sample_time` [s], each with its interval.

    The input holds between two ticks, the motor is exact with its delay (`sampled_loop`), and `Margins` says what each
    is. Without a sample time it is that of the data, of several records the shortest.
    `controller` is C(s), from the error of the output to the input: a `TransferFunction` or a python-control system, computed by
    the trapezoid rule (`sampled_loop.trapezoid`). The default is unit feedback, one unit of input for each unit of error (1 V for
    each rad). Raises `UsageError` for a sample time that isn't above zero.
    """
    h = sample_time_of(fit) if sample_time is None else sample_time
    feedback = as_controller(controller)

    def quantities(systems: Sequence[TransferFunction]) -> Array:
        return _numbers(margins_of_family(sampled_series_of_each(feedback, systems, h)))

    return _margins_with_intervals(fit, around, quantities)


def continuous_loop_margins(
    fit: Fit, controller: TransferFunction | Any = None, around: Output = "position"
) -> dict[str, Derived]:
    """Return the same of the continuous loop C(s) G(s), which no controller with ticks is: its gain margin is far larger.

    A first-order model has a delay in the place of the electrical pole L/R: at a phase crossover ω its gain margin is low by
    about (ωL/R)², 3 % where ωL/R is 0.18. What up to half a sample time of the delay would be as the lag of a pole is within the
    intervals, here and in `loop_margins`; a longer lag shows in the samples.
    """
    feedback = as_controller(controller)

    def quantities(systems: Sequence[TransferFunction]) -> Array:
        return _numbers([margins(series(feedback, system)) for system in systems])

    return _margins_with_intervals(fit, around, quantities)


def sample_time_of(fit: Fit) -> float:
    """Return the sample time of the data [s] that a fit was made from, of several records the shortest."""
    steps = [record.data.sample_time for record in fit.records] or [fit.model.data.sample_time]
    known = [step for step in steps if math.isfinite(step)]
    return float(f"{min(known, default=math.nan):.9g}")  # without what rounding the times left


def _margins_with_intervals(
    fit: Fit, around: Output, quantities: Callable[[Sequence[TransferFunction]], Array]
) -> dict[str, Derived]:
    def of_each(models: Sequence[Model]) -> Array:
        return quantities([model.transfer_function(around) for model in models])

    propagation = propagate_of_each(fit, of_each)
    lagging = quantities([_with_lag(fit, around)])[0]
    known = np.isfinite(lagging) & np.isfinite(propagation.value)
    off = np.zeros_like(lagging)
    off[known] = lagging[known] - propagation.value[known]
    propagation = replace(
        propagation, low=propagation.low + np.minimum(off, 0.0), high=propagation.high + np.maximum(off, 0.0)
    )
    return _by_name(propagation, _OF_THE_LOOP)


def _numbers(stability_margins: Sequence[Margins]) -> Array:
    return np.array([[getattr(each, name) for name in _OF_THE_LOOP] for each in stability_margins])


def _with_lag(fit: Fit, around: Output) -> TransferFunction:
    """The model with as much of its delay as the samples don't tell from one in the form of a pole's lag."""
    system = fit.model.transfer_function(around)
    lag = min(
        max(system.delay, 0.0), 0.5 * min((record.data.sample_time for record in fit.records), default=0.0)
    )
    slower = (
        tuple(float(c) for c in np.convolve(system.denominator, (lag, 1.0)))
        if lag > 0
        else system.denominator
    )
    return replace(system, denominator=slower, delay=system.delay - lag)


def propagate(fit: Fit, function: Callable[[Model], Array]) -> Propagation:
    """Return function(model), real values (N,), at the fit's parameters, with their 95 % intervals.

    First order where that does, and the quantiles of a sample of parameters where the sample says otherwise. The sample is the
    same every time.
    """
    return propagate_of_each(fit, _one_by_one(function))


def _one_by_one(function: Callable[[Model], NDArray[Any]]) -> OfEach:
    return lambda models: np.array([function(model) for model in models])


def propagate_of_each(fit: Fit, function: OfEach) -> Propagation:
    """Return the same for a function of many models at once, values (M, N), which is faster where that computes in arrays."""
    value = np.asarray(function([fit.model]), dtype=np.float64)[0]
    slopes = _gradient(fit, function)
    half = TWO_SIDED * deviation(slopes, fit.covariance)
    unknown = np.isnan(value) | _hangs_on_unknown(slopes, fit.covariance)
    half[unknown] = np.nan
    low, high = value - half, value + half
    bent = np.zeros(len(value), dtype=bool)
    has_no_plane = ~np.isfinite(half) & ~unknown  # such as a margin that is infinite
    if has_no_plane.any() or not _follows_its_plane(fit, function, value, slopes, half):
        moved = _sampled_ends(fit, function, value, slopes, _TRIAL) - np.array([low, high])
        with np.errstate(invalid="ignore"):
            bent = ~(np.abs(moved) <= _BEND * half + 1e-9 * np.abs(value)).all(axis=0) & ~unknown
    if bent.any():
        ends = _sampled_ends(fit, function, value, slopes, _FULL)
        low, high = np.where(bent, ends[0], low), np.where(bent, ends[1], high)
    return Propagation(value=value, low=low, high=high, sampled=bent)


def _follows_its_plane(fit: Fit, function: OfEach, value: Array, slopes: Array, half: Array) -> bool:
    """Whether all values that are known are on the tangent plane at the edge of the region that holds 95 % of a parameter.

    It is looked at along the axes of the covariance and between each two of them, which shows all second derivatives, and, for
    each value, where that changes most, or within 11° of there: there lie the ends of its interval. What is off by a quarter of
    what would matter, and a fit that has an interval of its own for a parameter, is left to a sample.
    """
    if fit.intervals:
        return False
    sd = np.sqrt(np.diag(fit.covariance))
    free = np.isfinite(sd) & (sd > 0)
    part = fit.covariance[np.ix_(free, free)]
    values, vectors = np.linalg.eigh(part / np.outer(sd[free], sd[free]))
    axes = (vectors * np.sqrt(np.maximum(values, 0.0))).T * sd[free]
    known = np.isfinite(half)
    steep = known & (half > 0)
    steepest = _separate(slopes[np.ix_(steep, free)] @ axes.T * (TWO_SIDED / half[steep, None])) @ axes
    lower, upper = fit.model.structure.bounds([fit.model.data])
    between = [(one + other) / math.sqrt(2) for one, other in combinations(axes, 2)]
    ways = TWO_SIDED * np.vstack([axes, *between, steepest])
    steps = np.zeros((2 * len(ways), len(sd)))
    steps[:, free] = np.concatenate([ways, -ways])
    thetas = fit.model.theta + steps
    if (thetas < lower).any() or (thetas > upper).any():
        return False
    at_edges = _attempts(function, fit.model, thetas, value)[:, known]
    off = np.abs(at_edges - value[known] - steps @ slopes[known].T)
    return bool((off <= 0.25 * _BEND * half[known] + 1e-9 * np.abs(value[known])).all())


def _separate(ways: Array) -> Array:
    """Those of the unit vectors (N, P) that are farther than `_NEAR` from each other's lines."""
    separate = ways[:0]
    while len(ways):
        first, others = ways[:1], ways[1:]
        separate = np.vstack([separate, first])
        ways = others[np.abs(others @ first[0]) < _NEAR]
    return separate


def gradient(fit: Fit, function: Callable[[Model], NDArray[Any]]) -> NDArray[Any]:
    """Return the derivatives of function(model) (N,) by the parameters as columns (N, P), by central differences.

    The differences are a hundredth of a standard deviation or a thousandth of the value wide, whichever is less: narrow to the
    curvature of anything that has an interval at all, and wide to the rounding of the machine.
    """
    return _gradient(fit, _one_by_one(function))


def _gradient(fit: Fit, function: OfEach) -> NDArray[Any]:
    theta, sd = fit.model.theta, np.sqrt(np.diag(fit.covariance))
    size = np.maximum(1e-3 * np.abs(theta), 1e-9)
    width = np.where(np.isfinite(sd) & (sd > 0), np.minimum(0.01 * sd, size), size)
    shifts = np.concatenate([np.diag(width), -np.diag(width)])
    after, before = np.split(function([replace(fit.model, theta=theta + shift) for shift in shifts]), 2)
    with np.errstate(invalid="ignore"):
        change = after - before
        # By a parameter that the data don't determine, whether there is a change is all that counts.
        change[~np.isfinite(sd)[:, None] & (np.abs(change) <= _ROUNDING * np.abs(after))] = 0.0
        return np.asarray(change.T / (2 * width))


def deviation(slopes: Array, covariance: Array) -> Array:
    """Return the standard deviations √(g Σ g') for the rows g of a gradient (N, P); NaN where an unknown parameter matters."""
    unknown = ~np.isfinite(np.diag(covariance))
    known = np.where(unknown[:, None] | unknown[None, :], 0.0, covariance)
    variance = np.einsum("ni,ij,nj->n", slopes, known, slopes)
    return np.where(
        _hangs_on_unknown(slopes, covariance), np.nan, np.sqrt(np.where(variance < 0, 0.0, variance))
    )


def match_order(poles: Complex, order: Complex) -> Complex:
    """Return poles (P,) or (M, P) in the order of those that they are nearest to, (P,).

    Which of a conjugate pair comes first is arbitrary.
    """
    nearest = np.argmin(np.abs(poles[..., None, :] - order[:, None]), axis=-1)
    return np.asarray(np.take_along_axis(poles, nearest, axis=-1), dtype=np.complex128)


def draws(fit: Fit, count: int) -> tuple[Array, Array]:
    """Return parameters drawn from what a fit says of them (count, P), and the same from its covariance alone.

    The correlations are those of the covariance. A parameter with an interval of its own, such as one near a bound, is
    stretched on both sides so that 95 % of its draws lie within; none leaves its bounds. One that the data don't determine stays
    where it is. Every draw has its mirror image.
    """
    sd = np.sqrt(np.diag(fit.covariance))
    free = np.isfinite(sd) & (sd > 0)
    scale = np.where(free, sd, 0.0)
    part = fit.covariance[np.ix_(free, free)] / np.outer(sd[free], sd[free])
    values, vectors = np.linalg.eigh(part)
    normal = np.random.default_rng(_SEED).standard_normal((count // 2, int(free.sum())))
    normal = np.concatenate([normal, -normal]) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    z = np.zeros((len(normal), len(sd)))
    z[:, free] = normal
    plain = fit.model.theta + z * scale
    low, high = np.array([fit.intervals.get(name, (np.nan, np.nan)) for name in fit.model.names]).T
    below = np.where(np.isfinite(low), (fit.model.theta - low) / TWO_SIDED, scale)
    above = np.where(np.isfinite(high), (high - fit.model.theta) / TWO_SIDED, scale)
    stretched = fit.model.theta + z * np.where(z < 0, below, above)
    lower, upper = fit.model.structure.bounds([fit.model.data])
    return np.clip(stretched, lower, upper), plain


def _sampled_ends(fit: Fit, function: OfEach, value: Array, slopes: Array, count: int) -> Array:
    """The ends (2, N) of the intervals from a sample, of which the tangent plane says how far out an end lies.

    The true quantiles of the plane are known. The rank that they have among its values at these draws is the rank of the
    ends among the function's values: chance is taken out so far as the two go together.
    """
    thetas, plain = draws(fit, count)
    values = _attempts(function, fit.model, thetas, value)
    missing = np.isnan(values)
    values = np.sort(np.where(missing, value, values), axis=0)
    half = TWO_SIDED * deviation(slopes, fit.covariance)
    with np.errstate(invalid="ignore"):
        plane = np.sort((plain - fit.model.theta) @ slopes.T, axis=0)
    outermost = 0.5 * (1 - LEVEL) * (len(values) - 1)
    ends = np.full((2, len(value)), np.nan)
    for n in np.flatnonzero(missing.mean(axis=0) <= _UNDEFINED):
        ranks = (outermost, len(values) - 1 - outermost)
        if np.isfinite(half[n]) and half[n] > 0:
            ranks = np.interp((-half[n], half[n]), plane[:, n], np.arange(len(values)))
        ends[:, n] = [_at_rank(values[:, n], float(rank)) for rank in ranks]
    return ends


def _attempts(function: OfEach, model: Model, thetas: Array, like: Array) -> Array:
    """The function (M, N) of a model at parameters (M, P); NaN where they make no system, or one that it can't be computed of.

    One that can't is looked for by halves.
    """
    try:
        with np.errstate(all="ignore"):
            return np.asarray(function([replace(model, theta=theta) for theta in thetas]), dtype=np.float64)
    except (ArithmeticError, ValueError):
        if len(thetas) <= 1:
            return np.full((len(thetas), *like.shape), np.nan)
        halves = np.array_split(thetas, 2)
        return np.concatenate([_attempts(function, model, half, like) for half in halves])


def _at_rank(ordered: Array, rank: float) -> float:
    """The value at a rank between whole numbers; the farther one where one of its neighbours is infinite."""
    low, high = ordered[int(np.floor(rank))], ordered[int(np.ceil(rank))]
    if low == high or not np.isfinite([low, high]).all():
        return float(low if np.isinf(low) else high)
    return float(low + (rank % 1.0) * (high - low))


def _hangs_on_unknown(slopes: Array, covariance: Array) -> NDArray[np.bool_]:
    """Rows of a gradient (N, P) with a share of a parameter that the data don't determine."""
    unknown = ~np.isfinite(np.diag(covariance))
    return np.asarray((slopes[:, unknown] != 0.0).any(axis=1), dtype=np.bool_)


def _by_name(propagation: Propagation, units: Mapping[str, str]) -> dict[str, Derived]:
    return {
        name: Derived(
            value=float(propagation.value[n]),
            interval=(float(propagation.low[n]), float(propagation.high[n])),
            level=LEVEL,
            unit=unit,
            method="sampling" if propagation.sampled[n] else "first order",
        )
        for n, (name, unit) in enumerate(units.items())
    }


def _places(poles: Complex) -> dict[str, tuple[int, bool]]:
    """The names of the parts of poles, and where each stands: the number of the pole, and whether it is the imaginary part."""
    upper = [n for n, pole in enumerate(poles) if pole.imag >= 0]
    places: dict[str, tuple[int, bool]] = {}
    for count, n in enumerate(upper, start=1):
        name = "pole" if len(poles) == 1 else f"pole_{count}"
        if poles[n].imag == 0:
            places[name] = (n, False)
        else:
            places |= {f"{name}_real": (n, False), f"{name}_imaginary": (n, True)}
    return places
