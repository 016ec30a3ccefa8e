"""The model error's part in the intervals: from the residual, and from experience.

A residual that is coloured by model error says more or less of a parameter the slower it changes beside the information that the
record gives of it. So the scores J'e are summed on a clock of information, bins of equal leverage, and their long-run variance
is taken with lags that are a fixed part b of the record (Kiefer and Vogelsang 2005). Where that is well above what white noise
would make, or where a record has one event only and can't show it, the recordings of other motors say by how much one record
errs beyond what it shows (`experience`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators import delay_prior
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.estimators.budget import Contribution, beyond
from servobench.identification.estimators.covariance import fixed_b, long_run
from servobench.identification.estimators.prediction_error import rounding_explains
from servobench.identification.estimators.residual_correlation import TIED, input_correlation
from servobench.identification.estimators.sizes import sizes
from servobench.identification.models.level import ALIKE, few_levels
from servobench.identification.models.steady import stretches_of_input
from servobench.identification.uncertainty.experience import (
    FEW_EVENTS,
    MOTORS,
    ONE_LEVEL,
    RECORDINGS,
    SEVERAL_EVENTS,
    Experience,
)
from servobench.identification.uncertainty.score_test import (
    by_rounding,
    in_innovations,
    innovations_and_jacobian,
)
from servobench.identification.uncertainty.systematic_torque import systematic_share
from servobench.identification.uncertainty.weak_priors import root_of_covariance
from servobench.recordings.measurement.dataset import Dataset

_EXPERIENCE = f"{RECORDINGS} recordings of {MOTORS} motors"
SOURCE: Final = "model error"
_BINS = 400
_LAGS = 120  # of the bins
# Times what white noise makes: from there on model error counts, and counts whole. Of several events, ideal motors reach 3.0
# and real ones begin at 5.9; of few, real ones are found from 2.2 on.
_EVIDENT = {True: (3.0, 5.0), False: (2.0, 3.0)}
_SEVERAL = 4.0  # events: with fewer, the figures for few are used
_ONE = 2.0  # events: with fewer a record can't show its own model error
_JUMP = 0.05  # of the input's range
_SAGS = 0.15  # of the largest input: a voltage that is switched on and sags by less is one level
_JUMP_SAMPLES = 2  # a measured voltage may take two samples for a jump
_NOTHING = 1e-9  # of the whole information: what is less is rounding error
_ALONG = 1e-6  # of a direction's length: what lies along another by less is rounding error
_BARE = 0.2  # of p/N: what each sample adds to the clock
_BY_SHAPE = 0.5  # of the friction: the standard deviation of what a reversal's shape tells of it, where the model is wrong
_CHANGES = 0.2  # of the samples: an input that changes in more of them is held nowhere
_LEVEL = 0.03  # of the largest input: levels that lie nearer than that are one level
_BY_DIRECTION = 0.045  # of the gain, the standard deviation: what it differs by between the directions
_WHOLE = 1.3  # time constants: a shorter beginning doesn't show how its speed bends
_USUAL = 0.03  # of the largest input: the standard deviation of a friction that the model lacks


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelError:
    """The evidence of a fit on its model's error.

    `ratio` is how much wider than for white noise the residual makes the intervals, at the worst parameter; `events` how many
    stretches of equal weight tell gain, lag and friction, as far as they are there; `shares` (0 to 1) how much of the experience
    counts for each of them, `covariance` (P, P) what the parameters have by it.
    """

    ratio: float
    events: Mapping[str, float]
    shares: Mapping[str, float]
    covariance: Array


def model_error(fit: Fit, one_level: bool = False) -> ModelError | None:
    """Return what the model's error adds to a fit, whose motor only moved under `one_level` or under several.

    None where the model isn't first order, or nothing is left over.
    """
    names = fit.model.names
    if (
        not {"gain", "time_constant"} <= set(names)
        or not np.isfinite(fit.residual_sd)
        or fit.residual_sd == 0
    ):
        return None
    jacobian, e = innovations_and_jacobian(fit)
    scale = sizes(fit)[: jacobian.shape[1]]
    j = jacobian * scale
    freedom = max(len(e) - j.shape[1], 1)
    variance = float(e @ e) / freedom
    # In coordinates q = Rθ, in which white noise is round.
    root = root_of_covariance(fit, jacobian, scale, variance)
    whitened = j @ root
    of_scores = _long_run_on_the_clock(whitened, e)
    white, coloured = variance * root @ root.T, root @ of_scores @ root.T
    shared = len(names)
    directions, parameters = _directions(fit, scale)
    of_white, of_coloured = (
        np.sqrt(np.maximum(np.einsum("gi,ij,gj->g", directions, each[:shared, :shared], directions), 0.0))
        for each in (white, coloured)
    )
    influence = whitened @ root[:shared].T @ directions.T
    rounded = (
        by_rounding(fit, influence)
        if float(np.max(of_coloured / of_white, initial=0.0)) > _EVIDENT[False][0]
        else None
    )
    of_chance = of_white if rounded is None else np.maximum(of_white, np.sqrt(np.diag(rounded)))
    positive = of_white > 0
    ratio = float(np.max(of_coloured[positive] / of_chance[positive], initial=0.0))
    starts = _stretches(fit)
    events = dict(zip(parameters, _events(starts, influence), strict=True))
    known = {name: ONE_LEVEL if one_level else _experience(count) for name, count in events.items()}
    shares = dict.fromkeys(parameters, _evident(fit, ratio, min(events.values())))
    # Friction shows at a few places of most records; a single event is one of gain or lag.
    if one_level or min(events["lag"], events["gain"]) < _ONE:
        for n in (n for n, name in enumerate(parameters) if events[name] < _ONE):
            along = root[:shared].T @ directions[n]
            off = np.inf if one_level else _by_the_others(fit, whitened, e, starts, influence[:, n], along)
            wider = _sd(fit, directions[n] / scale[:shared]) / of_white[n]
            most = _floor(fit, parameters[n], known[parameters[n]])
            shares[parameters[n]] = max(
                shares[parameters[n]], min(1.0, max(wider, 1.0) * off / most) if most else 1.0
            )
    factors = {name: each.factor for name, each in known.items()}
    units = np.outer(scale[:shared], scale[:shared])
    more = beyond(fixed_b(_LAGS / _BINS) ** 2 * of_scores, variance * np.eye(len(of_scores)))
    white = white[:shared, :shared] * units
    wide, expected = white + (root @ more @ root.T)[:shared, :shared] * units, _by_prior(fit, white)
    times = np.array([1.0 + _of(shares, name) * (_of(factors, name) - 1.0) for name in names])
    return ModelError(
        ratio=ratio,
        events=events,
        shares=shares,
        covariance=np.outer(times, times) * (wide - expected) + expected + _floors(fit, known, shares),
    )


def with_model_error(fit: Fit, one_level: bool = False) -> Fit:
    """Return the fit with the line of its budget for model error; the same where there is nothing to add."""
    error = model_error(fit, one_level)
    if error is None or not any(error.shares.values()):
        return fit
    finite = np.isfinite(np.diag(fit.covariance))
    added = beyond(error.covariance, np.where(np.outer(finite, finite), fit.covariance, 0.0))
    added[~finite, :] = 0.0
    added[:, ~finite] = 0.0
    few = min(error.events.values())
    return fit.widen(Contribution(source=SOURCE, covariance=added, reason=_reason(error, few), freedom=few))


def _evident(fit: Fit, ratio: float, events: float) -> float:
    """The strength of a residual's evidence against the model (0 to 1): its long-run variance is large, it follows the input, or
    the torque that it was taken for depends on the motion.
    """
    counted = fit.estimator == "interval_likelihood" and rounding_explains(fit)
    if not counted and input_correlation(fit) > TIED:
        return 1.0
    noticed, plain = _EVIDENT[events >= _SEVERAL]
    return max(float(np.clip((ratio - noticed) / (plain - noticed), 0.0, 1.0)), systematic_share(fit))


def _experience(events: float) -> Experience:
    return SEVERAL_EVENTS if events >= _SEVERAL else FEW_EVENTS


def _of(each: Mapping[str, float], name: str) -> float:
    """The value for a parameter: for both parts of the lag that of the lag, else the larger of gain and friction."""
    if name in ("time_constant", "delay"):
        return each["lag"]
    return max(value for of, value in each.items() if of != "lag")


def _reason(error: ModelError, events: float) -> str:
    if events < _ONE:
        return (
            "the record has one event, which can't show how wrong the model is: allowed for from experience with "
            f"{_EXPERIENCE}; a second step would reduce this"
        )
    return (
        f"the residual moves the parameters {error.ratio:.1f} times as much as white noise would; beyond that, from experience "
        f"with {_EXPERIENCE}"
    )


def _by_prior(fit: Fit, white: Array) -> Array:
    """The part of a covariance (P, P) that comes from a delay's prior and not from the data: no residual shows loops to differ
    more.
    """
    prior = delay_prior.prior_of(fit)
    if prior is None:
        return np.zeros_like(white)
    column = white[:, prior.at] / prior.scale
    return np.outer(column, column)


def _directions(fit: Fit, scale: Array) -> tuple[Array, list[str]]:
    """The directions of interest as rows (G, P) in scaled parameters, and their names: gain, lag τ + d, friction."""
    names = fit.model.names
    lag = np.zeros(len(names))
    for name in ("time_constant", "delay"):
        if name in names:
            lag[names.index(name)] = scale[names.index(name)]
    each = np.diag(scale[: len(names)])
    parameters = [name for name in names if name == "gain" or name.startswith("coulomb_voltage")]
    return np.array([lag, *(each[names.index(name)] for name in parameters)]), ["lag", *parameters]


def _long_run_on_the_clock(j: Array, e: Array) -> Array:
    """The long-run variance of the scores j'e (P, P) of orthonormal columns j, by bins of equal leverage."""
    leverage = np.sum(j**2, axis=1) + _BARE * j.shape[1] / len(j)
    clock = np.cumsum(leverage)
    bins = np.minimum((clock / clock[-1] * _BINS).astype(int), _BINS - 1)
    summed = np.zeros((_BINS, j.shape[1]))
    np.add.at(summed, bins, j * e[:, None])
    return long_run(summed, _LAGS - 1)


