"""Pole placement: gains for specified poles of the sampled closed loop.

A position with k_p and k_d has two poles, with an integral part three, a speed with k_p and k_i two (Åström and Murray, Feedback
Systems, 2nd ed. 2021, section 11.2). `placement` finds the gains, with hold, filter and delay. The
reference acts through k_p without an integral part and through it alone with one, so that the closed loop has no zero.

A lead compensator by the trapezoid rule is  g (1 + v/z)/(1 + v/p),  v = (2/h) tanh(sh/2). Its zero z cancels the motor's pole
-1/τ; with G the sampled motor, 1 + v/p + g (1 + v/z) G = 0 at each wished pole: two equations for 1/p and g.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from servobench.core.errors import UsageError
from servobench.systems.control.lead import Lead
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.first_order import FirstOrderMotor
from servobench.systems.tuning.base import METHODS, Tunable, Unreachable, Wish, as_printed, law_error
from servobench.systems.tuning.loop import open_loop
from servobench.systems.tuning.placement import digits_for, place_poles, separate

_FILTER = 10.0  # times the fastest pole: costs 6° of phase there, and lets a tenth of the noise of a bare difference pass
_FASTEST = 1e9  # rad/s
_NO_FASTER = f"no controller samples fast enough for a loop faster than {_FASTEST:.0e} rad/s"


class _PolePlacement:
    def __call__(self, motor: FirstOrderMotor, wish: Wish) -> Tunable:
        poles = self.poles(wish)
        # Faster than the ticks a filter has nothing to do.
        fastest = max(map(abs, poles))
        cutoff = as_printed(wish.cutoff or min(_FILTER * fastest, 1 / wish.sample_time))
        if wish.controller == "lead":
            return _lead(motor, wish, poles)
        if wish.output == "speed" and len(poles) != 2:
            raise UsageError("`poles=...`: a speed loop has two poles; expected two, such as `poles=-20,-30`")
        law, settings, gains = _law(wish, len(poles) == 3)
        made = place_poles(law, settings | {"cutoff": cutoff}, gains, motor, wish.sample_time, poles)
        # The speed's gain comes first.
        if getattr(made, gains[0]) * motor.gain.value <= 0:
            raise Unreachable(_wrong_sign(motor, wish, poles, cutoff))
        return made

    def poles(self, wish: Wish) -> tuple[complex, ...]:
        if wish.closed_loop is not None:
            raise UsageError(
                "`closed_loop=...` is for lambda_tuning; give `damping=...` and `bandwidth=...`, or `poles=...`"
            )
        if wish.poles and (wish.damping is not None or wish.bandwidth is not None):
            raise UsageError("`poles=...` replaces `damping=...` and `bandwidth=...`; give one or the other")
        return _both_of_pairs(wish) if wish.poles else _pair(wish)

    def poles_cancelled(self, motor: FirstOrderMotor, wish: Wish) -> tuple[complex, ...]:
        return (complex(-1 / motor.time_constant.value),) if wish.controller == "lead" else ()

    def quantities(self, wish: Wish, poles: Sequence[complex]) -> Mapping[str, tuple[float, str]]:
        if wish.poles:
            return {}
        bandwidth = math.sqrt(abs(poles[0] * poles[1]))
        damping = -(poles[0] + poles[1]).real / (2 * bandwidth)
        return {"damping": (damping, ""), "bandwidth": (bandwidth, "rad/s")}

    def speed_text(self, wish: Wish) -> str:
        if wish.poles:
            return f"`poles={','.join(_pole_text(pole) for pole in wish.poles)}`"
        return f"`damping={wish.damping:g}` `bandwidth={wish.bandwidth:.3g}`"


def _wrong_sign(motor: FirstOrderMotor, wish: Wish, poles: Sequence[complex], cutoff: float) -> str:
    """The reason why the speed's gain would have the wrong sign."""
    own = 1 / motor.time_constant.value
    if -sum(poles).real > own:
        return f"no gains of the right sign put them there with a filter at {cutoff:.3g} rad/s and the delay"
    slowest = "the sum of the poles must be" if wish.poles else "2 × damping × bandwidth must be"
    return (
        f"that is slower than the motor itself and would reduce its damping; {slowest} more than 1/time constant = "
        f"{own:.3g} rad/s"
    )


