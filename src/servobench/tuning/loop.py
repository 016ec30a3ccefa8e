"""The open loop of a controller around a motor, and its margins as far as the motor is known.

L(s) = C(s) G(s) e^(-s (d + h/2)): half a sample time h for a voltage that holds, as follows from
(1 - e^(-sh))/(sh) = e^(-sh/2) (1 + O(s²h²)). A speed from counts is a difference over h,
which is half a sample time late, behind a filter; both together are taken as one lag F(s) = 1/(1 + s (1/ω_c + h/2)).
An integral that counts the newest sample is the sum h/(1 - e^(-sh)) = 1/s + h/2 + O(s h²): k_i h/2 acts as a gain does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servobench.channels import Array
from servobench.control.lead import Lead
from servobench.control.state_feedback import StateFeedback
from servobench.export.first_order import FirstOrderMotor
from servobench.margins import margins
from servobench.transfer_function import TransferFunction
from servobench.tuning.base import Tunable

_DRAWS = 400
UNITS = {"gain_margin": "1", "phase_margin": "rad", "delay_margin": "s", "gain_crossover": "rad/s"}


@dataclass(frozen=True, kw_only=True)
class Told:
    """A value with its unit, and its 95 % interval over what the data leave open of the motor."""

    value: float
    interval: tuple[float, float]
    unit: str


def open_loop(
    controller: Tunable, gain: float, tau: float, delay: float, sample_time: float
) -> TransferFunction:
    """Return the loop of a controller that runs every `sample_time` [s] around K/(τs + 1) with a delay [s]."""
    lag = (1 / controller.cutoff + 0.5 * sample_time, 1.0)
    numerator, denominator = _feedback(controller, np.array(lag), sample_time)
    motor = (tau, 1.0) if controller.output == "speed" else (tau, 1.0, 0.0)
    return TransferFunction(
        numerator=tuple(map(float, gain * np.asarray(numerator))),
        denominator=tuple(map(float, np.convolve(denominator, motor))),
        delay=delay + 0.5 * sample_time,
        output=controller.output,
    )


def _feedback(controller: Tunable, lag: Array, sample_time: float) -> tuple[Array, Array]:
    """What a controller makes of the motor's output, with the sign turned round: numerator and denominator."""
    s = np.array([1.0, 0.0])
    if isinstance(controller, Lead):
        above = controller.gain * np.array([1 / controller.zero, 1.0])
        below = np.array([1 / controller.pole, 1.0])
        return above, below if controller.output == "position" else np.convolve(below, lag)
    if isinstance(controller, StateFeedback):
        at_rest, rate, integral = controller.position_gain, controller.speed_gain, controller.integral_gain
        if controller.output == "speed":
            at_rest, rate = rate, 0.0
    else:
        at_rest, rate, integral = controller.kp, controller.kd, controller.ki
    at_rest += 0.5 * sample_time * integral
    # at_rest + rate s F + integral/s, over s (1 + lag s) where there is an integral part; all behind F for a speed.
    numerator: Array = np.asarray(np.polyadd(at_rest * lag, rate * s), dtype=np.float64)
    denominator = lag
    if integral:
        numerator = np.asarray(np.polyadd(np.convolve(numerator, s), integral * lag), dtype=np.float64)
        denominator = np.convolve(lag, s)
    return numerator, denominator if controller.output == "position" else np.convolve(denominator, lag)


def loop_margins(controller: Tunable, motor: FirstOrderMotor, sample_time: float) -> dict[str, Told]:
    """Return the gain, phase and delay margin and the gain crossover, with their 95 % intervals.

    A gain margin below 1, of a loop that would be unstable with less gain, counts as its inverse: as the factor to instability.
    """
    centre = (motor.gain.value, motor.time_constant.value, motor.delay)
    motors = [centre, *map(tuple, motor.draws(_DRAWS).tolist())]
    rows = np.array([_of_the_loop(open_loop(controller, k, tau, d, sample_time)) for k, tau, d in motors])
    # Infinite margins have no value between them: of the draws the nearest counts.
    low, high = np.quantile(rows[1:], (0.025, 0.975), axis=0, method="nearest")
    return {
        name: Told(value=float(rows[0, n]), interval=(float(low[n]), float(high[n])), unit=unit)
        for n, (name, unit) in enumerate(UNITS.items())
    }


def nominal_margins(controller: Tunable, motor: FirstOrderMotor, sample_time: float) -> dict[str, float]:
    """Return the same without intervals; `sample_time` is in s."""
    loop = open_loop(controller, motor.gain.value, motor.time_constant.value, motor.delay, sample_time)
    return dict(zip(UNITS, _of_the_loop(loop), strict=True))


def _of_the_loop(loop: TransferFunction) -> tuple[float, float, float, float]:
    found = margins(loop)
    factor = found.gain_margin
    return max(factor, 1 / factor), found.phase_margin, found.delay_margin, found.gain_crossover
