"""An arm or a pendulum on a shaft whose speed alone was recorded: what the model misses follows the angle.

The angle is the integral of the measured speed. The residual has that part of e(φ) = a sin φ + b cos φ, an input, which the
model's parameters can't have as well (Rao 1948, as in `uncertainty.score_test`).
"""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.core.rounding import plain, with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.uncertainty.score_test import SMALL, ScoreTest, Term

_MOST = 0.4  # of the residual's square
_LITTLE = 99.5  # percent of the output: what is left beside more moves no parameter
_WEIGHT = Term(code="weight-by-speed", name="a weight", sentence="", to_input=lambda motion: motion.wave(1))


def _about_fit(fit: Fit) -> list[Finding]:
    data = [record.data for record in fit.records]
    speeds = all(each.kind == "speed" and each.position_unit == "rad" for each in data)
    largest = max(float(np.abs(each.u).max(initial=0.0)) for each in data)
    if not speeds or not largest > 0 or fit.fit_percent > _LITTLE or not fit.residual_sd > 0:
        return []
    test = ScoreTest(fit, largest)
    columns = np.concatenate([run.columns([_WEIGHT])[0] for run in test.runs])
    if not np.isfinite(columns).all():
        return []
    rest = columns - test.basis @ (test.basis.T @ columns)
    amount, _, rank, _ = np.linalg.lstsq(rest, test.innovations, rcond=1e-6)
    if rank < rest.shape[1]:
        return []
    part = float(np.sum((rest @ amount) ** 2) / (test.innovations @ test.innovations))
    if part < _MOST:
        return []
    volts = with_unit(SMALL * largest * float(np.hypot(*amount)), data[0].input_unit, 2)
    sentence = (
        f"{plain(100 * part, 2)} % of what the model misses comes again with each turn of the shaft, as by the weight of an arm "
        f"that takes about {volts} of the input. Gravity depends on the angle, and the output is a speed: record the position, "
        "and the model includes it."
    )
    return [warning("weight-by-speed", sentence, parameters=("gain", "time_constant"))]


DOUBTS.member("weight_by_speed")(Doubt(codes=("weight-by-speed",), about_fit=_about_fit))
