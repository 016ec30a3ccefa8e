"""Pole placement: gains that put the poles of the closed loop where they are wished.

The motor is K/(τs + 1) from voltage to speed. Without delay, filter and sampling the closed loops have the denominators

    position, k_p and k_d            τs² + (1 + K k_d) s + K k_p
    position, with an integral       τs³ + (1 + K k_d) s² + K k_p s + K k_i
    speed, k_p and k_i               τs² + (1 + K k_p) s + K k_i

which are held against those of the wished poles (Åström and Murray, Feedback Systems, 2nd ed. 2021, section 11.2). The
reference acts through k_p without an integral part and through it alone with one, so that the closed loop has no zero. A lead
compensator cancels the motor's pole: zero 1/τ, pole 2ζω, gain ω/(2ζK). What delay, filter and sampling take from the damping is
left to the margins to say.
"""

from __future__ import annotations

import math

import numpy as np

from servobench.control.lead import Lead
from servobench.control.pid import Pid
from servobench.control.state_feedback import StateFeedback
from servobench.errors import UsageError
from servobench.export.first_order import FirstOrderMotor
from servobench.tuning.base import METHODS, Tunable, Wish, as_printed, unsupported

_FILTER = 10.0  # times the fastest pole: costs 6° of phase there, and lets a tenth of the noise of a bare difference pass
_FASTEST = 1e9  # rad/s
_NO_FASTER = f"no controller has ticks for a loop faster than {_FASTEST:.0e} rad/s"


class _PolePlacement:
    def __call__(self, motor: FirstOrderMotor, wish: Wish) -> Tunable:
        wanted = _denominator(wish)
        # Faster than the ticks a filter has nothing to do.
        fastest = float(np.abs(np.roots(wanted)).max())
        cutoff = as_printed(wish.cutoff or min(_FILTER * fastest, 1 / wish.sample_time))
        gain, tau = motor.gain.value, motor.time_constant.value
        if wish.controller == "lead":
            return _lead(wish, gain, tau, wanted)
        damping = (tau * wanted[1] - 1) / gain  # what the speed is worth
        if damping * gain <= 0:
            slowest = "the sum of the poles has to be" if wish.poles else "2 × damping × bandwidth has to be"
            raise UsageError(
                f"{self.told(wish)}: that is slower than the motor is by itself, and would take its damping away; {slowest} more "
                f"than 1/time constant = {1 / tau:.3g} rad/s"
            )
        lowest = [tau * c / gain for c in wanted[2:]]
        k = [as_printed(x) for x in (damping, *lowest)]
        if wish.output == "speed":
            return _for_speed(wish, k, gain, cutoff)
        return _for_position(wish, k, cutoff)

    def told(self, wish: Wish) -> str:
        if wish.poles:
            return f"--poles {','.join(_written(pole) for pole in wish.poles)}"
        return f"--damping {wish.damping:g} --bandwidth {wish.bandwidth:.3g}"


def _denominator(wish: Wish) -> list[float]:
    """The coefficients of Π (s - pole), the highest first; raises `UsageError` where the wish isn't whole."""
    if wish.closed_loop is not None:
        raise UsageError("--lambda is a wish for lambda_tuning; say --damping and --bandwidth, or --poles")
    if wish.poles and (wish.damping is not None or wish.bandwidth is not None):
        raise UsageError("--poles says all that --damping and --bandwidth do; give the one or the others")
    if wish.poles:
        return _of_poles(wish)
    if wish.damping is None or wish.bandwidth is None:
        raise UsageError(
            "pole_placement needs --damping and --bandwidth, such as --damping 0.8 --bandwidth 20, or --poles"
        )
    if not (wish.damping > 0 and wish.bandwidth > 0 and math.isfinite(wish.damping * wish.bandwidth)):
        raise UsageError(f"--damping {wish.damping:g} --bandwidth {wish.bandwidth:g}: expected both above 0")
    if max(wish.bandwidth, wish.damping * wish.bandwidth) > _FASTEST:
        raise UsageError(
            f"--damping {wish.damping:g} --bandwidth {wish.bandwidth:g}: {_NO_FASTER}; expected a bandwidth such as 20"
        )
    return [1.0, 2 * wish.damping * wish.bandwidth, wish.bandwidth**2]


def _of_poles(wish: Wish) -> list[float]:
    # One of a complex pair stands for both, and both may be said, too.
    poles = [*wish.poles]
    poles += [p.conjugate() for p in wish.poles if p.imag and p.conjugate() not in wish.poles]
    if not all(math.isfinite(abs(p)) and p.real < 0 for p in poles):
        raise UsageError(
            f"--poles {','.join(map(_written, poles))}: expected poles left of zero, such as -20 or -15+10j"
        )
    if max(map(abs, poles)) > _FASTEST:
        raise UsageError(
            f"--poles {','.join(map(_written, poles))}: {_NO_FASTER}; expected poles such as -20"
        )
    if len(poles) not in {2, 3}:
        raise UsageError(
            f"--poles: {len(poles)} poles; expected two, or three for a position with an integral part"
        )
    return [float(c) for c in np.real(np.poly(poles))]


def _written(pole: complex) -> str:
    return f"{pole.real:.3g}" if not pole.imag else f"{pole.real:.3g}{pole.imag:+.3g}j"


def _for_position(wish: Wish, k: list[float], cutoff: float) -> Tunable:
    damping, proportional, *integral = k
    if wish.controller == "pid":
        if integral:
            return Pid(kp=proportional, ki=integral[0], kd=damping, b=0.0, cutoff=cutoff)
        return Pid(kp=proportional, kd=damping, cutoff=cutoff)
    if wish.controller == "state_feedback":
        if integral:
            return StateFeedback(
                position_gain=proportional,
                speed_gain=damping,
                integral_gain=integral[0],
                reference_gain=0.0,
                cutoff=cutoff,
            )
        return StateFeedback(position_gain=proportional, speed_gain=damping, cutoff=cutoff)
    raise unsupported(wish, "pole_placement", "pid, state_feedback and lead")


def _for_speed(wish: Wish, k: list[float], gain: float, cutoff: float) -> Tunable:
    if len(k) != 2:
        raise UsageError("--poles: a speed loop has two poles; expected two, such as --poles -20,-30")
    proportional, integral = k
    if wish.controller == "pid":
        return Pid(output="speed", kp=proportional, ki=integral, b=0.0, cutoff=cutoff)
    if wish.controller == "state_feedback":
        return StateFeedback(
            output="speed",
            position_gain=0.0,
            speed_gain=proportional,
            integral_gain=integral,
            reference_gain=0.0,
            cutoff=cutoff,
        )
    raise unsupported(wish, "pole_placement", "pid and state_feedback")


def _lead(wish: Wish, gain: float, tau: float, wanted: list[float]) -> Lead:
    if wish.output != "position":
        raise unsupported(
            wish, "pole_placement", "lead with the position, and pid and state_feedback with both"
        )
    if len(wanted) != 3:
        raise UsageError("--poles: behind a lead compensator the position has two poles; expected two")
    pole, zero = wanted[1], 1 / tau
    if pole <= zero:
        raise UsageError(
            f"the sum of the poles, {pole:.3g} rad/s, has to be more than 1/time constant = {zero:.3g} rad/s: slower than "
            "that nothing has to lead"
        )
    return Lead(
        gain=as_printed(wanted[2] / (gain * pole)),
        zero=as_printed(zero),
        pole=as_printed(pole),
    )


pole_placement = METHODS.member("pole_placement")(_PolePlacement())
