"""A pendulum that swung too little to separate a constant voltage from the cosine part of gravity."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import TWO_SIDED, round_value
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

# Of the cosine's standard deviation: what the sum has at most where the two stand for each other. It is about how much cos θ
# scatters beside 1: 0.31 over angles that are even between ±90 degrees, 0.04 between ±30.
_TIED = 0.2
_SMALL = np.pi  # rad, ±90 degrees
_MATTERS = 0.25  # of gravity's other part: a cosine that is known better than that may be tied to the offset


def _small_swing(fit: Fit) -> list[Finding]:
    """Whether offset and cosine are known by their sum only: over a small swing cos θ is as good as constant."""
    names = fit.model.names
    pair = ("offset_voltage", "gravity_voltage_cosine")
    if not {*pair, "gravity_voltage_sine"} <= set(names):
        return []
    angle = np.concatenate([record.prediction[record.valid] for record in fit.records])
    weights = np.array([1.0, float(np.mean(np.cos(angle)))])
    at = [names.index(name) for name in pair]
    covariance = fit.covariance[np.ix_(at, at)]
    if not np.isfinite(covariance).all():
        return []
    variance = float(weights @ covariance @ weights)
    cosine, sine = fit[pair[1]], fit["gravity_voltage_sine"]
    if not 0 <= variance < (_TIED * cosine.sd) ** 2 or cosine.sd < _MATTERS * abs(sine.value):
        return []
    swing = max(float(np.ptp(record.prediction[record.valid])) for record in fit.records)
    if swing > _SMALL:  # its cosine changes, whatever else ties the two together
        return []
    known, half = float(weights @ fit.model.theta[at]), TWO_SIDED * float(np.sqrt(variance))
    words = " and the ".join(parameter_in_words(name, cosine.unit) for name in pair)
    sentence = (
        f"The shaft swung through {swing:.2g} rad at most, and the cosine of its angle hardly "
        f"changed: the {words} are known only as a sum, "
        f"{round_value(known, half, cosine.unit)} on average. Let the shaft swing by 90° to either side to separate them."
    )
    return [warning("swing-small", sentence, parameters=pair)]


DOUBTS.member("small_swing")(Doubt(codes=("swing-small",), about_fit=_small_swing))