def _stretches(fit: Fit) -> NDArray[np.int64]:
    """The first samples of the stretches, among the valid samples of all records."""
    starts, row = [], 0
    for record in fit.records:
        starts += [row + n for n in _cuts(record)]
        row += int(record.valid.sum())
    return np.unique(np.array(starts, dtype=np.int64))


def _events(starts: NDArray[np.int64], influence: Array) -> list[float]:
    """The effective number of stretches for each direction, from their influence (N, G): 1/Σ s², s the share of each stretch."""
    power = np.add.reduceat(influence**2, starts, axis=0)
    shares = power / np.maximum(power.sum(axis=0), 1e-300)
    return [float(count) for count in 1.0 / np.maximum(np.sum(shares**2, axis=0), 1e-300)]


def _by_the_others(
    fit: Fit, whitened: Array, e: Array, starts: NDArray[np.int64], influence: Array, direction: Array
) -> float:
    """The error of a parameter shown by the record without the stretch with the most influence, in e's deviations.

    √(s² + d²): s is the standard deviation that the rest gives it, d by how much the rest's estimate differs. `told` (N, J) is
    the Jacobian in coordinates in which the whole information is the unit matrix, `direction` (J,) the parameter in them. Speed
    and position are free after the stretch, whose error they would else carry on.
    """
    first = int(np.argmax(np.add.reduceat(influence**2, starts)))
    begin, end = int(starts[first]), int([*starts[1:], len(e)][first])
    left = whitened[begin:end]
    free = _free_from(fit, end)
    shared = free.T @ whitened
    inverse = np.linalg.pinv(free.T @ free, hermitian=True)
    information = np.eye(whitened.shape[1]) - left.T @ left - shared.T @ inverse @ shared
    score = -left.T @ e[begin:end] - shared.T @ inverse @ (free.T @ e)
    values, vectors = np.linalg.eigh(information)
    along = vectors.T @ direction
    if np.any(np.abs(along[values < _NOTHING]) > _ALONG * np.linalg.norm(direction)):
        return np.inf
    known = values >= _NOTHING
    sd = np.linalg.norm(along[known] / np.sqrt(values[known]))
    off = along[known] @ ((vectors.T @ score)[known] / values[known])
    return float(np.hypot(sd * np.std(e), off))


