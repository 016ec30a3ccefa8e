"""An output that comes before its cause."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Finding, Severity, info, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.covariance import effective_samples
from servobench.identification.estimators.least_squares import NormalEquations, jacobian_and_residual, lowest
from servobench.identification.models.base import as_protocol
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.feedback import answers_to_output
from servobench.recordings.measurement.dataset import Dataset

# Of a shaft that carries its load by a spring, the zeros lead: a fast pole and a delay of minus its time constant together follow
# the input at once. Their sum says when the output begins.
_LAGS = ("delay", "electrical_time_constant")
_CHANGES_ALL_THE_TIME = 0.5  # of the rows
_ROWS = np.array([3.0, 6.0, 12.0, 24.0, 48.0])  # by which the input may be late
_PART = 0.1  # of a record
_STEPS = 30  # of a search: what isn't much lower by then doesn't become the best
_LEFT = 0.6  # of the squared residuals may be left
_LIKELIER = 20.0  # in twice the logarithm of a likelihood: five places that are tried reach it by chance once in a thousand
_SEEN = 0.1  # of a sample time: what is less nobody looks for
_CHANGED = 0.05  # of the input's range: what is less may be the noise of a voltage that was measured
_OUT_OF_STEP = 0.6  # of a sample time: a speed that was differenced ahead of its row comes half of one early


def _delay(fit: Fit) -> list[Finding]:
    """Whether the output comes before its cause, and the search hasn't said so already."""
    names = fit.model.names
    if "delay" not in names:
        return []
    reported = any(f.parameters == ("delay",) and f.severity is Severity.WARNING for f in fit.findings)
    if reported:
        return []
    data = fit.records[0].data
    lag, sd = _sum_of(fit, _LAGS)
    earliest = -_OUT_OF_STEP * data.sample_time
    if lag < earliest and (lag < -3 * sd or _upper(fit) < earliest or _is_ahead_of_all(fit)):
        least = "at least " if _is_at_its_shortest(fit) else ""
        return [_finding(f"{least}{with_unit(-lag, 's', 3)}")]
    # A motor can't follow its input in less than no time, however long each of the two lags is by itself.
    whole, sd = _sum_of(fit, (*_LAGS, "time_constant"))
    halved = 0.5 * data.sample_time if data.kind == "speed" else 0.0
    if "time_constant" in names and whole + 3 * sd < -halved:
        changes = np.mean(np.diff(data.u) != 0) > _CHANGES_ALL_THE_TIME
        if changes and whole + 3 * sd > -halved - 0.5 * data.input_step:
            return [_between_rows(whole, data.input_step)]
        return [_finding(with_unit(-whole, "s", 3))]
    if lag < -_SEEN * data.sample_time and (early := _earlier_still(fit)):
        return [_finding(f"about {with_unit(early, 's', 2)}")]
    is_seen = earliest <= lag < -_SEEN * data.sample_time and _upper(fit) < 0.0
    return [_within_row(lag)] if is_seen else []


def _sum_of(fit: Fit, names: Sequence[str]) -> tuple[float, float]:
    """The sum of those parameters that the model has [s], and its standard deviation.

    Nothing else is in the sum: what isn't known has an infinite variance. Parameters may be known as a sum only: its variance can
    then be rounding error, of either sign.
    """
    summed = [at for at, name in enumerate(fit.model.names) if name in names]
    variance = float(fit.covariance[np.ix_(summed, summed)].sum())
    return float(fit.model.theta[summed].sum()), float(np.sqrt(max(variance, 0.0)))


def _upper(fit: Fit) -> float:
    """The upper end of the delay's interval [s]; infinite where a lag belongs to the same sum."""
    return np.inf if "electrical_time_constant" in fit.model.names else fit["delay"].interval[1]


def _finding(early: str) -> Finding:
    sentence = f"The output comes {early} before the input that causes it: the two columns are misaligned."
    return warning("delay-negative", sentence, parameters=("delay",))


def _between_rows(whole: float, step: float) -> Finding:
    """What to say of a lag below zero by no more than the half row that a sampled input seems to come late by."""
    sentence = (
        f"Time constant and delay together are below zero, {with_unit(whole, 's', 3)}: what the input does between its rows, "
        f"{with_unit(step, 's', 2)} apart, isn't in the file. If it changed evenly there, the two together are "
        f"{with_unit(0.5 * step, 's', 2)} longer. Record the input as often as it changes."
    )
    return warning("delay-negative", sentence, parameters=("delay", "time_constant"))


