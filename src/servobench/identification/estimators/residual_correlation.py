"""Whether a fit's residual follows the input: then the model lacks a part of the motor's response."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import FittedRecord

# In standard deviations, over 21 lags. An ideal encoder's rounding, which isn't white, reached 4.3 in 24 records of a right
# model; a pole of 5 ms beside one of 100 ms makes 8 and more.
TIED = 5.0
_LAGS = 20


def input_correlation(record: FittedRecord) -> float:
    """Return the largest correlation of the residual with past changes of the input, in deviations (Ljung 1999, 16.6)."""
    keep = record.valid
    e = record.innovations[keep] - record.innovations[keep].mean()
    u = np.diff(record.data.input_at_output, prepend=record.data.input_before)[keep]
    u = u - u.mean()
    n = len(e)
    norm = float(np.sqrt(np.sum(e**2) * np.sum(u**2)))
    if n <= 4 * _LAGS or norm == 0:
        return 0.0
    spread = float(np.sum(_correlation(e) * _correlation(u)))
    lags = [float(e[lag:] @ u[: n - lag]) / norm for lag in range(_LAGS + 1)]
    return float(np.max(np.abs(lags)) * np.sqrt(n / max(spread, 1.0)))


def _correlation(x: Array) -> Array:
    """The two-sided autocorrelation of a series, up to a quarter of its length."""
    n = len(x)
    lags = max(n // 4, 1)
    size = 1 << int(np.ceil(np.log2(n + lags)))  # so that none of the lags meets the series' other end
    spectrum = np.fft.rfft(x, size)
    one_sided = np.fft.irfft(np.abs(spectrum) ** 2, size)[:lags]
    rho = one_sided / one_sided[0]
    return np.concatenate([rho[:0:-1], rho])
