"""An arm or a pendulum on a shaft whose speed alone was recorded: what the model misses follows the angle.

The angle is the integral of the measured speed, from a start that each record has of its own. The residual has that part of
e(φ) = a sin φ + b cos φ, an input, which the model's parameters can't have as well (Rao 1948, as in `uncertainty.score_test`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.core.rounding import plain, with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.estimators.covariance import effective_samples
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.uncertainty.score_test import SMALL, ScoreTest, Term

_MOST = 0.4  # of the residual's square
_SURE = 4.0  # standard errors: one in 15,000 records by chance
_LITTLE = 99.5  # percent of the output: what is left beside more moves no parameter
_WEIGHT = Term(code="weight-by-speed", name="a weight", sentence="", to_input=lambda motion: motion.wave(1))


def _about_fit(fit: Fit) -> list[Finding]:
    data = [record.data for record in fit.records]
    speeds = all(each.kind == "speed" and each.position_unit == "rad" for each in data)
    largest = max(float(np.abs(each.u).max(initial=0.0)) for each in data)
    if not speeds or not largest > 0 or fit.fit_percent > _LITTLE or not fit.residual_sd > 0:
        return []
    test = ScoreTest(fit, largest)
    columns = _side_by_side([run.columns([_WEIGHT])[0] for run in test.runs])
    if not np.isfinite(columns).all():
        return []
    rest = columns - test.basis @ (test.basis.T @ columns)
    amount, _, rank, _ = np.linalg.lstsq(rest, test.innovations, rcond=1e-6)
    if rank < rest.shape[1]:
        return []
    explained = rest @ amount
    part = float(explained @ explained / (test.innovations @ test.innovations))
    if part < _MOST or not _is_sure(part, int(rank), test.innovations - explained, test.basis.shape[1]):
        return []
    size = np.hypot(*amount.reshape(-1, 2).T)
    volts = with_unit(SMALL * largest * float(np.sqrt(np.mean(size**2))), data[0].input_unit, 2)
    sentence = (
        f"{plain(100 * part, 2)} % of what the model misses follows the angle of the shaft, as the weight of an arm would: "
        f"about {volts} of the input. Record the position instead of the speed, and the model can include gravity."
    )
    return [warning("weight-by-speed", sentence, parameters=("gain", "time_constant"))]


def _side_by_side(each: Sequence[Array]) -> Array:
    """The columns (N, 2 R) of R records, zero in the rows of the others."""
    columns, row = np.zeros((sum(map(len, each)), 2 * len(each))), 0
    for n, own in enumerate(each):
        columns[row : row + len(own), 2 * n : 2 * n + 2] = own
        row += len(own)
    return columns


def _is_sure(part: float, columns: int, rest: Array, parameters: int) -> bool:
    """Whether so many columns explain that part by more than chance, beside a rest (N,) that may be coloured (Fisher's F)."""
    from scipy.stats import f, norm

    left = effective_samples(rest) - columns - parameters
    if left < 1:
        return False
    ratio = part / columns / max((1.0 - part) / left, np.finfo(float).tiny)
    return bool(ratio > f.isf(2.0 * norm.sf(_SURE), columns, left))


DOUBTS.member("weight_by_speed")(Doubt(codes=("weight-by-speed",), about_fit=_about_fit))
