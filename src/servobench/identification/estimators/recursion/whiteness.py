"""Whether the motor still agrees with the model: are the innovations noise, or does the model lack something?"""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.recursion.bank import Likeliest

_FEWEST = 40  # innovations
_LAGS = 5
_RARE = 1e-4  # chance that an unchanged motor looks changed, of a single look
_SLOW = 4.0  # standard deviations of the sum of the correlations
_KNOWN = 1e-9  # of the largest eigenvalue: in such a direction the innovations contain no information
_IN_PLACE = 0.9  # of the counts: where so many are where the model puts them, there is nothing but rounding


def is_white(
    recent: Array, residuals: Array, likeliest: Likeliest, quantum: float | None, together: int
) -> bool | None:
    """Return whether the last innovations leave nothing to explain; None where there are too few to say.

    `recent` (K, 8) are innovations of [J r], of which `together` span a time constant; `residuals` (N,) are those of the last
    samples. Two tests, which must both pass: whether the last innovations ask for other parameters than the whole run does (a
    score test: a motor that changes asks at once), and whether their sums over a time constant go on in the same direction, over
    five of them. Shorter correlations say nothing: an encoder's rounding has them, and they do no harm. Where the counts are
    where the model puts them, rounding is all there is.
    """
    from scipy.special import gammaincc

    if len(recent) < _FEWEST:
        return None
    if quantum and np.mean(np.abs(residuals) <= 0.5 * quantum) >= _IN_PLACE:
        return True
    e = (recent[:, -1] - recent[:, :-1] @ likeliest.change) / np.sqrt(likeliest.watched_variance)
    # A change long ago is in many innovations, one just now in the last few.
    scores = [_score_statistic(recent[-last:, :-1], e[-last:]) for last in (len(e), _FEWEST, 2 * _FEWEST)]
    whole = len(e) // together
    sums = e[len(e) - whole * together :].reshape(whole, together).sum(axis=1)
    slow = 0.0
    if whole > 2 * _LAGS:
        slow = sum(float(sums[lag:] @ sums[:-lag]) for lag in range(1, _LAGS + 1)) / float(sums @ sums)
    same = all(gammaincc(0.5 * statistic, 0.5 * size) > _RARE for size, statistic in scores)
    return bool(same and slow * np.sqrt(whole / _LAGS) < _SLOW)


def _score_statistic(jacobian: Array, e: Array) -> tuple[float, int]:
    """The score statistic of innovations e (K,), chi-squared, and how many directions (K, 7) they can tell apart."""
    h = jacobian.T @ jacobian
    size = np.diag(h)
    scale = np.where(size > 0, 1.0 / np.sqrt(np.where(size > 0, size, 1.0)), 0.0)
    values, vectors = np.linalg.eigh(h * np.outer(scale, scale))
    resolved = values > _KNOWN * values[-1]
    score = ((jacobian.T @ e * scale) @ vectors)[resolved]
    return float(np.sum(score**2 / values[resolved])), int(np.count_nonzero(resolved))