def _free_from(fit: Fit, row: int) -> Array:
    """The effect of another speed and position at a valid sample on the innovations from there to the record's end (N, 2)."""
    tau, columns = abs(fit.model["time_constant"]) or 1.0, []
    for record in fit.records:
        t, count = record.data.t_output, int(record.valid.sum())
        x = np.zeros((len(t), 2))
        if 0 < row < count:
            gone = t - t[record.valid][row]
            x[:, 0] = (gone >= 0) * np.exp(-np.maximum(gone, 0.0) / tau)
            x[:, 1] = (gone >= 0) * (record.data.kind == "position")
        columns.append(in_innovations(fit, record, x))
        row -= count
    return np.concatenate(columns)


def _cuts(record: FittedRecord) -> list[int]:
    """The first samples of a record's stretches, among its valid ones: at jumps of the input, and at reversals without one."""
    u = record.data.input_at_output[record.valid]
    least = _least_jump(record.data.u)
    jumps = _jumps(u, least)
    turns = np.array([0, *_turns(u, least), len(u)])
    smooth = np.searchsorted(jumps, turns[1:]) == np.searchsorted(jumps, turns[:-1])
    return [0, *jumps.tolist(), *turns[:-1][smooth].tolist()]


def _least_jump(u: Array) -> float:
    """What an input (N,) has to jump by for an event: a part of its range, and more than a supply sags by under a step."""
    largest = float(np.abs(u).max(initial=0.0))
    driving = np.abs(u)[np.abs(u) >= _LEVEL * largest]
    span, sags = float(np.ptp(u)), float(np.ptp(driving)) if len(driving) else 0.0
    is_switched = (
        sags <= _SAGS * largest and span > 2.0 * sags
    )  # to and fro beside a level is no supply's doing
    return max(_JUMP * span, sags if is_switched else 0.0)