def _within_row(lag: float) -> Finding:
    """What to say of a delay that is surely below zero, by no more than rows may be out of step with each other."""
    sentence = (
        f"The output comes {with_unit(-lag, 's', 2)} before the row of the input that causes it, by less than a row: each row is "
        "written a little after its input acts, or its output belongs to a later moment than its input. That is no property of "
        "the motor; the delay that it may have is hidden in these times."
    )
    return info("delay-within-row", sentence, parameters=("delay",))


def _is_ahead_of_all(fit: Fit) -> bool:
    """Whether the delay ends at the shortest that misaligned columns allow, and the time constant below what samples resolve.

    Neither leaves any lag to the motor then, and the output would come earlier still: the delay's own interval, which no longer
    says what the data do, may reach to zero.
    """
    step = fit.records[0].data.sample_time
    has_no_lag = "time_constant" in fit.model.names and fit.model["time_constant"] < step
    return has_no_lag and _is_at_its_shortest(fit)


def _is_at_its_shortest(fit: Fit) -> bool:
    """Whether the delay ends at the shortest that misaligned columns allow: what is farther out of step looks the same."""
    shortest = fit.model.structure.bounds([record.data for record in fit.records])[0]
    return bool(fit.model["delay"] <= shortest[fit.model.names.index("delay")])


def _sets_off_in_time(record: Dataset, prediction: Array, within: float) -> bool:
    """Whether a record begins at rest, and its shaft sets off when its input makes it: that input isn't late.

    It is no sooner than an output (M,) predicted from the input in its rows is off by as far as can be seen, and at most so long
    [s] after a change of the input.
    """
    motion = record.first_motion
    if motion is None:
        return False
    changes = record.t_input[1:][np.abs(np.diff(record.u)) > _CHANGED * np.ptp(record.u)]
    visible = np.flatnonzero(np.abs(prediction - prediction[0]) > 2.0 * motion.within)
    soonest = float(record.t_output[visible[0]]) if len(visible) else np.inf
    return soonest <= motion.effect and bool(
        np.any((changes < motion.effect) & (changes >= motion.effect - within))
    )


def _earlier_still(fit: Fit) -> float:
    """By how much the output comes before its input [s], where that explains clearly more than the shortest delay; else 0.

    The search of a delay ends at two rows, and a friction that holds the shaft, or a lag of nothing, takes the place of the rest.
    """
    records, structure = [record.data for record in fit.records], fit.model.structure
    if as_protocol(structure, NormalEquations) is None or any(
        r.closed_loop or answers_to_output(r) for r in records
    ):
        return 0.0  # in a loop the input follows the output, too
    step, longest = max(r.sample_time for r in records), _PART * min(r.duration for r in records)
    if any(_sets_off_in_time(r.data, r.prediction, _ROWS[0] * step) for r in fit.records):
        return 0.0  # nothing that is tried below would be believed
    as_it_is = lowest(structure, records, structure.guesses(records))
    trials = [(as_it_is, records, 0.0)]
    for shift in (step * _ROWS[step * _ROWS < longest]).tolist():
        shifted = [replace(r, t_input=r.t_input - shift, reference=None) for r in records]
        with suppress(NotIdentifiable):  # an input that acts so early moves nothing in the record
            trials.append(
                (lowest(structure, shifted, structure.guesses(shifted), steps=_STEPS), shifted, shift)
            )
    best, shifted, shift = min(trials, key=lambda each: each[0].cost)
    ahead = float(shift - best.theta[fit.model.names.index("delay")])
    if (
        best.cost >= _LEFT * as_it_is.cost
        or ahead <= _ROWS[0] * step
        or any(_sets_off_in_time(r, p.y, ahead) for r, p in zip(records, as_it_is.predictions, strict=True))
    ):
        return 0.0
    residuals = (jacobian_and_residual(*each)[1] for each in zip(shifted, best.predictions, strict=True))
    likelier = np.log(as_it_is.cost / max(best.cost, np.finfo(float).tiny))
    return ahead if sum(map(effective_samples, residuals)) * likelier > _LIKELIER else 0.0


DOUBTS.member("delay")(Doubt(codes=("delay-negative", "delay-within-row"), about_fit=_delay))
