"""The noise model that fits the residuals: the encoder's rounding, a random torque, or neither."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.errors import NotIdentifiable
from servobench.core.finding import info
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators import delay_prior
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.estimators.budget import Contribution
from servobench.identification.estimators.covariance import inverse
from servobench.identification.estimators.encoder_rounding import is_rounded
from servobench.identification.estimators.misfit_covariance import allow_for_misfit
from servobench.identification.estimators.prediction_error import (
    THRESHOLD,
    PredictionError,
    disturbance_test,
    rounding_explains,
)
from servobench.identification.estimators.repetition import period, repeats, stretches_repeat
from servobench.identification.models.motion import turns_both_ways
from servobench.identification.trust.validation import explains_the_colour, is_plainly_coloured
from servobench.identification.uncertainty.score_test import innovations_and_jacobian

_LASTS = 1.5  # times what white noise would make: from there on the rounding of a shaft at rest is what makes intervals wide
_WORTH = 0.64  # the product of two parameters' standard deviations over what they were: a fifth less of each
_ASTRAY = 100.0  # times the sum of squares, ten times as far from the record: no random torque leads an estimate there
_LOWER = 1.0 - 1e-3  # times: a sum of squares that is lower by less is that of the same minimum
_DETERMINED = 0.5  # of the scale of the prior of the delay: with what the prior adds the standard deviation would be a tenth less
_AGREES = 3.0  # standard deviations of the wider estimate


def as_it_is(fit: Fit) -> Fit:
    """Return the fit itself, of an estimator that was requested by its name."""
    return fit


def allow_for_disturbance(fit: Fit) -> Fit:
    """Return the fit itself, or prediction error's where the residuals say that a random torque acts on the motor.

    Where every count is where it should be there is nothing to allow for, or nothing but rounding.
    Where nothing speaks for a random torque a faint colour is chance, or the sandwich of output error has allowed for it. Where
    a random torque leaves coloured innovations it isn't what acts on the motor; then output error is the safer of two wrong
    noise models, with a covariance that allows for what the other one makes of the same data. Where prediction
    error ends in a place with a lower sum of squares, output error had stopped in a local minimum, and searches again from there.
    """
    if any(finding.code == delay_prior.CODE for finding in fit.findings):
        return _torque_fit_if_delay_known(fit)
    counted = _where_rounding_repeats(fit)
    if counted is not None:
        return counted
    if rounding_explains(fit):
        return fit
    test = disturbance_test(fit)
    if test is None:
        return fit
    allowing = fit
    if test.likelihood_ratio > THRESHOLD:
        counted = _by_counts(fit)
        if counted is not None:
            return counted
        allowing = PredictionError().fit_after(fit, test)
        if _squares(allowing) < _LOWER * _squares(fit):
            method = ESTIMATORS["output_error"]
            data = [record.data for record in fit.records]
            lower = method.fit(fit.model.structure, data, [allowing.vector])
            if _squares(lower) < _LOWER * _squares(fit):  # a prior of the delay may have led elsewhere
                return allow_for_disturbance(lower)
        if _squares(allowing) > _ASTRAY * _squares(fit):
            return allow_for_misfit(fit)
    if allowing is fit and not is_plainly_coloured(fit):
        return fit
    fed_back = allowing is not fit and any(record.data.closed_loop for record in fit.records)
    return allowing if fed_back or explains_the_colour(allowing) else allow_for_misfit(fit)


def with_counts_as_bins(fit: Fit) -> Fit:
    """Return output error's fit, or that of the interval likelihood where the rounding of counts lasts and that one says more.

    A shaft at rest, or one that turns back, is rounded the same way for many samples. Output error takes the middle of each
    count for as many readings, and so errs by several times what white rounding would make; its intervals say so. A count that
    counts as the bin that it is says no more than that the shaft was in it.
    """
    if fit.estimator != "output_error" or fit.budget or not _rounding_lasts(fit):
        return fit
    data = [record.data for record in fit.records]
    counts = ESTIMATORS["interval_likelihood"]
    if counts.supports(fit.model.structure, data) is not None:
        return fit
    counted = counts.fit(fit.model.structure, data, [fit.vector])
    if any(finding.severity != "info" for finding in counted.findings) or not _is_more_informative(
        counted, fit
    ):
        return fit
    sentence = (
        "Where the shaft rests or turns back, the encoder rounds many samples the same way, which doesn't average "
        "out. The estimator interval_likelihood uses each count's whole bin and determines the motor better."
    )
    return replace(counted, findings=(*counted.findings, info("rounding-lasts", sentence)))


def _rounding_lasts(fit: Fit) -> bool:
    """Whether gain or time constant has a far wider interval than white rounding would make, and the data tell the delay."""
    delay_is_known = all(finding.code != delay_prior.CODE for finding in fit.findings)
    if not delay_is_known or not {"gain", "time_constant"} <= set(fit.model.names):
        return False
    if not all(is_rounded(record.data) and record.valid.all() for record in fit.records):
        return False
    jacobian, _ = innovations_and_jacobian(fit)
    white = np.diag(inverse(jacobian.T @ jacobian))
    at = [fit.model.names.index(name) for name in ("gain", "time_constant")]
    return bool(np.any(np.diag(fit.covariance)[at] > _LASTS**2 * white[at]))


def _is_more_informative(counted: Fit, fit: Fit) -> bool:
    """Whether one fit determines gain and time constant much better than another, and agrees with its parameters."""
    apart = np.abs(counted.model.theta - fit.model.theta)
    own = np.sqrt(np.diag(fit.covariance))
    smaller = np.prod([counted.sd(name) / fit.sd(name) for name in ("gain", "time_constant")])
    return bool(smaller < _WORTH and np.all(apart <= _AGREES * own))


def _squares(fit: Fit) -> float:
    """The sum of squares of what a simulation with the fit's parameters leaves over."""
    return sum(float(np.sum(record.residual[record.valid] ** 2)) for record in fit.records)