def _jumps(u: Array, least: float) -> NDArray[np.int64]:
    """The samples with which an input (N,) jumps by more than `least`; a steep slope goes on for longer than a jump does."""
    up = np.sign(np.diff(u)) * (np.abs(np.diff(u)) > least)
    edges = np.flatnonzero(np.diff(up, prepend=0.0, append=0.0))
    return np.array(
        [first + 1 for first, after in pairwise(edges) if up[first] and after - first <= _JUMP_SAMPLES],
        dtype=np.int64,
    )


def _turns(u: Array, least: float) -> list[int]:
    """The samples from which an input (N,) goes up or down by more than `least` after it went the other way."""
    turns, way = [], 0
    high = low = 0
    values = u.tolist()
    for n in np.flatnonzero(
        np.diff(u, prepend=np.nan) != 0.0
    ).tolist():  # nothing turns where nothing changes
        value = values[n]
        high = n if value > values[high] else high
        low = n if value < values[low] else low
        if way >= 0 and value < values[high] - least:
            turns.append(high)
            way, low = -1, n
        elif way <= 0 and value > values[low] + least:
            turns.append(low)
            way, high = 1, n
    return turns


def _of_short_records(fit: Fit, lag: float) -> Array:
    """What the factor (P, P) for the lag's floor [s] has beyond the lag's own, if all ends before the motor is at speed.

    After a time T under one input the speed is K (1 - e^(-x)), x = T/τ, of what it tends to, which is what a record shows of K:
    a model error that moves τ by a part of itself moves K by x e^(-x)/(1 - e^(-x)) of that, 1/6 of it after three time constants.
    Over a time T < τ the speed bends away from a straight line by T/2τ of itself, so that the part is (τ/T)² times as large as in
    a whole step, and all of it goes with K: what is known is the slope K/τ. What a motor lacks at its start, static friction or
    a filter, makes as much of a bend, so that a step is whole after 1.3 τ.
    """
    names, theta = fit.model.names, fit.model.theta
    held = max(_longest_hold(record.data) for record in fit.records) / lag
    longest = max(_start(record.data) for record in fit.records)
    own = np.zeros(len(names))
    own[names.index("time_constant")] = 1.0
    with_gain = np.zeros(len(names))
    with_gain[names.index("gain")] = theta[names.index("gain")] / lag
    at_end, at_once = own + _share_to_come(held) * with_gain, own + with_gain
    more = max(lag / longest, 1.0) ** 4 - 1.0
    return np.outer(at_end, at_end) - np.outer(own, own) + more * np.outer(at_once, at_once)


