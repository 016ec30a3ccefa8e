"""The noise of a constant speed due to an encoder's steps: exact, at any speed, behind any chain.

At a constant speed ω the counts are floor(r k + φ), r = ω T/Δ. Nothing in them is random: their error is the sawtooth -frac(r k
+ φ), which only depends on the fraction f of r. It is a sum of sines at n f cycles per sample, n = 1, 2, …, with amplitudes
1/(π n) counts, folded back below half a cycle per sample. So the noise at a given speed isn't white: it is a set of lines, and
a low-pass filter can't remove a line near zero frequency. All formulas here follow from that sawtooth by algebra
(docs/decisions/0025-filters.md).
"""

from __future__ import annotations

import math

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.numbers import check_positive
from servobench.systems.filters.base import SpeedEstimate
from servobench.systems.filters.response import impulse_response


def count_fraction(speed: float, sample_time: float, quantum: float) -> float:
    """Return f, the fractional part of ω T/Δ, for a speed [rad/s], a sample time [s] and an encoder's step [rad].

    Raises `UsageError` for a speed that isn't finite, and for one of the others that isn't positive.
    """
    check_positive("the sample time", sample_time, "s")
    check_positive("the encoder's step", quantum, "rad")
    if not math.isfinite(speed):
        raise UsageError(f"the speed is {speed:g} rad/s; expected a finite number")
    return float(np.mod(speed * sample_time / quantum, 1.0))


def derivative_noise(speed: float, sample_time: float, quantum: float) -> float:
    """Return the rms error of the difference of counts at a constant speed [rad/s]: (Δ/T) √(f (1 - f)).

    A share f of the differences has one count more than the rest, so each is off by 1 - f or by -f counts. The mean over
    a record is this at any start position. Between 0, where a sample takes whole counts, and Δ/(2T).
    """
    f = count_fraction(speed, sample_time, quantum)
    return quantum / sample_time * math.sqrt(f * (1.0 - f))


def noise(estimate: SpeedEstimate, speed: float, sample_time: float, quantum: float) -> float:
    """Return the rms error of a speed estimate at a constant speed [rad/s], after it has settled.

    σ² = Δ² Σₗ C[l] R[l], with C the autocorrelation of the estimate's response to one sample and that of the saw-tooth,
    R[l] = 1/12 - fₗ (1 - fₗ)/2, fₗ = frac(l f). As speed estimates answer a constant position by zero, the 1/12 adds up to
    nothing. Exact for any start position: where f is a fraction p/q, another start position only shifts the pattern in time.
    """
    f = count_fraction(speed, sample_time, quantum)
    together = _autocorrelation(impulse_response(estimate, sample_time))
    part = np.mod(np.arange(len(together)) * f, 1.0)
    shared = -0.5 * part * (1.0 - part)
    variance = float(together[0] * shared[0] + 2.0 * (together[1:] @ shared[1:]))
    return quantum * math.sqrt(max(variance, 0.0))  # below zero by rounding only, where there is no noise


def mean_noise(estimate: SpeedEstimate, sample_time: float, quantum: float) -> float:
    """Return the rms error of a speed estimate over all speeds, or while the speed changes: (Δ/√12) √(Σ g²).

    With f spread evenly, the errors of different samples are independent: Δ/√12 each (Widrow and Kollár 2008). The difference
    alone has Δ/(√6 T). `quantum` Δ is in rad, `sample_time` T in s.
    """
    check_positive("the encoder's step", quantum, "rad")
    g = impulse_response(estimate, sample_time)
    return quantum / math.sqrt(12.0) * float(np.linalg.norm(g))


def _autocorrelation(g: Array) -> Array:
    """C[l] = Σ g[k] g[k + l] (N,) for l from 0 on."""
    spectrum = np.fft.rfft(g, 2 * len(g))
    return np.asarray(np.fft.irfft(np.abs(spectrum) ** 2, 2 * len(g))[: len(g)])
