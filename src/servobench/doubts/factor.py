"""A gain off the data sheet's by a factor that people get wrong: an encoder's edges, a turn's angle, a minute's seconds."""

from __future__ import annotations

import math

from servobench.doubts.base import DOUBTS, Doubt
from servobench.estimators.base import Fit
from servobench.finding import Finding, warning
from servobench.models.nominal import nominal_values
from servobench.motor.parameters import MotorParameters

# What a position or speed comes out too large by; the inverse is too small. The first fitting cause is named.
_CAUSES = {
    2.0: "an encoder's lines counted at two edges or four, or the counts in a turn said half as many as they are",
    4.0: "an encoder's lines taken for its counts: each line gives four counts",
    2 * math.pi: "turns taken for radians, or the other way round",
    180 / math.pi: "degrees taken for radians, or the other way round",
    60 / (2 * math.pi): "revolutions per minute taken for radians per second, or the other way round",
    60.0: "revolutions per minute taken for revolutions per second, or the other way round",
    360.0: "degrees taken for turns, or the other way round",
    1000.0: "milli-units (mV, ms) taken for whole ones, or the other way round",
}
_NEAR = (
    0.2  # of the logarithm's unit: gains of one type of motor differ by a tenth, and friction takes its part
)
_KNOWN = 0.25  # of its value: a standard deviation beyond that can't tell a factor of 2, the smallest, from 1
_SAME_MOTOR = 3.0  # the time constants may differ by this factor, and it is still that motor


def _about_nominal(fit: Fit, nominal: MotorParameters) -> list[Finding]:
    """Whether the gain is off by one of the usual factors while the time constant, which has no such unit, is the motor's."""
    if "gain" not in fit.model.names or "time_constant" not in fit.model.names:
        return []
    expected = nominal_values(nominal)
    gain, tau = fit["gain"], fit["time_constant"]
    if not gain.sd < _KNOWN * abs(gain.value):
        return []
    if gain.value == 0 or not abs(math.log(max(tau.value, 1e-9) / expected["time_constant"])) < math.log(
        _SAME_MOTOR
    ):
        return []
    ratio = abs(gain.value) / expected["gain"]
    size = max(ratio, 1 / ratio)
    near = [factor for factor in _CAUSES if abs(math.log(size / factor)) < _NEAR]
    if not near:
        return []
    factor = min(near, key=lambda each: abs(math.log(size / each)))
    direction = "larger" if ratio > 1 else "smaller"
    sentence = (
        f"The gain, {gain.value:.4g} {gain.unit}, is {size:.3g} times {direction} than the data sheet's "
        f"{expected['gain']:.4g}, while the time constant fits: nearly the factor {factor:.4g} of {_CAUSES[factor]}. Check "
        "the encoder's counts and the units."
    )
    return [warning("factor-off", sentence, parameters=("gain",))]


DOUBTS.member("factor")(Doubt(codes=("factor-off",), about_nominal=_about_nominal))