def _share_to_come(x: float) -> float:
    """x e^(-x)/(1 - e^(-x)), 1 at x = 0."""
    return float(-x * np.exp(-x) / np.expm1(-x)) if x > 0 else 1.0


def _start(data: Dataset) -> float:
    """The time [s] for which a record shows what its first input leads to, over what it takes to show it.

    A rest before tells nothing, and a start from one isn't whole at once. Where the input is on from the first row, nobody knows.
    """
    u = data.input_at_output
    driven = np.flatnonzero(np.abs(u) > _LEVEL * float(np.abs(u).max(initial=0.0)))
    if not len(driven) or (driven[0] == 0 and not data.starts_at_rest):
        return data.duration
    return float(data.t_output[-1] - data.t_output[driven[0]]) / _WHOLE


def _longest_hold(data: Dataset) -> float:
    """The longest time [s] under one input that drives the motor, and all the time from the first one on where it never stays.

    What a motor does before a step, or as it runs down, doesn't show what the step leads to.
    """
    starts, ends = stretches_of_input(data)
    u = data.input_at_output
    drives = np.abs(u) > _LEVEL * float(np.abs(u).max(initial=0.0))
    if not drives.any():
        return data.duration
    if len(starts) > _CHANGES * len(data.y):
        return float(data.t_output[-1] - data.t_output[int(np.argmax(drives))])
    driven = drives[starts]
    return float(np.max(data.t_output[ends[driven] - 1] - data.t_output[starts[driven]]))


def _lag(fit: Fit) -> float:
    """Time constant and delay together [s]."""
    return abs(
        float(fit.model["time_constant"] + (fit.model["delay"] if "delay" in fit.model.names else 0.0))
    )


def _floor(fit: Fit, name: str, known: Experience) -> float:
    """The standard deviation of gain, lag or friction between recordings of one motor, in its unit."""
    if name == "lag":
        return known.lag * _lag(fit) / TWO_SIDED
    return (known.gain if name == "gain" else known.friction) * abs(float(fit.model[name])) / TWO_SIDED


def _sd(fit: Fit, gradient: Array) -> float:
    """The standard deviation of a combination (P,) of the parameters so far; 0 where one of them has none."""
    at = np.flatnonzero(gradient)
    variance = float(gradient[at] @ fit.covariance[np.ix_(at, at)] @ gradient[at])
    return float(np.sqrt(variance)) if 0.0 < variance < np.inf else 0.0


def _of_friction(fit: Fit) -> Array:
    """The factor (P, P) that turns the gain's floor into the friction's: at the mean input the speed is K (u - u_c)."""
    names, theta = fit.model.names, fit.model.theta
    mean = float(np.mean(np.abs(np.concatenate([record.data.u for record in fit.records]))))
    times = [
        (mean - float(value)) / float(theta[names.index("gain")])
        if name.startswith("coulomb_voltage")
        else 0.0
        for name, value in zip(names, theta, strict=True)
    ]
    return np.diag(np.square(times))


def _of_reversals(fit: Fit) -> Array:
    """The covariance (P, P) of gain and friction where only the shape of a reversal tells them apart.

    Under inputs of one magnitude, to and fro, every pair with the same K (u - u_c) leads to the same speed. How a model is wrong
    near a reversal, by play or a compliant shaft, isn't seen in the speeds, and half of the friction may come from there.
    """
    names, theta = fit.model.names, fit.model.theta
    along = _at_one_speed(fit)
    u = np.concatenate([record.data.u for record in fit.records])
    reverses = u.min(initial=0.0) < 0.0 < u.max(initial=0.0)
    if along is None or not reverses or np.any(np.abs(u) < _LEVEL * np.abs(u).max()):
        return np.zeros((len(names), len(names)))
    split = _BY_SHAPE * theta[names.index("coulomb_voltage")] * along
    return np.outer(split, split)


