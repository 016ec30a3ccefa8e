"""Whether a fit's residual follows the input: then the model lacks a part of the motor's response."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.estimators.encoder_rounding import is_rounded, noise_before, rounding_sines

# Over 21 lags, in 24 records of a right model, white noise and rounding reached 4.3; a pole of 5 ms beside one of 100 ms makes 8
# and more.
TIED = 5.0
_LAGS = 20


def input_correlation(fit: Fit) -> float:
    """Return the largest correlation of a residual with past changes of its input, in deviations (Ljung 1999, 16.6).

    Those are of noise with the residual's colour, or of an encoder's rounding where that makes more: where a motion comes again,
    or follows a loop that acts on the counts, its rounding goes with the input as well.
    """
    return max(_of_record(record, fit) for record in fit.records)


def _of_record(record: FittedRecord, fit: Fit) -> float:
    keep = record.valid
    e = record.innovations[keep] - record.innovations[keep].mean()
    u = np.diff(record.data.input_at_output, prepend=record.data.input_before)[keep]
    u = u - u.mean()
    n = len(e)
    power = float(np.sum(e**2) * np.sum(u**2))
    if n <= 4 * _LAGS or power == 0:
        return 0.0
    spread = float(np.sum(_correlation(e) * _correlation(u)))
    by_chance = np.full(_LAGS + 1, np.sqrt(power * max(spread, 1.0) / n))
    sums = np.array([float(e[lag:] @ u[: n - lag]) for lag in range(_LAGS + 1)])
    if (
        np.max(np.abs(sums) / by_chance) > TIED
        and fit.disturbance is None
        and is_rounded(record.data)
        and keep.all()
    ):
        by_chance = np.maximum(by_chance, _by_rounding(record, fit.residual_sd, u))
    return float(np.max(np.abs(sums) / by_chance))


def _by_rounding(record: FittedRecord, residual_sd: float, u: Array) -> Array:
    """The standard deviation of the sum at each lag by what the encoder rounds, for the path that the model foretells."""
    quantum = record.data.quantum or np.nan
    lagged = np.column_stack([np.concatenate([np.zeros(lag), u[: len(u) - lag]]) for lag in range(_LAGS + 1)])
    noise = noise_before(residual_sd, quantum)
    sines, white = rounding_sines(lagged - lagged.mean(axis=0), record.prediction, quantum, noise)
    variance = np.sum(sines**2, axis=0) + white * np.sum(lagged**2, axis=0)
    return np.asarray(np.sqrt(variance) / residual_sd, dtype=np.float64)


def _correlation(x: Array) -> Array:
    """The two-sided autocorrelation of a series, up to a quarter of its length."""
    n = len(x)
    lags = max(n // 4, 1)
    size = 1 << int(np.ceil(np.log2(n + lags)))  # so that none of the lags meets the series' other end
    spectrum = np.fft.rfft(x, size)
    one_sided = np.fft.irfft(np.abs(spectrum) ** 2, size)[:lags]
    rho = one_sided / one_sided[0]
    return np.concatenate([rho[:0:-1], rho])
