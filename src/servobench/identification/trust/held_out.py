"""Is the model right on data that it wasn't fitted to? Records, input levels or stretches are left out in turn.

Each part left out contains a transient: the steady tail of a step would only test the gain once more, and any model passes
that.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.finding import Finding, info, warning
from servobench.core.rounding import count_text, plain, share_explained
from servobench.identification.estimators.base import Estimator, Fit, FittedRecord, fit_percent
from servobench.identification.estimators.output_error import simulate_record, with_start_fitted
from servobench.identification.estimators.prediction_error import maximum_likelihood
from servobench.identification.models.common_parameters import ONE_WAY
from servobench.identification.models.motion import turns_both_ways
from servobench.identification.result import RecordFit, Validation
from servobench.identification.trust.doubts.structure_wrong import likeness
from servobench.recordings.measurement.dataset import Dataset

_FOLDS = 8  # fits at the most
_STRETCHES = 3
_LEVELS = range(3, 13)  # of two levels one alone can't tell gain from friction
_SEGMENTS = 40
_DWELL = 10  # samples at a level, for it to count as one
_SAME = 0.01  # of the input's range: levels that are nearer are the same
_TRANSIENT = 0.1  # of the input's range: what changes by less is no transient
_LARGE = 100_000  # samples, beyond which one stretch is left out instead of each
_NO_LAG = 10.0  # times what was recorded
_UNTOLD = 0.02  # of the output's variation: a prediction less certain than that says nothing about the model
_PREDICTS = (
    80.0  # % of what it wasn't fitted to: a model that predicts more of its own recording is no wrong one
)
_AS_NEAR = 4.0  # times what the fit to the rest leaves and its intervals foretell
_ALLOWED = 2.5  # times that: what another recording may miss, whose motor or state is never quite the same
_NOTICED = 5.0  # % of its output: less doesn't matter
_CERTAIN = 2.0  # % of it, where it is missed by far more than that
_WORST = 0.5  # % of the output unexplained, below which a difference doesn't matter
_STILL = 0.02  # of the motion in all data: a part that neither moves nor is missed by more is no test
# Times the misfit that the rest of the data foretell. A right model behind an ideal encoder reached 1.03 in 50 records, and
# 4.2 in 12 under a white torque, which lets the position wander.
_BEYOND = 8.0
# Percent of the output: a random torque that accounts for what is left beyond it may as well be a wrong model, if no test tells.
_BY_TORQUE = 90.0
_AT_ONCE = 0.3  # the correlation of what is left with itself a sample later, below which it is no motion


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """The part that is left out, its name, and the rest."""

    name: str
    held: tuple[Dataset, ...]
    """The part left out."""
    rest: tuple[Dataset, ...]
    """The part that the model is fitted to."""


def cross_validate(estimator: Estimator, data: Sequence[Dataset], fit: Fit) -> Validation | None:
    """Return how well the model simulates what it wasn't fitted to; None where nothing can be left out.

    Of several records each is left out in turn (8 of them at the most, spread evenly). Of one record it is each level of the
    input where there are at least three; otherwise each of three stretches that begin with a change of the input. A part
    without a transient isn't used, nor one in which the shaft rightly stands, nor one of which the rest of the data says nothing.
    Where the fit has a random torque, the rest is fitted under that torque's noise (decision 0071). Of what is left out only
    the start states are fitted.
    """
    how, parts = cuts_for_validation(data)
    held = []
    for part in parts:
        tried = _try_part(estimator, fit, part)
        if tried is not None:
            held.append(tried)
    if not held:
        return None
    records = [record for each, _ in held for record in each]
    return Validation(
        how=how(len(held)),
        fit_percent=fit_percent(records),
        records=tuple(fitted for _, fitted in held),
    )


def cuts_for_validation(data: Sequence[Dataset]) -> tuple[Callable[[int], str], Iterator[Part]]:
    """Return how parts are left out, in words for a number of them, and the parts, as `cross_validate` tries them."""
    return _several(data) if len(data) > 1 else _one(data[0])


def validate_with(fit: Fit, data: Sequence[Dataset]) -> Validation:
    """Return how well the model simulates other records; only their start states are fitted.

    Raises `UsageError` for a record that says too little even for that.
    """
    try:
        held = [simulate_record(fit.model.structure, fit.model.theta, record) for record in data]
    except NotIdentifiable as error:
        raise UsageError(f"the data to validate on can't be used: {error}") from error
    return Validation(
        how=f"simulated {count_text(len(held), 'other record')} that it wasn't fitted to",
        fit_percent=fit_percent(held),
        records=tuple(_other_record(record, fit) for record in held),
    )


def _other_record(record: FittedRecord, fit: Fit) -> RecordFit:
    """How well a record is simulated that has a sensor of its own: what it misses from sample to sample is that one's noise."""
    left = record.residual[record.valid]
    noise = float(np.std(np.diff(left))) / np.sqrt(2.0) if len(left) > 1 else 0.0
    same = record.data.kind == fit.records[0].data.kind
    own = max(fit.residual_sd, noise) if same else noise
    return _record_fit(record.data.name, [record], _foretold([record], fit), own)


