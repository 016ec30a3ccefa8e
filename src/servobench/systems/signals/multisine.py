"""A sum of harmonics of equal amplitude, with phases that keep its peak small or with random ones."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from servobench.core.channels import Array
from servobench.core.settings import PositiveFrequency, Settings, Time
from servobench.systems.signals.base import SIGNALS, Amplitude, Level
from servobench.systems.signals.edges import is_past

_MOST_HARMONICS = 20_000
_BLOCK = 2**18  # values of all harmonics at a time, 2 MB


@SIGNALS.member("multisine")
class Multisine(Settings):
    """offset + a · Σ cos(2π k f (t - start) + φₖ) over the harmonics k with lowest <= k f <= highest; `offset` before `start`.

    `a` makes the peak equal to `amplitude`: never more, at most 0.13 % less. Schroeder's phases φᵢ = -π i (i
    - 1) / N for the i-th of N harmonics keep the peak small (Schroeder, IEEE Trans. Inf. Theory 16, 1970);
    random phases are uniform in [0, 2π) and come from the signal's own seed. With odd harmonics only,
    nonlinearities show at the even ones.

    >>> Multisine(amplitude=3, frequency="0.5 Hz", lowest="0.5 Hz", highest="10 Hz").period
    2.0
    """

    amplitude: Amplitude = 3.0
    """Largest departure from the offset [V]."""
    offset: Level = 0.0
    """Mean value [V]."""
    frequency: PositiveFrequency = 0.1
    """Distance of the harmonics; its inverse is the period [Hz]."""
    lowest: PositiveFrequency | None = None
    """Lowest frequency; left out, it is `frequency` [Hz]."""
    highest: PositiveFrequency = 5.0
    """Highest frequency [Hz]."""
    harmonics: Literal["all", "odd"] = "all"
    """Which multiples of `frequency` are in it: `all` or `odd` ones."""
    phases: Literal["schroeder", "random"] = "schroeder"
    """How the phases are chosen: `schroeder` or `random`."""
    seed: Annotated[int, Field(ge=0, strict=True)] = 0
    """Seed of the random phases."""
    start: Time = 0.0
    """Time at which the signal begins [s]."""

    @model_validator(mode="after")
    def _has_harmonics(self) -> Self:
        if self.highest > _MOST_HARMONICS * self.frequency:
            raise ValueError(
                f"highest is more than {_MOST_HARMONICS} times frequency = {self.frequency:g} Hz; raise frequency"
            )
        if not self._multiples:
            low = self.frequency if self.lowest is None else self.lowest
            kind = "odd multiple" if self.harmonics == "odd" else "multiple"
            raise ValueError(
                f"no {kind} of frequency = {self.frequency:g} Hz lies between lowest = {low:g} Hz "
                f"and highest = {self.highest:g} Hz"
            )
        return self

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        t = np.asarray(t, dtype=float)
        cycles = self.frequency * (t - self.start)
        fraction = (cycles - np.floor(cycles)).ravel()
        k, phase, peak = _composition(self._multiples, self.phases, self.seed)
        total = np.empty_like(fraction)
        rows = max(1, _BLOCK // len(k))
        for first in range(0, len(fraction), rows):
            block = fraction[first : first + rows, np.newaxis]
            total[first : first + rows] = np.cos(2 * math.pi * block * k + phase).sum(axis=1)
        wave = self.offset + self.amplitude / peak * total.reshape(t.shape)
        return np.where(is_past(t, self.start), wave, self.offset)

    @property
    def period(self) -> float:
        """The inverse of the distance of the harmonics [s]."""
        return 1 / self.frequency

    @property
    def shortest_change(self) -> float:
        """Half a period of the highest harmonic [s]."""
        return 0.5 / (self._multiples[-1] * self.frequency)

    @property
    def crest_factor(self) -> float:
        """Peak over root mean square, both without the offset; a sine has √2, and less is better."""
        k, _, peak = _composition(self._multiples, self.phases, self.seed)
        return peak / math.sqrt(len(k) / 2)

    @property
    def _multiples(self) -> range:
        """The harmonics k, ascending; a frequency that is a multiple but for rounding counts as one."""
        low = 1.0 if self.lowest is None else self.lowest / self.frequency
        first, last = max(1, math.ceil(low - 1e-9)), math.floor(self.highest / self.frequency + 1e-9)
        if self.harmonics == "odd":
            return range(first | 1, last + 1, 2)
        return range(first, last + 1)


@lru_cache(maxsize=8)
def _composition(
    multiples: range, phases: Literal["schroeder", "random"], seed: int
) -> tuple[Array, Array, float]:
    """The harmonics k (N,), their phases [rad] (N,), and the peak of the sum of their cosines."""
    k, n = np.array(multiples), len(multiples)
    if phases == "schroeder":
        i = np.arange(1, n + 1)
        phase = -math.pi * i * (i - 1) / n
    else:
        # Raw 64-bit words: NumPy promises that these stay the same in later versions, of `uniform` it doesn't.
        phase = 2 * math.pi * (np.random.PCG64(seed).random_raw(n) / 2.0**64)
    # A trigonometric polynomial of degree K falls off from its peak not faster than cos(K x) (M. Riesz, 1914), and the grid has a
    # point within x = π/M of it: so the largest value on the grid, over cos(π K / M) > 0.9987, is no less than the peak.
    degree = int(k[-1])
    points = 64 * degree
    spectrum = np.zeros(points // 2 + 1, dtype=complex)
    spectrum[k] = points / 2 * np.exp(1j * phase)
    peak = np.abs(np.fft.irfft(spectrum, points)).max() / math.cos(math.pi * degree / points)
    return k.astype(float), phase, float(peak)
