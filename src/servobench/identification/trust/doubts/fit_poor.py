"""A simulation that explains little."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, info, warning
from servobench.core.rounding import share_explained, with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.models.motion import steady_speed
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

_LITTLE = 50.0  # percent of the output
_BY_CHANCE = 3.0  # standard deviations of the correlation of neighbours in white noise
_MOST = 80.0  # percent of the means over half a time constant: what is left of the samples changes faster than a motor can
_FEWEST = 3  # samples of a mean
_BLOCKS = 50  # of them at least
_HIDDEN = 4.0  # standard deviations of what is left: about the range of a ripple
_PLAIN = 10.0  # Fisher's F of what the model explains: noise has 1


def _poor(fit: Fit) -> list[Finding]:
    # Of a motor that turns at one speed in each record, noise is all that is left to explain beside the mean.
    if fit.fit_percent >= _LITTLE or all(steady_speed(record.data) is not None for record in fit.records):
        return []
    explained = f"The simulation explains {share_explained(fit.fit_percent)} of the output"
    if _leaves_noise(fit) or _explains_means(fit):
        data = fit.records[0].data
        size = with_unit(fit.residual_sd, data.output_unit, 2)
        sentence = (
            f"{explained}. The rest ({size}) changes from one sample to the next as no motor does, and comes from the sensor: "
            "record with a finer one, or the same step several times."
        )
        return [info("fit-poor", sentence)]
    if (step := _step_within_ripple(fit)) > 0.0:
        data = fit.records[0].data
        sentence = (
            f"{explained}: the input changes the speed by {with_unit(step, data.output_unit, 2)}, and besides it varies by "
            f"{with_unit(fit.residual_sd, data.output_unit, 2)}. Let the input change by more, if the columns are the right ones."
        )
        return [warning("fit-poor", sentence)]
    return [warning("fit-poor", f"{explained}: the model or the columns are wrong.")]


def _step_within_ripple(fit: Fit) -> float:
    """By how much the input changes a speed [output unit], where a ripple hides that; 0 where it doesn't.

    The motor turns much faster all the time, so that the columns may well be the right ones.
    """
    if any(record.data.kind != "speed" for record in fit.records):
        return 0.0
    predictions = np.concatenate([record.prediction[record.valid] for record in fit.records])
    size, slowest = float(np.ptp(predictions)), float(np.abs(predictions).min())
    is_hidden = size < _HIDDEN * fit.residual_sd < slowest
    return size if is_hidden else 0.0


def _leaves_noise(fit: Fit) -> bool:
    """Whether neighbours in what is left have nothing in common, and more is explained than chance explains of noise.

    Those of a difference of counts are even opposed: what one row has too much, the next one lacks.
    """
    residuals = [record.residual[record.valid] for record in fit.records]
    for residual in residuals:
        rest = residual - residual.mean()
        if float(rest[1:] @ rest[:-1]) > _BY_CHANCE * float(rest @ rest) / np.sqrt(len(rest)):
            return False
    samples, unknown = sum(map(len, residuals)), len(fit.vector)
    left = (1.0 - fit.fit_percent / 100.0) ** 2
    return fit.fit_percent > 0 and (1.0 - left) * (samples - unknown) > _PLAIN * left * unknown


def _explains_means(fit: Fit) -> bool:
    """Whether the simulation explains most of the output's means over half a time constant, which hold what a motor does.

    The errors of a speed that was differenced over several rows have a few neighbours in common, and no more.
    """
    if "time_constant" not in fit.model.names:
        return False
    left, all_of_it = 0.0, 0.0
    for record in fit.records:
        residual = record.residual[record.valid]
        y = record.prediction[record.valid] + residual
        length = min(round(0.5 * fit.model["time_constant"] / record.data.sample_time), len(y) // _BLOCKS)
        if length < _FEWEST:
            return False
        means, misses = (
            each[: len(y) // length * length].reshape(-1, length).mean(axis=1) for each in (y, residual)
        )
        left += float(misses @ misses)
        all_of_it += float(np.sum((means - means.mean()) ** 2))
    return left < (1.0 - _MOST / 100.0) ** 2 * all_of_it


DOUBTS.member("fit_poor")(Doubt(codes=("fit-poor",), about_fit=_poor))