def about_validation(
    fit: Fit, validation: Validation | None, others: Sequence[Dataset] = ()
) -> list[Finding]:
    """Return what a validation says about a fit: that there is none, that it is poor, or which part isn't predicted.

    `others` are the records that it was tried on, where they aren't parts of those that it was fitted to.
    """
    if validation is None:
        return [_not_validated(fit)]
    reversing = [record.name for record in others if turns_both_ways([*_training_data(fit), record])]
    if ONE_WAY in fit.model.structure.parameters and reversing and validation.fit_percent < 100 - _WORST:
        return [_reverses(reversing[0], validation.fit_percent)]
    worst = max(validation.records, key=lambda record: record.beyond)
    stands_out = worst.beyond > _BEYOND and 100 - worst.fit_percent > _WORST and len(validation.records) > 1
    if validation.fit_percent < 50:
        return [_poor(validation)]
    say = warning if validation.fit_percent < _PREDICTS or others else info
    if stands_out:
        return [say("validation-worse", _text_of_odd(worst, len(fit.records)))]
    missing, unseen = 100 - fit.fit_percent, 100 - validation.fit_percent
    if others:
        worse = [(each.name, each.fit_percent) for each in validation.records if _is_foreign(each)]
    # A part in which the speed hardly varies is explained to few percent by a model that is as near to it as elsewhere.
    elif unseen > max(2.0, 5 * missing) and worst.beyond > _AS_NEAR:
        worse = [("the rest", validation.fit_percent)]
    else:
        worse = []
    return [
        say(
            "validation-worse",
            f"The model explains {fit.fit_percent:.1f} % of the data it was fitted to, but only {percent:.1f} % of {what}: "
            "another motor, another operating point, or overfitting.",
        )
        for what, percent in worse[:1]
    ]


def _poor(validation: Validation) -> Finding:
    least = min(validation.records, key=lambda record: record.fit_percent)
    several = len(validation.records) > 1
    name = f" Worst is {least.name} ({share_explained(least.fit_percent)})." if several else ""
    explained = share_explained(validation.fit_percent)
    sentence = f"On data it wasn't fitted to, the model explains {explained} of the output.{name}"
    return warning("validation-poor", sentence)


def _text_of_odd(odd: RecordFit, records: int) -> str:
    """The sentence on a part that the rest of so many records doesn't predict."""
    elsewhere = ", or in another of the records" if records > 1 else ""
    return (
        f"Fitted to the rest of the data, the model doesn't predict {odd.name}: it misses {100 - odd.fit_percent:.1f} % of the "
        f"output there, {odd.beyond:.0f} times what the rest predicts. The motor, the supply or the amplifier may have been "
        f"different there{elsewhere}, or a row may be missing. Or it moves there as nowhere else, and shows what the model "
        "leaves out, such as a dead zone. Identify with and without it, and compare."
    )


def _is_foreign(record: RecordFit) -> bool:
    """Whether another recording is missed by more than residual and intervals allow for, however much that is."""
    least = _NOTICED if record.beyond < _BEYOND else _CERTAIN
    return record.beyond > _ALLOWED and 100 - record.fit_percent > least


