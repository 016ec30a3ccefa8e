"""A gain off the data sheet's by a factor that people get wrong: an encoder's edges, a turn's angle, a minute's seconds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.models.motion import smooth_speed
from servobench.identification.models.nominal import nominal_values
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset
from servobench.rig.motor.parameters import MotorParameters

# What a position or speed comes out too large by; the inverse is too small. The first fitting cause is named.
_CAUSES = {
    2.0: ("counting two edges of an encoder's lines instead of four, or giving half the counts per turn"),
    4.0: "confusing an encoder's lines with its counts: each line gives four counts",
    2 * math.pi: "confusing turns with radians",
    180 / math.pi: "confusing degrees with radians",
    60 / (2 * math.pi): "confusing rpm with rad/s",
    60.0: "confusing rpm with revolutions per second",
    360.0: "confusing degrees with turns",
    1000.0: "confusing milli-units (mV, ms) with whole ones",
}
_NEAR = (
    0.2  # of the logarithm's unit: gains of one type of motor differ by a tenth, and friction takes its part
)
_KNOWN = 0.25  # of its value: a standard deviation beyond that can't tell a factor of 2, the smallest, from 1
_SAMPLES = 30  # with a current, at speed: fewer say nothing of their scatter
_CURRENT = 0.01  # of the largest one, and of a stall's: uninitialised memory holds less
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
    factor = _usual(ratio)
    if factor is None:
        return []
    direction = "larger" if ratio > 1 else "smaller"
    sentence = (
        f"The gain, {gain.value:.4g} {gain.unit}, is {max(ratio, 1 / ratio):.3g} times {direction} "
        f"than the data sheet's {expected['gain']:.4g}, while the time constant fits. That is "
        f"close to {factor:.4g}, the factor of {_CAUSES[factor]}. Check the encoder's counts and "
        "the units."
    )
    return [warning("factor-off", sentence, parameters=("gain",))]


def _usual(ratio: float) -> float | None:
    """The usual factor that a ratio, or one over it, is nearest to; None where it is near none."""
    size = max(ratio, 1 / ratio)
    near = [factor for factor in _CAUSES if abs(math.log(size / factor)) < _NEAR]
    return min(near, key=lambda each: abs(math.log(size / each)), default=None)


def _beside_nominal(records: Sequence[Dataset], nominal: MotorParameters) -> list[Finding]:
    """Whether the back-emf that a measured current leaves of the voltage, (u - R i)/k, is a usual factor off the speed.

    It needs no gain: one level, or a file that no model can be fitted to, shows it as well.
    """
    for data in records:
        ratios = _beside_back_emf(data, nominal)
        ratio = float(np.median(ratios)) if len(ratios) >= _SAMPLES else 1.0
        factor = _usual(ratio) if ratio > 0 else None
        low, high = np.percentile(ratios, [25, 75]) if len(ratios) else (0.0, 0.0)
        if factor is None or not high - low < _NEAR * ratio:
            continue
        sentence = (
            f"{data.name}: the speed is {max(ratio, 1 / ratio):.2g} times "
            f"{'larger' if ratio > 1 else 'smaller'} than the back-emf (u - R i)/k gives with the "
            f"data sheet's resistance and torque constant. That is close to {factor:.4g}, the "
            f"factor of {_CAUSES[factor]}. Check the encoder's counts, the units and any gear."
        )
        return [warning("factor-off", sentence, parameters=("gain",))]
    return []


def _beside_back_emf(data: Dataset, nominal: MotorParameters) -> Array:
    """The measured speed over that of the back-emf (K,) where the motor turns at more than half of its top speed."""
    if data.current is None or data.input_unit != "V" or data.position_unit != "rad":
        return np.zeros(0)
    speed, largest = smooth_speed(data), float(np.nanmax(np.abs(data.current), initial=0.0))
    if largest * nominal.resistance < _CURRENT * float(np.abs(data.u).max()):
        return np.zeros(0)
    voltage = np.interp(data.t_output, data.t_input, data.u)
    emf = (voltage - nominal.resistance * data.current) / nominal.motor_constant
    drives = np.isfinite(emf) & (np.abs(data.current) > _CURRENT * largest)
    fast = drives & (np.abs(speed) > 0.5 * np.abs(speed).max()) & (emf * speed > 0)
    return np.asarray(speed[fast] / emf[fast])


DOUBTS.member("factor")(
    Doubt(codes=("factor-off",), about_nominal=_about_nominal, beside_nominal=_beside_nominal)
)
