"""A model that misses much more than its measurement could: another structure moves."""

from __future__ import annotations

import numpy as np

from servobench.doubts.base import DOUBTS, Doubt
from servobench.doubts.lattice import lattice_step
from servobench.estimators.base import Fit
from servobench.finding import Finding, warning

_EXPLAINED = 80.0  # percent of the output
_ROUNDING = 3.0  # quanta: what is left over beside less may be the sensor's


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether much is left that neither the sensor's rounding nor any noise explains."""
    no_noise = any(finding.code == "weighed-twice" for finding in fit.findings)
    if not no_noise or fit.fit_percent >= _EXPLAINED:
        return []
    rounding = [
        float(np.std(record.residual[record.valid]))
        <= _ROUNDING * (record.data.quantum or lattice_step(record.data.y) or 0.0)
        for record in fit.records
    ]
    if any(rounding):
        return []
    missed = 100 - fit.fit_percent
    sentence = (
        f"A motor of first order is the wrong structure for these data: it misses {missed:.0f} % of the output, which neither "
        "the sensor's rounding nor a random torque explains. Something else moves with the shaft (a pendulum, a spring, a second "
        "motor), or acts before it (hysteresis, a limit): record the motor alone, or try --structure with another one."
    )
    return [warning("structure-wrong", sentence, parameters=("gain", "time_constant"))]


DOUBTS.member("structure_wrong")(Doubt(codes=("structure-wrong",), about_fit=_about_fit))