def _not_validated(fit: Fit) -> Finding:
    """A finding that no part was left out: there is none, or the rest says too little to predict it."""
    untested = "couldn't be tested on held-out data"
    if next(cuts_for_validation(_training_data(fit))[1], None) is None:
        why = "the input must change both in the part left out and in the rest"
        remedy = "Record a second run, or an input that changes more than once."
        return info("not-validated", f"The model {untested}: {why}. {remedy}")
    why = f"{untested}: whatever part is left out, the rest determines the model too poorly to predict it"
    remedy = "Record a second run, or an input that changes more often."
    if fit.disturbance is None or fit.fit_percent > _BY_TORQUE or _leaves_noise(fit):
        return info("not-validated", f"The model {why}. {remedy}")
    missed = f"the {plain(100.0 - fit.fit_percent, 2)} % of the output that it misses"
    what = missed if fit.fit_percent > 0.0 else "all of the output"
    sentence = f"The model takes {what} for a random torque, and {why}. {remedy}"
    return warning("not-validated", sentence)


def _leaves_noise(fit: Fit) -> bool:
    """Whether what is left changes at once, so that it comes from the sensor, and isn't the structure's."""
    return all(likeness(record) < _AT_ONCE for record in fit.records)


def _training_data(fit: Fit) -> list[Dataset]:
    return [record.data for record in fit.records]


def _reverses(name: str, percent: float) -> Finding:
    """A finding that a model of a motor that turned one way was tried on one that turns round."""
    sentence = (
        f"The model was fitted to a motor that turned one way only, and tested on {name}, where it "
        "also turns the other way: friction changes sign there, but the model has it as a "
        f"constant voltage. The {percent:.0f} % of the output explained there says nothing about "
        "gain and time constant. Fit both recordings together, or test the model on one that "
        "turns the same way."
    )
    return warning("validation-reverses", sentence, parameters=("coulomb_voltage",))


def _try_part(estimator: Estimator, fit: Fit, part: Part) -> tuple[list[FittedRecord], RecordFit] | None:
    """A part simulated by a model fitted to the rest; None where the rest can't support one or doesn't tell."""
    structure, theta = fit.model.structure, fit.model.theta
    if estimator.supports(structure, part.rest) is not None or _turns_where_the_rest_does_not(fit, part):
        return None
    try:
        starts = [_start(fit, record) for record in part.rest]
        other = estimator.fit(structure, part.rest, (np.concatenate([theta, *starts]),))
        # Under the noise of the whole: another search for it in each part takes long, and a part says less of it.
        vector = other.vector if fit.disturbance is None else maximum_likelihood(other, fit.disturbance)
        held = [simulate_record(structure, vector[: len(theta)], record) for record in part.held]
    except NotIdentifiable:
        return None
    if _shows_no_lag(other):
        return None
    foretold = _foretold(held, other)
    still = max(_motion(held), _misfit(held)) < _STILL * _motion(fit.records)
    if still or not foretold < _UNTOLD * _variation(held):
        return None
    return held, _record_fit(part.name, held, foretold, other.residual_sd)


def _shows_no_lag(fit: Fit) -> bool:
    """Whether a fit ended at a motor that doesn't follow its input in all of the time recorded, as any of a steady speed may.

    Gain and time constant are known as a quotient there and not at all by themselves, which no covariance holds.
    """
    time = sum(record.data.duration for record in fit.records)
    return "time_constant" in fit.model.names and fit.model["time_constant"] > _NO_LAG * time


def _turns_where_the_rest_does_not(fit: Fit, part: Part) -> bool:
    """Whether a part turns the other way than the rest, which then tells what two constants take of the input as a sum only."""
    constants = [name for name in fit.model.names if name == "offset_voltage" or name.startswith("coulomb")]
    return len(constants) > 1 and turns_both_ways([*part.rest, *part.held]) and not turns_both_ways(part.rest)


def _start(fit: Fit, data: Dataset) -> Array:
    """The nuisance parameters (Q,) for a part to start from: the fit's own where it begins with a record, else fitted to it."""
    whole = len(fit.records) == 1
    for record in fit.records:
        if record.data is data or (whole and record.data.t_output[0] == data.t_output[0]):
            return record.nuisance
    theta = fit.model.theta
    return with_start_fitted(fit.model.structure, theta, data).theta[len(theta) :]


