"""λ-tuning: gains for a sampled closed loop with a specified time constant λ.

The speed gets a PI, the position a PD, whose zero cancels the motor's pole, so that the output rises as 1/(λs + 1) behind the
dead time (Dahlin 1968; Skogestad 2003, whose rules are this one with the dead time to first order). Here the slowest pole is put
at -1/λ with hold, filter and delay as they are (`placement`).
For that the reference acts on the derivative part of
the PD, too: a step of it makes a spike of the voltage as long as the filter's time constant.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from servobench.core.errors import UsageError
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.first_order import FirstOrderMotor
from servobench.systems.tuning.base import METHODS, Tunable, Unreachable, Wish, as_printed, law_error
from servobench.systems.tuning.placement import place_poles

_FILTER = 5.0  # the filter's cut-off times λ


class _LambdaTuning:
    def __call__(self, motor: FirstOrderMotor, wish: Wish) -> Tunable:
        wished = _time_constant(wish)
        dead_time = motor.delay + wish.sample_time
        if wished < dead_time:
            raise UsageError(
                f"{self.speed_text(wish)}: a loop can't be faster than the {dead_time:.3g} s of dead time (the motor's "
                f"delay {motor.delay:.3g} s and a sample time of {wish.sample_time:g} s); choose more than that"
            )
        law, settings, gains = _law(wish)
        cutoff = as_printed(wish.cutoff or min(_FILTER / wished, 1 / wish.sample_time))
        made = place_poles(
            law,
            settings | {"cutoff": cutoff},
            gains,
            motor,
            wish.sample_time,
            self.poles(wish),
            self.poles_cancelled(motor, wish),
        )
        if getattr(made, gains[0]) * motor.gain.value <= 0:
            raise Unreachable("no gains of the right sign give the loop that time constant")
        if isinstance(made, StateFeedback):
            return made.model_copy(update={"reference_gain": made.speed_gain})
        return made

    def poles(self, wish: Wish) -> tuple[complex, ...]:
        return (complex(-1 / _time_constant(wish)),)

    def poles_cancelled(self, motor: FirstOrderMotor, wish: Wish) -> tuple[complex, ...]:
        return (complex(-1 / motor.time_constant.value),)

    def quantities(self, wish: Wish, poles: Sequence[complex]) -> Mapping[str, tuple[float, str]]:
        return {"time constant": (-1 / poles[0].real, "s")}

    def speed_text(self, wish: Wish) -> str:
        return f"`closed_loop={wish.closed_loop:.3g}`"


def _law(wish: Wish) -> tuple[type[Tunable], dict[str, Any], tuple[str, ...]]:
    """The requested law, its settings except the filter, and the gains to be found."""
    match wish.controller, wish.output:
        case "pid", "speed":
            return Pid, {"output": "speed"}, ("kp", "ki")
        case "pid", "position":
            return Pid, {"c": 1.0}, ("kp", "kd")
        case "state_feedback", "speed":
            settings = {"output": "speed", "position_gain": 0.0}
            return StateFeedback, settings, ("speed_gain", "integral_gain")
    raise law_error(wish, "lambda_tuning", "pid with both, and state_feedback with the speed")


def _time_constant(wish: Wish) -> float:
    """λ [s]; raises `UsageError` where it isn't said, or something else is."""
    if wish.poles or wish.damping is not None or wish.bandwidth is not None:
        raise UsageError(
            "`damping=...`, `bandwidth=...` and `poles=...` are for pole_placement; give `closed_loop=...`, such as "
            "`closed_loop=50ms`"
        )
    if wish.closed_loop is None:
        raise UsageError(
            "lambda_tuning needs `closed_loop=...`, the desired time constant of the closed loop, such as "
            "`closed_loop=50ms`"
        )
    if not (math.isfinite(wish.closed_loop) and wish.closed_loop > 0):
        raise UsageError(f"`closed_loop={wish.closed_loop:g}`: expected a time above 0")
    return wish.closed_loop


lambda_tuning = METHODS.member("lambda_tuning")(_LambdaTuning())
