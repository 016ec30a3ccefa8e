"""A bounded input that drives a system off, and how fast: the proof that it isn't BIBO stable, by algebra and by simulation.

With R = lim (s - p)^m G(s) at a pole p of multiplicity m, the output y grows, t after the input began and the delay passed, as

    p = 0, input 1                 |R| t^m/m!
    p = jω, input sin ωt           |R| t^m/m!                       (the envelope of an oscillation)
    Re p > 0, input 1              c |R/p| t^(m-1)/(m-1)! e^(Re p t), c = 1 for a real pole, 2 for a pair (the envelope)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import plain, power_of_ten
from servobench.systems.responses import step_response
from servobench.systems.signals.base import Signal
from servobench.systems.signals.constant import Constant
from servobench.systems.signals.sine import Sine
from servobench.systems.stability.poles import Pole, multiplicity_at
from servobench.systems.transfer_function import TransferFunction


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A bounded input, `signal`, from t = 0 on, that drives `system` off at its pole `pole` [1/s].

    The output's size grows as `coefficient` · t^`power` · e^(`rate` t): `coefficient` in the output's unit / s^power per unit of
    the input, `rate` in 1/s, 0 for a pole on the imaginary axis.
    """

    system: TransferFunction
    signal: Signal
    pole: complex
    power: int
    rate: float
    coefficient: float

    def simulate(self, t: Array) -> Array:
        """Return the output (N,) at times t [s], from rest, computed from the system itself and not from its poles."""
        omega = abs(self.pole.imag) if self.rate == 0 else 0.0
        return step_response(_behind_sine(self.system, omega) if omega else self.system, t)

    @property
    def sentence(self) -> str:
        """The input, and the output that it leads to, in words."""
        sinusoid = self.rate == 0 and self.pole.imag != 0
        what = f"A sinusoid of {plain(abs(self.pole.imag))} rad/s" if sinusoid else "A constant"
        how = "in proportion to " + {1: "time", 2: "the square of time"}.get(
            self.power, f"time to the power of {self.power}"
        )
        if self.rate:
            growth = {0: "", 1: "t · "}.get(self.power, f"t{_superscript(self.power)} · ")
            how = f"as {growth}e^({plain(self.rate)}/s · t)"
        size = "swings that grow" if self.pole.imag else "an output that grows"
        first = f", {plain(self.coefficient)} {_unit(self.system, self.power)}" if not self.rate else ""
        return f"{what} as input, although bounded, gives {size} {how}{first}."


def drive_off(system: TransferFunction, poles: Sequence[Pole]) -> Drive | None:
    """Return a bounded input that drives a system off at the rightmost of its poles; None where there is none.

    `poles` are those outside the left half-plane that no zero cancels, with the multiplicity that is left.
    """
    # Of a pair the upper one; of several on the axis the one with most growth.
    upper = [pole for pole in poles if pole.at.imag >= 0]
    if not upper:
        return None
    pole = max(upper, key=lambda p: (p.at.real if p.side > 0 else 0.0, p.multiplicity))
    m, at = pole.multiplicity, pole.at
    residue = abs(_leading_coefficient(system, pole))
    if pole.side == 0:
        signal = (
            Sine(amplitude=1.0, frequency=abs(at.imag) / (2 * math.pi)) if at.imag else Constant(value=1.0)
        )
        return Drive(
            system=system,
            signal=signal,
            pole=at,
            power=m,
            rate=0.0,
            coefficient=residue / math.factorial(m),
        )
    return Drive(
        system=system,
        signal=Constant(value=1.0),
        pole=at,
        power=m - 1,
        rate=at.real,
        coefficient=(1 if at.imag == 0 else 2) * residue / abs(at) / math.factorial(m - 1),
    )


def _leading_coefficient(system: TransferFunction, pole: Pole) -> complex:
    """lim (s - p)^m N(s)/D(s): by Taylor's series, of which zeros that cancel take the first terms."""
    n, d = np.asarray(system.numerator), np.asarray(system.denominator)
    # The pole stands in D as often as it is left over, and as often again as a zero cancels it.
    zeros, m = multiplicity_at(system.numerator, pole.at), pole.multiplicity
    above = np.polyval(np.polyder(n, zeros), pole.at) / math.factorial(zeros)
    below = np.polyval(np.polyder(d, m + zeros), pole.at) / math.factorial(m + zeros)
    return complex(above / below)


def _behind_sine(system: TransferFunction, omega: float) -> TransferFunction:
    """The system whose step response is the given system's response to sin ωt: ω s/(s² + ω²) times it."""
    return TransferFunction(
        numerator=tuple(map(float, np.convolve(system.numerator, (omega, 0.0)))),
        denominator=tuple(map(float, np.convolve(system.denominator, (1.0, 0.0, omega**2)))),
        delay=system.delay,
        output=system.output,
        unit=system.unit,
    )


def _unit(system: TransferFunction, power: int) -> str:
    """The unit of the growth for each unit of the input: `rad/s per V` of `rad/(s·V)` once over time."""
    over = {1: "s"}.get(power, f"s{_superscript(power)}")
    return f"{system.unit} for each {over}"


def _superscript(power: int) -> str:
    return power_of_ten(power).removeprefix("10")