def _of_directions(fit: Fit) -> Array:
    """The covariance (P, P) of gain, friction and offset where a few levels to and fro have to tell them from one another.

    A motor whose gain is by a part smaller in one direction, as most are by a few percent, acts as if half of that part of |u|
    were added to its input, and friction takes u_c sgn(u). Under two or three levels either looks like other values of the rest.
    """
    names, theta = fit.model.names, fit.model.theta
    levels = few_levels([record.data for record in fit.records])
    if levels is None:
        return np.zeros((len(names), len(names)))
    taken = {"coulomb_voltage": np.sign(levels), "offset_voltage": np.ones(len(levels))}
    at = [names.index("gain"), *(names.index(name) for name in taken if name in names)]
    driven = levels - sum(theta[names.index(name)] * each for name, each in taken.items() if name in names)
    largest = float(np.abs(levels).max())
    columns = np.column_stack([driven, *(-largest * taken[names[n]] for n in at[1:])])
    unseen = [_BY_DIRECTION * 0.5 * np.abs(levels)]
    if "coulomb_voltage" not in names:
        unseen.append(-_USUAL * largest * np.sign(levels))
    moved = np.linalg.lstsq(columns, np.column_stack(unseen), rcond=1e-6)[0]
    moved *= np.array([theta[at[0]], *([largest] * (len(at) - 1))])[:, None]
    out = np.zeros((len(names), len(names)))
    out[np.ix_(at, at)] = moved @ moved.T
    return out


def _at_one_speed(fit: Fit) -> Array | None:
    """The change of the parameters (P,) with the Coulomb voltage at the only speed that was driven at; None for several."""
    names, theta = fit.model.names, fit.model.theta
    if "coulomb_voltage" not in names:
        return None
    level = _only_level(fit)
    if level == 0.0:
        return None
    friction, gain = names.index("coulomb_voltage"), names.index("gain")
    driven = level - float(theta[friction])
    change = np.zeros(len(names))
    change[friction] = 1.0
    change[gain] = theta[gain] / (np.sign(level) * max(np.sign(level) * driven, _LEVEL * abs(level)))
    return change


def _only_level(fit: Fit) -> float:
    """The mean of the inputs that drive a motor where they are as good as one, in one direction or both; 0 where they aren't.

    Friction brakes whichever way the shaft turns, so that its level has no sign; the constant of a motor that turns one way has.
    """
    u = np.concatenate([record.data.u for record in fit.records])
    driving = u[np.abs(u) >= _LEVEL * np.abs(u).max(initial=0.0)]
    if fit.model.structure.friction:
        driving = np.abs(driving)
    if not len(driving) or np.ptp(driving) > ALIKE * np.abs(driving).max():
        return 0.0
    return float(driving.mean())


def _floors(fit: Fit, known: Mapping[str, Experience], shares: Mapping[str, float]) -> Array:
    """The covariance (P, P) by which recordings of one motor disagree at the least, as far as that counts."""
    names = fit.model.names
    out = np.zeros((len(names), len(names)))
    at = {"lag": names.index("time_constant")} | {name: n for n, name in enumerate(names)}
    at_one_speed = _at_one_speed(fit)
    for name, each in known.items():
        floor = (shares[name] * _floor(fit, name, each)) ** 2
        if name == "coulomb_voltage" and at_one_speed is not None:
            out += floor * np.outer(at_one_speed, at_one_speed)  # the speed is known beside it
        else:
            out[at[name], at[name]] += floor
    if known["gain"] is not ONE_LEVEL:
        out += (shares["gain"] * _floor(fit, "gain", known["gain"])) ** 2 * _of_friction(fit)
    out += shares["gain"] ** 2 * (_of_reversals(fit) + _of_directions(fit))
    out += (shares["lag"] * _floor(fit, "lag", known["lag"])) ** 2 * _of_short_records(fit, _lag(fit))
    if "delay" in at:
        split = np.zeros(len(names))
        split[at["time_constant"]], split[at["delay"]] = 1.0, -1.0
        lag, step = known["lag"], max(record.data.sample_time for record in fit.records)
        apart = lag.split / lag.lag * _floor(fit, "lag", lag)
        out += (shares["lag"] * apart) ** 2 * np.outer(split, split)
        out[at["lag"], at["lag"]] += (shares["lag"] * 0.5 * step / TWO_SIDED) ** 2
    return out