def _record_fit(name: str, held: Sequence[FittedRecord], foretold: float, noise: float) -> RecordFit:
    expected = float(np.hypot(noise, foretold))
    return RecordFit(
        name=name,
        samples=sum(int(record.valid.sum()) for record in held),
        fit_percent=fit_percent(held),
        beyond=_misfit(held) / expected if expected > 0 else 0.0,
    )


def _foretold(held: Sequence[FittedRecord], fit: Fit) -> float:
    """The standard deviation (root mean square) of predictions that the parameters' covariance makes, start states fitted."""
    shared = len(fit.model.theta)
    total, samples = 0.0, 0
    for record in held:
        theta = np.concatenate([fit.model.theta, record.nuisance])
        jacobian = fit.model.structure.predict(theta, record.data).jacobian[record.valid]
        own = np.linalg.qr(jacobian[:, shared:])[0]
        slopes = jacobian[:, :shared] - own @ (own.T @ jacobian[:, :shared])
        gram = slopes.T @ slopes
        # A parameter that is held or unknown has no part where nothing moves with it.
        matters = np.diag(gram) > 0
        total += float(np.sum(gram[np.ix_(matters, matters)] * fit.covariance[np.ix_(matters, matters)]))
        samples += len(slopes)
    return float(np.sqrt(max(total, 0.0) / max(samples, 1)))


def _variation(held: Sequence[FittedRecord]) -> float:
    """The standard deviation of the output, over all parts that are left out."""
    spread = [record.data.y[record.valid] - record.data.y[record.valid].mean() for record in held]
    return float(np.sqrt(np.mean(np.concatenate(spread) ** 2)))


def _misfit(held: Sequence[FittedRecord]) -> float:
    """The root mean square of what is missed, over all parts that are left out."""
    return float(np.sqrt(np.mean(np.concatenate([record.residual[record.valid] for record in held]) ** 2)))


def _motion(records: Sequence[FittedRecord]) -> float:
    """How much the shaft moves: the variation of a position, or the root mean square of a speed."""
    if records[0].data.kind == "position":
        return _variation(records)
    return float(np.sqrt(np.mean(np.concatenate([record.data.y[record.valid] for record in records]) ** 2)))


def _several(data: Sequence[Dataset]) -> tuple[Callable[[int], str], Iterator[Part]]:
    usable = [n for n, record in enumerate(data) if _has_transient(record, _range(data))]
    chosen = sorted({usable[int(k)] for k in np.linspace(0, len(usable) - 1, min(_FOLDS, len(usable)))})
    of = "" if len(chosen) == len(data) else f" (of {len(data)})"
    parts = (
        Part(name=record.name, held=(record,), rest=tuple(each for k, each in enumerate(data) if k != number))
        for number, record in ((n, data[n]) for n in chosen)
    )
    return partial(_how, f"record{of}", f"records{of}", "the others"), parts


def _one(data: Dataset) -> tuple[Callable[[int], str], Iterator[Part]]:
    edges = _edges(data)
    levels = _levels(data, edges)
    if levels:
        return partial(_how, "input level", "input levels", "the other levels"), _by_level(
            data, edges, levels
        )
    if len(data.y) > _LARGE:
        return (lambda _: "the last third of the record simulated by a model fitted to the rest"), _by_time(
            data, edges
        )
    return partial(_how, "stretch of the record", "stretches of the record", "the others"), _by_time(
        data, edges
    )


def _how(part: str, several: str, others: str, number: int) -> str:
    """The way in which so many parts were left out, in words."""
    if number == 1:
        return f"one {part} simulated by a model fitted to the rest"
    return f"each of {number} {several} simulated by a model fitted to {others}"


def _range(data: Sequence[Dataset]) -> float:
    """The range of the input over all records, what held before them included."""
    low = min(min(float(record.u.min()), record.input_before) for record in data)
    high = max(max(float(record.u.max()), record.input_before) for record in data)
    return high - low


