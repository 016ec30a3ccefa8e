"""A sine after a first-order low-pass filter: amplitude, power, decibels and phase."""

from __future__ import annotations

import math
from dataclasses import dataclass

from servobench.core.numbers import check_positive


@dataclass(frozen=True, kw_only=True)
class Attenuation:
    """A sine after the filter: `amplitude` as a part of one [1], `phase` [rad], negative for a lag."""

    amplitude: float
    phase: float

    @property
    def power(self) -> float:
        """The part of the power that is left, amplitude² [1]."""
        return self.amplitude**2

    @property
    def decibels(self) -> float:
        """20 lg of the amplitude, which is 10 lg of the power [dB]."""
        return 20.0 * math.log10(self.amplitude) if self.amplitude else -math.inf


def attenuation(cutoff: float, omega: float) -> Attenuation:
    """Return what ω_c/(s + ω_c) leaves of a sine of ω, both in rad/s: 1/√(1 + (ω/ω_c)²), late by arctan(ω/ω_c).

    It follows from s = jω by algebra. At the cut-off that is an amplitude of 1/√2 = 70.7 %, and half of the power: -3.01 dB.
    """
    check_positive("the cut-off of a low-pass filter", cutoff, "rad/s")
    ratio = omega / cutoff
    return Attenuation(amplitude=1.0 / math.hypot(1.0, ratio), phase=-math.atan(ratio))
