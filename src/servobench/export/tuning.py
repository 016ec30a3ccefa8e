"""Gains of a controller from an identified motor, with its delay in mind, and the margins that are left.

The SIMC rules (Skogestad 2003, Journal of Process Control 13): of a closed loop that is wished to have the time constant λ, and a
dead time θ, the speed loop of K/(τ s + 1) gets k_p = τ / (K (λ + θ)), T_i = min(τ, 4 (λ + θ)), the position loop of
K/(s (τ s + 1)) gets k_p = 1 / (K (λ + θ)), k_d = τ k_p. θ is the motor's delay and one sample time: half for the output that is
held, half for a speed that is differenced; and a filter's time constant where there is one.

The margins are those of the loop as it runs, tick by tick, with the speed as a difference of the position over a tick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.systems.first_order import FirstOrderMotor
from servobench.systems.sampled_loop import SampledLaw, law_in_z, sampled_loops
from servobench.systems.stability.loop_family import margins_of_family
from servobench.systems.transfer_function import TransferFunction

_DRAWS = 400
_SHARE = 0.25  # of the motor's time constant: faster loops make much noise of little encoder
_DEAD_TIMES = 2.0  # λ/θ: leaves 71° of phase
_FILTER = 0.2  # of λ
SAFE = math.pi / 6
"""The phase margin that 97.5 % of the motors within the intervals have to be left with, at least [rad]."""
_SLOWER = 1.5  # times λ, until it is so
_MOST = 12  # such steps: a hundred times as slow


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """Gains for loops around speed and position, in volts and the motor's unit, and margins with 95 % intervals.

    `speed_gain` [V/(unit/s)], `speed_integral` [V/unit], `position_gain` [V/unit], `position_derivative` [V/(unit/s)];
    `closed_loop` λ, `dead_time` θ and the speed filter's time constant `filter` [s]; `phase_margin` [rad] and `delay_margin`
    [s] of the sampled speed loop with its integral part are (value, low, high).
    """

    speed_gain: float
    speed_integral: float
    position_gain: float
    position_derivative: float
    closed_loop: float
    dead_time: float
    filter: float
    phase_margin: tuple[float, float, float]
    delay_margin: tuple[float, float, float]


def tune_loops(
    motor: FirstOrderMotor,
    sample_time: float,
    closed_loop: float | None = None,
    *,
    filtered: bool = False,
    integral_lag: int = 0,
    measurement_delay: float = 0.0,
) -> Tuning:
    """Return gains for a controller that runs every `sample_time` [s]; `closed_loop` [s] is λ.

    Where it isn't said, λ is 2 θ or τ/4, or longer where the intervals ask for it: until nearly all motors within them have a
    phase margin of 30°. A speed that is `filtered` goes through a low-pass filter of λ/5. `integral_lag` is the number of ticks
    after which an error is in the integral: 0 where it is added before the voltage is computed, 1 where after.
    `measurement_delay` [s] is how late the controller gets the speed, beyond the delay in the data. Raises `UsageError` for a
    closed loop that is wished faster than the dead time allows.
    """
    dead_time = motor.delay + sample_time + measurement_delay

    def tune(wished: float) -> Tuning:
        lag = _FILTER * wished if filtered else 0.0
        return _tune(motor, sample_time, wished, dead_time, lag, integral_lag, measurement_delay)

    if closed_loop is None:
        wished = max(_DEAD_TIMES * dead_time, _SHARE * motor.time_constant.value)
        tuning = tune(wished)
        for power in range(1, _MOST + 1):
            if tuning.phase_margin[1] >= SAFE:
                break
            tuning = tune(_SLOWER**power * wished)
        return tuning
    if closed_loop < dead_time:
        raise UsageError(
            f"`closed_loop={closed_loop:g}`: a loop can't be faster than the {dead_time:.3g} s of dead time (the motor's "
            f"delay {motor.delay:.3g} s, a sample time of {sample_time:g} s and a measurement {measurement_delay:g} s late); "
            f"choose {dead_time:.3g} s or more"
        )
    return tune(closed_loop)


def _tune(
    motor: FirstOrderMotor,
    sample_time: float,
    wished: float,
    dead_time: float,
    lag: float,
    integral_lag: int,
    measurement_delay: float,
) -> Tuning:
    """The gains for a closed loop as wished, behind a filter of that lag, and the margins of motors within the intervals."""
    gain, tau = motor.gain.value, motor.time_constant.value
    dead_time += lag
    position_gain, speed_gain, integral = simc(gain, tau, wished, dead_time)
    law = _speed_law(speed_gain, integral, sample_time, smoothing(sample_time, lag), integral_lag)
    motors = np.vstack([(gain, tau, motor.delay), motor.draws(_DRAWS)])
    phase, delay = _margins(law, motors + np.array([0.0, 0.0, measurement_delay]), sample_time)
    return Tuning(
        speed_gain=speed_gain,
        speed_integral=integral,
        position_gain=position_gain,
        position_derivative=speed_gain,
        closed_loop=wished,
        dead_time=dead_time,
        filter=lag,
        phase_margin=_with_interval(phase),
        delay_margin=_with_interval(delay),
    )


def simc(gain: float, tau: float, closed_loop: float, dead_time: float) -> tuple[float, float, float]:
    """Return the position gain k_p, the speed gain τ k_p and the integral gain of the speed by the SIMC rules; times in s."""
    position_gain = 1.0 / (gain * (closed_loop + dead_time))
    speed_gain = tau * position_gain
    return position_gain, speed_gain, speed_gain / min(tau, 4 * (closed_loop + dead_time))


def smoothing(sample_time: float, filter_time: float) -> float:
    """Return which share of a new value a low-pass filter takes at each tick; times in s, 1 for a filter time of 0."""
    return -math.expm1(-sample_time / filter_time) if filter_time else 1.0


def _speed_law(
    proportional: float, integral: float, sample_time: float, share: float, integral_lag: int
) -> SampledLaw:
    """From the position to the voltage, its sign turned round: difference, filter and PI, each in z."""
    added = [integral * sample_time, 0.0] if integral_lag == 0 else [0.0, integral * sample_time]
    pi = [proportional + added[0], added[1] - proportional]  # over z - 1
    return law_in_z(([share, 0.0], [1.0, -1.0], pi), ([sample_time, 0.0], [1.0, share - 1.0], [1.0, -1.0]))


def _margins(law: SampledLaw, motors: Array, sample_time: float) -> tuple[Array, Array]:
    """The phase margins [rad] and delay margins [s] (M,) of loops around motors (M, 3), each a gain, a time constant, a delay."""
    positions = [
        TransferFunction(numerator=(gain,), denominator=(tau, 1.0, 0.0), delay=delay)
        for gain, tau, delay in motors.tolist()
    ]
    margins = margins_of_family(sampled_loops(law, positions, sample_time, "speed"))
    return np.array([each.phase_margin for each in margins]), np.array(
        [each.delay_margin for each in margins]
    )


def _with_interval(values: Array) -> tuple[float, float, float]:
    # An infinite margin has no value between it and another: of the draws the nearest counts.
    low, high = np.quantile(values[1:], (0.025, 0.975), method="nearest")
    return float(values[0]), float(low), float(high)
