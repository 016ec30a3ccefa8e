"""What an encoder's rounding does to the parameters, where the model says when the shaft was where.

Rounding isn't white. A shaft at rest is rounded the same way in all samples of the rest, which so tell its position once and
not a hundred times; where it turns round or goes at a speed in step with the samples, it is nearly so. But given the path x_k of
the shaft, only its place among the counts is unknown, and that is as good as random. The error of rounding to steps Q is
a sawtooth of that place, a sum of sines of m = 1, 2, ... periods in a step, each with the variance Q²/(2π²m²), so that

    E[e_k e_l] = Σ Q²/(2π²m²) cos(2πm (x_k - x_l)/Q),   and Q²/12 for k = l

Noise of standard deviation s before the rounding takes e^(-(2πms/Q)²) of each to where neighbouring samples share it, and makes
white noise of what is missing (Widrow, Kollár and Liu 1996).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.channels import Array
from servobench.measurement.dataset import Dataset
from servobench.models.base import Prediction

_SINES = 8  # these have 93 % of Q²/12; the model doesn't know the path to a tenth of a step, as finer ones would need


def rounding_power(prediction: Prediction, data: Dataset, noise: float) -> Array | None:
    """Return the covariance (P + Q, P + Q) of J'e, e the errors of the readings; None for what isn't an encoder's position.

    `noise` is the variance s²/Q² before the rounding. What the sines don't explain of the errors counts as white.
    """
    jacobian, path = prediction.jacobian[prediction.valid], prediction.y[prediction.valid]
    if not data.quantum or data.kind != "position":
        return None
    once = np.exp(2j * np.pi * path / data.quantum)
    turning, power = np.ones_like(once), np.zeros((jacobian.shape[1], jacobian.shape[1]))
    white = 1 / 12 + noise
    for m in range(1, _SINES + 1):
        turning = turning * once
        share = float(np.exp(-((2 * np.pi * m) ** 2) * noise)) / (2 * np.pi**2 * m**2)
        both = np.column_stack([turning.real, turning.imag]).T @ jacobian
        power += share * both.T @ both
        white -= share
    power += white * jacobian.T @ jacobian
    return np.asarray(data.quantum**2 * power, dtype=np.float64)


def counts_in_place(
    data: Sequence[Dataset], residuals: Sequence[Array], unknowns: int, times: float = 2.0
) -> bool:
    """Return whether the counts are where the model and the encoder's rounding put them: then nothing else is at work.

    The true position is within half a count of the middle of its own. The prediction's standard deviation is about
    Q √(p / 12 N) for p `unknowns` and N samples, so that about 0.8 of it, over Q, of the counts come out on the wrong side.
    So many `times` over are taken for chance. Stricter than any test of colour: slow beats of speed and encoder look like
    a wandering shaft, but leave no count in the wrong place.
    """
    wrong, samples = 0, 0
    for record, residual in zip(data, residuals, strict=True):
        if not record.quantum or record.kind != "position" or record.chain.linear:
            return False
        wrong += int(np.count_nonzero(np.abs(residual) > 0.5 * record.quantum))
        samples += len(residual)
    return bool(wrong <= times * 0.8 * samples * np.sqrt(unknowns / (12 * samples)))
