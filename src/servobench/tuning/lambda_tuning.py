"""λ-tuning: gains for a closed loop with a wished time constant λ, with the dead time in mind.

The SIMC rules (Skogestad 2003) that `export.tuning` states: the speed gets a PI, the position a PD, whose zero cancels the
motor's pole, so that the output rises as 1/(λs + 1) behind the dead time. For that the reference acts on the derivative part of
the PD, too: a step of it makes a spike of the voltage as long as the filter's time constant.
"""

from __future__ import annotations

import math

from servobench.control.pid import Pid
from servobench.control.state_feedback import StateFeedback
from servobench.errors import UsageError
from servobench.export.first_order import FirstOrderMotor
from servobench.export.tuning import simc
from servobench.tuning.base import METHODS, Tunable, Wish, as_printed, unsupported

_FILTER = 5.0  # the filter's cut-off times λ


class _LambdaTuning:
    def __call__(self, motor: FirstOrderMotor, wish: Wish) -> Tunable:
        wished = _time_constant(wish)
        dead_time = motor.delay + wish.sample_time
        if wished < dead_time:
            raise UsageError(
                f"{self.told(wish)}: a loop can't be faster than the {dead_time:.3g} s that pass before anything is seen "
                f"(the motor's delay {motor.delay:.3g} s and a sample time of {wish.sample_time:g} s); wish for more than that"
            )
        cutoff = as_printed(wish.cutoff or min(_FILTER / wished, 1 / wish.sample_time))
        position, speed, integral = map(
            as_printed,
            simc(motor.gain.value, motor.time_constant.value, wished, dead_time + 1 / cutoff),
        )
        if wish.output == "speed" and wish.controller == "pid":
            return Pid(output="speed", kp=speed, ki=integral, cutoff=cutoff)
        if wish.output == "position" and wish.controller == "pid":
            return Pid(kp=position, kd=speed, c=1.0, cutoff=cutoff)
        if wish.output == "speed" and wish.controller == "state_feedback":
            return StateFeedback(
                output="speed",
                position_gain=0.0,
                speed_gain=speed,
                integral_gain=integral,
                reference_gain=speed,
                cutoff=cutoff,
            )
        raise unsupported(wish, "lambda_tuning", "pid with both, and state_feedback with the speed")

    def told(self, wish: Wish) -> str:
        return f"--lambda {wish.closed_loop:.3g}"


def _time_constant(wish: Wish) -> float:
    """λ [s]; raises `UsageError` where it isn't said, or something else is."""
    if wish.poles or wish.damping is not None or wish.bandwidth is not None:
        raise UsageError(
            "--damping, --bandwidth and --poles are wishes for pole_placement; say --lambda, such as --lambda 50ms"
        )
    if wish.closed_loop is None:
        raise UsageError(
            "lambda_tuning needs --lambda, the time constant wished for the closed loop, such as --lambda 50ms"
        )
    if not (math.isfinite(wish.closed_loop) and wish.closed_loop > 0):
        raise UsageError(f"--lambda {wish.closed_loop:g}: expected a time above 0")
    return wish.closed_loop


lambda_tuning = METHODS.member("lambda_tuning")(_LambdaTuning())
