"""Whether the motor still is what the model says: do its innovations look like noise, of the size and without the pattern?"""

from __future__ import annotations

import numpy as np

from servobench.channels import Array
from servobench.estimators.recursion.bank import Likeliest

_FEWEST = 40  # innovations
_LAGS = 10
_RARE = 1e-3  # chance that white innovations look coloured
_VERY_RARE = 1e-4  # chance that an unchanged motor looks changed
_IN_PLACE = 0.9  # of the counts: where so many are where the model puts them, there is nothing but rounding


def is_white(recent: Array, residuals: Array, found: Likeliest, quantum: float | None) -> bool | None:
    """Return whether the last innovations leave nothing to explain; None where there are too few to say.

    `recent` (K, 8) are innovations of [J r], `residuals` (N,) the last samples' own. Three tests, each of which must pass: their
    autocorrelations over ten lags (Ljung and Box 1978); their size beside that of the whole run; and whether they ask for other
    parameters than the whole run does (a score test: a motor that changes asks at once).
    An encoder's rounding is coloured at a constant speed; where the counts are where the model puts them it is all there is.
    """
    from scipy.special import gammaincc

    count = len(recent)
    if count < _FEWEST:
        return None
    if quantum and np.mean(np.abs(residuals) <= 0.5 * quantum) >= _IN_PLACE:
        return True
    jacobian = recent[:, found.informed]
    e = (recent[:, -1] - recent[:, :-1] @ found.change) / np.sqrt(found.variance)
    lags = np.arange(1, _LAGS + 1)
    power = float(e @ e)
    r = np.array([e[lag:] @ e[:-lag] for lag in lags]) / power
    coloured = count * (count + 2) * float(np.sum(r**2 / (count - lags)))
    h = jacobian.T @ jacobian
    scale = 1.0 / np.sqrt(np.maximum(np.diag(h), 1e-300))
    values, vectors = np.linalg.eigh(h * np.outer(scale, scale))
    told = values > 1e-9 * values[-1]
    asked = ((jacobian.T @ e * scale) @ vectors)[told] / np.sqrt(values[told])
    chances = (
        (gammaincc(0.5 * _LAGS, 0.5 * coloured), _RARE),
        (gammaincc(0.5 * count, 0.5 * power), _VERY_RARE),
        (gammaincc(0.5 * len(asked), 0.5 * float(asked @ asked)), _VERY_RARE),
    )
    return all(chance > least for chance, least in chances)
