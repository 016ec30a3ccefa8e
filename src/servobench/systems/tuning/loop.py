"""The sampled open loop of a controller and a motor, and its margins with the uncertainty of the motor.

Both halves are exact: what the controller computes is taken from the controller (`control.sampled_law`), and the motor is sampled
with its hold and its delay (`sampled_loop`). docs/decisions/0028-sampled-loop.md says why.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.systems.control.sampled_law import sampled_law
from servobench.systems.first_order import FirstOrderMotor
from servobench.systems.margins import Margins
from servobench.systems.sampled_loop import (
    SampledLoop,
    margins_and_gain_range,
    sampled_loop,
    sampled_loops,
)
from servobench.systems.stability.loop_family import margins_and_gain_ranges
from servobench.systems.transfer_function import TransferFunction
from servobench.systems.tuning.base import Tunable

_DRAWS = 400
_HARDEST = 20
UNITS = {
    "gain_margin": "1",
    "gain_margin_downwards": "1",
    "phase_margin": "rad",
    "delay_margin": "s",
    "gain_crossover": "rad/s",
}


@dataclass(frozen=True, kw_only=True)
class LoopValue:
    """A value with its unit, and its 95 % interval over what the data leave open of the motor."""

    value: float
    interval: tuple[float, float]
    unit: str


def open_loop(controller: Tunable, gain: float, tau: float, delay: float, sample_time: float) -> SampledLoop:
    """Return the loop of a controller that runs every `sample_time` [s] around K/(τs + 1) with a delay [s]."""
    law = sampled_law(controller, sample_time)
    return sampled_loop(law, _angle(gain, tau, delay), sample_time, controller.output)


def _angle(gain: float, tau: float, delay: float) -> TransferFunction:
    """K/(s (τs + 1)): laws that follow the speed are made of differences of the angle."""
    return TransferFunction(
        numerator=(gain,), denominator=(tau, 1.0, 0.0), delay=delay, output="position", unit="rad/V"
    )


def loop_margins(controller: Tunable, motor: FirstOrderMotor, sample_time: float) -> dict[str, LoopValue]:
    """Return the gain margins, phase and delay margin and the gain crossover, with their 95 % intervals.

    `gain_margin` is the factor by which the gain may rise, `gain_margin_downwards` that by which it may fall, as 2 where half of
    the gain is the border of stability: infinite where less of it makes nothing unstable.
    """
    rows = _margins_over(motor.draws(_DRAWS), controller, motor, sample_time)
    # Infinite margins have no value between them: of the draws the nearest counts.
    low, high = np.quantile(rows[1:], (0.025, 0.975), axis=0, method="nearest")
    return _with_units(rows[0], low, high)


def least_margins(controller: Tunable, motor: FirstOrderMotor, sample_time: float) -> dict[str, LoopValue]:
    """Return intervals that lie within those of `loop_margins`, ten times sooner.

    They show a loop that is too fast for its `sample_time` [s]: the 2.5 % quantile of all draws is at most the same order
    statistic of some of them. Those with the longest delay and the fastest acceleration, which are the hardest to control, come
    nearest to it.
    """
    draws = motor.draws(_DRAWS)
    hardest = [np.argsort(by)[-_HARDEST:] for by in (draws[:, 2], np.abs(draws[:, 0] / draws[:, 1]))]
    rows = _margins_over(draws[np.union1d(*hardest)], controller, motor, sample_time)
    ordered, beyond = np.sort(rows[1:], axis=0), round(0.025 * (_DRAWS - 1))
    return _with_units(rows[0], ordered[beyond], ordered[-1 - beyond])


def _margins_over(draws: Array, controller: Tunable, motor: FirstOrderMotor, sample_time: float) -> Array:
    """One row for the motor as it is estimated, then one for each of the draws."""
    motors = [_angle(*each) for each in draws.tolist()]
    loops = sampled_loops(sampled_law(controller, sample_time), motors, sample_time, controller.output)
    nominal = nominal_margins(controller, motor, sample_time)
    return np.array([tuple(nominal.values()), *(_numbers(*each) for each in margins_and_gain_ranges(loops))])


def _with_units(values: Array, low: Array, high: Array) -> dict[str, LoopValue]:
    return {
        name: LoopValue(value=float(values[n]), interval=(float(low[n]), float(high[n])), unit=unit)
        for n, (name, unit) in enumerate(UNITS.items())
    }


def nominal_margins(controller: Tunable, motor: FirstOrderMotor, sample_time: float) -> dict[str, float]:
    """Return the same without intervals; `sample_time` is in s."""
    loop = open_loop(controller, motor.gain.value, motor.time_constant.value, motor.delay, sample_time)
    return dict(zip(UNITS, _numbers(*margins_and_gain_range(loop)), strict=True))


def _numbers(margins: Margins, stable: tuple[float, float]) -> tuple[float, ...]:
    """The values in the order of `UNITS`, by the margins and the factors on the gain between which the loop is stable."""
    low, high = stable
    return (
        high,
        1 / low if low else math.inf,
        margins.phase_margin,
        margins.delay_margin,
        margins.gain_crossover,
    )