def _has_transient(data: Dataset, whole: float) -> bool:
    """Whether the input changes in a record, by a part of its whole range that matters, and early enough to be answered."""
    answered = data.t_input < data.t_output[-1] - 5 * data.sample_time
    u = np.append(data.u[answered], data.input_before)
    return bool(np.ptp(u) > _TRANSIENT * whole)


def _edges(data: Dataset) -> Array:
    """The times [s] at which the input changes by more than chance, after the first sample of the output."""
    before = np.concatenate([[data.input_before], data.u[:-1]])
    changes = np.abs(data.u - before) > _SAME * _range([data])
    return np.asarray(data.t_input[changes & (data.t_input > data.t_output[0])], dtype=np.float64)


def _levels(data: Dataset, edges: Array) -> list[float]:
    """The levels of an input that holds each of at least three for a while, ascending; none where it isn't like that."""
    bounds = _bounds(data, edges)
    if len(bounds) - 1 > _SEGMENTS or np.median(np.diff(bounds)) < _DWELL * data.sample_time:
        return []
    levels: list[float] = []
    for level in sorted(_level_at(data, start) for start in bounds[:-1]):
        if not levels or level - levels[-1] > _SAME * _range([data]):
            levels.append(level)
    return levels if len(levels) in _LEVELS else []


def _bounds(data: Dataset, edges: Array) -> Array:
    """The times [s] between which the input holds, from the first sample of the output to behind the last."""
    end = data.t_output[-1] + data.sample_time
    return np.asarray(np.concatenate([[data.t_output[0]], edges, [end]]), dtype=np.float64)


def _level_at(data: Dataset, time: float) -> float:
    """The input that holds from a time [s] on."""
    index = int(np.searchsorted(data.t_input, time, side="right")) - 1
    return float(data.u[index]) if index >= 0 else data.input_before


def _by_level(data: Dataset, edges: Array, levels: Sequence[float]) -> Iterator[Part]:
    """Each level left out with the transients that lead to it; 8 of them at the most, spread evenly."""
    bounds, whole = _bounds(data, edges), _range([data])
    nearest = np.array([int(np.argmin(np.abs(np.array(levels) - _level_at(data, t)))) for t in bounds[:-1]])
    for n in sorted({int(k) for k in np.linspace(0, len(levels) - 1, min(_FOLDS, len(levels)))}):
        held = [r for r in _runs(data, bounds, nearest == n) if _has_transient(r, whole)]
        rest = _runs(data, bounds, nearest != n)
        if held and rest:
            name = f"the level of {levels[n]:.4g} {data.input_unit}"
            yield Part(name=name, held=tuple(held), rest=tuple(rest))


def _by_time(data: Dataset, edges: Array) -> Iterator[Part]:
    """Each stretch left out; they begin with changes of the input, those nearest to the thirds of the record."""
    thirds = data.t_output[0] + data.duration * np.arange(1, _STRETCHES) / _STRETCHES
    cuts = np.unique([edges[np.argmin(np.abs(edges - third))] for third in thirds]) if len(edges) else edges
    bounds, whole = _bounds(data, cuts), _range([data])
    count = len(bounds) - 1
    for n in range(count) if len(data.y) <= _LARGE else [count - 1]:
        own = np.arange(count) == n
        held, rest = _runs(data, bounds, own), _runs(data, bounds, ~own)
        if rest and held and all(_has_transient(record, whole) for record in held):
            end = min(float(bounds[n + 1]), float(data.t_output[-1]))
            yield Part(
                name=f"the stretch from {bounds[n]:.4g} s to {end:.4g} s", held=tuple(held), rest=tuple(rest)
            )


def _runs(data: Dataset, bounds: Array, wanted: Array) -> list[Dataset]:
    """The stretches between bounds that are wanted, neighbours in one piece; those too short for a start state are left out."""
    runs, start = [], None
    for n, keep in enumerate([*wanted, False]):
        if keep and start is None:
            start = float(bounds[n])
        elif not keep and start is not None:
            end = float(bounds[n])
            inside = (data.t_output >= start) & (data.t_output < end)
            if np.count_nonzero(inside) >= _DWELL:
                runs.append(data.part(start, end))
            start = None
    return runs
