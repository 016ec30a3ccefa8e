"""The step response of a controller around a motor: the law itself, tick by tick, around the exact motor with its delay.

Overshoot and rise time are those of Franklin, Powell and Emami-Naeini 2015, chapter 3.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array, Channel, DeviceInfo
from servobench.core.errors import UsageError
from servobench.systems.first_order import FirstOrderMotor
from servobench.systems.tuning.base import Tunable
from servobench.systems.tuning.loop import LoopValue

_DRAWS = 40
_LENGTHS = 12.0  # of the time that 1/gain crossover is, and of the motor's time constant
_LEAST = 6.0  # times 1/gain crossover: a pair of poles has its overshoot after about π of these
_SETTLED = 4.0  # time constants of the slowest pole: all but a fiftieth of its part has died out
_MOST_TICKS = 20_000
_MOST_DELAYED = 500  # ticks; each is a state of the loop, and the work grows with their cube


@dataclass(frozen=True, kw_only=True, eq=False)
class Response:
    """Times (N,) [s], the output at them (N,) [rad or rad/s], and the voltage that was wanted (N,), after a step at the start."""

    t: Array
    output: Array
    voltage: Array

    @property
    def overshoot(self) -> float:
        """The part of the step by which the output goes beyond it."""
        return max(float(self.output.max()) - 1.0, 0.0)

    @property
    def rise_time(self) -> float:
        """The time from 10 to 90 % of the step [s]; NaN where it doesn't get there."""
        return self._reaches(0.9) - self._reaches(0.1)

    @property
    def peak(self) -> float:
        """The largest voltage that was wanted, either way [V]."""
        return float(np.abs(self.voltage).max())

    def _reaches(self, part: float) -> float:
        """The time at which the output first reaches a part of the step, on a line between two ticks [s]; NaN where never."""
        reached = np.flatnonzero(self.output >= part)
        if not len(reached) or not reached[0]:
            return math.nan
        k = reached[0]
        return float(np.interp(part, self.output[k - 1 : k + 1], self.t[k - 1 : k + 1]))


def unit_step(
    controller: Tunable, gain: float, tau: float, delay: float, sample_time: float, ticks: int
) -> Response:
    """Return the response to a unit step of the reference, without friction and without a limit of the voltage."""
    from servobench.systems.control import kernels as laws
    from servobench.systems.tuning.kernels import RESOLUTION, follow_step

    info = DeviceInfo(
        name="motor",
        channels=(
            Channel(name="voltage", unit="V"),
            Channel(name="counts", unit="counts", counts_per_rev=2 * math.pi / RESOLUTION),
        ),
    )
    law, p, x = controller.start(sample_time, info)
    number = laws.PID + (laws.pid, laws.lead, laws.state_feedback).index(law)  # in the order of their numbers
    whole, part = divmod(delay, sample_time)
    whole = int(min(whole, ticks))  # what is delayed beyond the last tick never acts
    course = np.empty((ticks, 2))
    # Numba would compile it anew for a whole number or NumPy's own kind.
    follow_step(number, p, x.copy(), np.empty_like(x), float(gain), float(tau), whole, part, course)
    # The step comes at the second tick: what a law knows before is nothing.
    t: Array = (np.arange(ticks, dtype=np.float64) - 1) * sample_time
    return Response(t=t[1:], output=course[1:, 0], voltage=course[1:, 1])


def ticks_of(motor: FirstOrderMotor, sample_time: float, crossover: float) -> int:
    """Return how many ticks of a step response tell all of it, for a loop with a gain crossover [rad/s].

    Raises `UsageError` where more are needed for its overshoot than are worked out.
    """
    shortest = _LEAST / crossover / _MOST_TICKS
    if sample_time < shortest:
        raise UsageError(
            f"`sample_time={sample_time:g}`: the step response of a loop with its crossover at {crossover:.3g} rad/s takes more "
            f"than {_MOST_TICKS} such ticks; expected {1.1 * shortest:.2g} s at least, with which its gains are about the same"
        )
    length = _LENGTHS * max(1 / crossover, motor.time_constant.value)
    return min(math.ceil(length / sample_time), _MOST_TICKS)


def check_sample_time(poles: Sequence[complex], motor: FirstOrderMotor, sample_time: float) -> None:
    """Raise `UsageError` for a sample time [s] far too short for a loop with the specified `poles` [1/s], before placement.

    Below it neither the poles z = e^(sh), next to 1, nor the delay, thousands of ticks long, could be worked with. A crossover
    isn't beyond the sum of the poles' sizes, so that nothing is refused here that `ticks_of` would take.
    """
    sizes = [abs(pole) for pole in poles]
    # From half of the slowest pole on the loop has its crossover, hold, filter and delay included.
    enough = _LEAST / (0.5 * min(sizes)) / _MOST_TICKS
    if sample_time < _LEAST / sum(sizes) / _MOST_TICKS:
        raise UsageError(
            f"`sample_time={sample_time:g}`: the step response of a loop with a pole at {min(sizes):.3g} rad/s takes more than "
            f"{_MOST_TICKS} such ticks; expected {min(enough, 0.1 / max(sizes)):.2g} s at least, with which its gains are "
            "about the same"
        )
    if motor.delay > _MOST_DELAYED * sample_time:
        raise UsageError(
            f"`sample_time={sample_time:g}`: the motor's delay of {motor.delay:.3g} s takes more than {_MOST_DELAYED} such "
            f"ticks; expected {1.1 * motor.delay / _MOST_DELAYED:.2g} s at least, with which the gains are about the same"
        )


def step_response(
    controller: Tunable, motor: FirstOrderMotor, sample_time: float, crossover: float, slowest: float
) -> tuple[dict[str, LoopValue], float]:
    """Return overshoot [1] and rise time [s] with their 95 % intervals, and the peak voltage for a unit of the step [V].

    The loop's `crossover` [rad/s] and the real part of its `slowest` pole [1/s] say how long to look. A rise time is NaN where
    the response takes longer than what is worked out.
    """
    settled = math.ceil(min(_SETTLED / abs(slowest) / sample_time, _MOST_TICKS)) if slowest else _MOST_TICKS
    ticks = max(ticks_of(motor, sample_time, crossover), settled)
    centre = (motor.gain.value, motor.time_constant.value, motor.delay)
    motors = [centre, *map(tuple, motor.draws(_DRAWS).tolist())]
    responses = [unit_step(controller, k, tau, d, sample_time, ticks) for k, tau, d in motors]
    rows = np.array([(each.overshoot, each.rise_time) for each in responses])
    low, high = np.quantile(rows[1:], (0.025, 0.975), axis=0)
    values = {
        name: LoopValue(value=float(rows[0, n]), interval=(float(low[n]), float(high[n])), unit=unit)
        for n, (name, unit) in enumerate({"overshoot": "1", "rise_time": "s"}.items())
    }
    return values, responses[0].peak