def _torque_fit_if_delay_known(fit: Fit) -> Fit:
    """The fit with a random torque, if it explains the residuals and determines the delay.

    Output error took the delay from its prior. Otherwise another search would slide along the valley of undetermined delays, so
    the fit stays; and where several places are as good, as it would know one of them only. Where a motor turns back again and
    again it is the wrong noise model that can't tell them apart.
    """
    data = [record.data for record in fit.records]
    if delay_prior.is_in_several_places(fit) and not turns_both_ways(data):
        return fit
    test = None if rounding_explains(fit) else disturbance_test(fit)
    if test is None or test.likelihood_ratio <= THRESHOLD:
        return fit
    try:
        allowing = PredictionError().fit_after(fit, test)
    except NotIdentifiable:  # too few blocks of samples that a random torque leaves apart
        return fit
    prior = delay_prior.prior_of_delay(fit.model.structure, data)
    if prior is None or not allowing.sd("delay") < _DETERMINED * prior.scale:
        return fit
    if allowing.model["delay"] < -TWO_SIDED * allowing.sd("delay"):
        return fit  # in a loop it is the torque that comes first, and the input that answers
    return allowing if explains_the_colour(allowing) else allow_for_misfit(fit)


def _where_rounding_repeats(fit: Fit) -> Fit | None:
    """The fit of the interval likelihood where a motor goes to and fro over the same counts; None where that isn't so.

    Rounding then repeats with the input, and no average over the record makes it less. Taken as bins, the counts say more. But a
    few distinct errors decide, so that by how much the two estimates differ is part of the covariance.
    """
    data = [record.data for record in fit.records]
    again = any(
        record.data.quantum and (cycle := period(record.data)) and repeats(record.residual, cycle)
        for record in fit.records
    ) or (
        all(record.quantum and record.closed_loop for record in data)
        and stretches_repeat(data, [record.residual for record in fit.records])
    )
    if not (fit.model.structure.friction and again):
        return None
    counts = ESTIMATORS["interval_likelihood"]
    if counts.supports(fit.model.structure, data) is not None:
        return None
    counted = counts.fit(fit.model.structure, data, [fit.vector])
    if any(finding.severity != "info" for finding in counted.findings):
        return None
    sentence = (
        "The motor moves back and forth over the same counts, so the encoder's rounding repeats with the input and "
        "doesn't average out. The estimator interval_likelihood uses each count's whole bin."
    )
    apart = counted.model.theta - fit.model.theta
    line = Contribution(
        source="another estimator",
        covariance=np.outer(apart, apart),
        reason=(
            "output_error, which uses the middle of each count, gives a different value, as only a few "
            "distinct roundings determine it"
        ),
    )
    findings = (*counted.findings, info("rounding-repeats", sentence))
    return replace(counted.widen(line), findings=findings)


def _by_counts(fit: Fit) -> Fit | None:
    """The fit of the interval likelihood where rounding alone looks like a random torque; None where it isn't that.

    Where speed and encoder beat slowly (nearly a whole number of counts in each few samples), rounding wanders like a shaft under
    a random torque. But it leaves each count where it belongs, which a torque doesn't.
    """
    if not rounding_explains(fit, times=5.0):
        return None
    data = [record.data for record in fit.records]
    counted = ESTIMATORS["interval_likelihood"].fit(fit.model.structure, data, [fit.vector])
    if not rounding_explains(counted, times=0.5):
        return None
    sentence = (
        "The encoder's rounding varies slowly in these data, as the speed is close to a simple fraction of counts "
        "per sample. The estimator interval_likelihood allows for it; output_error would mistake it for motion."
    )
    return replace(counted, findings=(*counted.findings, info("rounding-beats", sentence)))