def _pair(wish: Wish) -> tuple[complex, ...]:
    """The roots of s² + 2ζω s + ω²; raises `UsageError` where the wish isn't whole."""
    if wish.damping is None or wish.bandwidth is None:
        raise UsageError(
            "pole_placement needs `damping=...` and `bandwidth=...`, such as `damping=0.8` `bandwidth=20`, or `poles=...`"
        )
    if not (wish.damping > 0 and wish.bandwidth > 0 and math.isfinite(wish.damping * wish.bandwidth)):
        raise UsageError(f"`damping={wish.damping:g}` `bandwidth={wish.bandwidth:g}`: expected both above 0")
    if max(wish.bandwidth, wish.damping * wish.bandwidth) > _FASTEST:
        raise UsageError(
            f"`damping={wish.damping:g}` `bandwidth={wish.bandwidth:g}`: {_NO_FASTER}; expected a bandwidth such as 20"
        )
    root = cmath.sqrt(wish.damping**2 - 1)
    # The product of the two is ω²: so the slower one keeps its digits however large the damping.
    faster = -wish.bandwidth * (wish.damping + root)
    return faster, wish.bandwidth**2 / faster


def _both_of_pairs(wish: Wish) -> tuple[complex, ...]:
    # One of a complex pair stands for both; both may also be given.
    poles = [*wish.poles]
    poles += [p.conjugate() for p in wish.poles if p.imag and p.conjugate() not in wish.poles]
    if not all(math.isfinite(abs(p)) and p.real < 0 for p in poles):
        raise UsageError(
            f"`poles={','.join(map(_pole_text, poles))}`: expected poles left of zero, such as -20 or -15+10j"
        )
    if max(map(abs, poles)) > _FASTEST:
        raise UsageError(
            f"`poles={','.join(map(_pole_text, poles))}`: {_NO_FASTER}; expected poles such as -20"
        )
    if len(poles) not in {2, 3}:
        raise UsageError(
            f"`poles=...`: {len(poles)} poles; expected two, or three for a position with an integral part"
        )
    return tuple(map(complex, poles))


def _pole_text(pole: complex) -> str:
    return f"{pole.real:.3g}" if not pole.imag else f"{pole.real:.3g}{pole.imag:+.3g}j"


def _law(wish: Wish, integral: bool) -> tuple[type[Tunable], dict[str, Any], tuple[str, ...]]:
    """The requested law, its settings except the filter, and the gains to be found, that of the speed first."""
    settings: dict[str, Any]
    match wish.controller, wish.output:
        case "pid", "position":
            settings = {"b": 0.0} if integral else {"ki": 0.0}
            return Pid, settings, ("kd", "kp", "ki")[: 2 + integral]
        case "state_feedback", "position":
            settings = {"reference_gain": 0.0} if integral else {}
            return StateFeedback, settings, ("speed_gain", "position_gain", "integral_gain")[: 2 + integral]
        case "pid", "speed":
            return Pid, {"output": "speed", "b": 0.0}, ("kp", "ki")
        case "state_feedback", "speed":
            settings = {"output": "speed", "position_gain": 0.0, "reference_gain": 0.0}
            return StateFeedback, settings, ("speed_gain", "integral_gain")
    raise law_error(wish, "pole_placement", "pid, state_feedback and lead")


def _lead(motor: FirstOrderMotor, wish: Wish, poles: Sequence[complex]) -> Lead:
    if wish.output != "position":
        raise law_error(
            wish, "pole_placement", "lead with the position, and pid and state_feedback with both"
        )
    if len(poles) != 2:
        raise UsageError("`poles=...`: with a lead compensator the position has two poles; expected two")
    h, tau = wish.sample_time, motor.time_constant.value
    digits = digits_for(poles)
    zero = as_printed(2 / h * math.tanh(0.5 * h / tau), digits)
    alone = open_loop(Pid(kp=1.0), motor.gain.value, tau, motor.delay, h)
    rows = []
    for s in separate(poles):
        v = 2 / h * cmath.tanh(0.5 * h * s)
        rows.append((v, (1 + v / zero) * alone.at(s)))
    left = np.array([(x.real, y.real) for x, y in rows] + [(x.imag, y.imag) for x, y in rows])
    right = np.array([-1.0] * len(rows) + [0.0] * len(rows))
    (lag, gain), _, rank, _ = np.linalg.lstsq(left, right, rcond=None)
    if rank < 2 or not 0 < lag < 1 / zero:
        raise Unreachable(
            "a lead compensator doesn't reach that: with its zero on the motor's pole, at "
            f"{zero:.3g} rad/s, it would need its pole "
            + ("at less than that" if rank == 2 and lag > 0 else "beyond infinity, to compensate the delay")
        )
    return Lead(gain=as_printed(float(gain), digits), zero=zero, pole=as_printed(1 / float(lag), digits))


pole_placement = METHODS.member("pole_placement")(_PolePlacement())
