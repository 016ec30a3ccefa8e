"""The shaft's motion in a check's recording: counts without wraps, and the voltage, over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.measurement.unwrap import unwrap
from servobench.recordings.recording import Recording


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckRun:
    """The samples of a run: times `t` [s], `raw` counts as the counter shows them, and `counts` without its wraps, each (N,).

    The wraps are taken out by the width that the device says; `sensors` are current [A] and tachometer [rad/s], if any.
    """

    recording: Recording
    """Their source."""
    t: Array
    raw: Array
    counts: Array
    sensors: dict[str, Array]

    @classmethod
    def of(cls, recording: Recording) -> Self:
        """Return what a recording shows, from its first sample on."""
        series = recording["counts"]
        raw, bits = series.values, series.channel.counter_bits
        t = np.arange(len(raw), dtype=np.float64) if series.t is None else series.t
        usable = np.isfinite(raw) & np.isfinite(t)  # a run that a fault ended may hold a sample that isn't
        raw, t = raw[usable], t[usable]
        return cls(
            recording=recording,
            t=t,
            raw=raw,
            counts=unwrap(raw, 2.0**bits).count if bits else raw,
            sensors={
                name: recording[name].values[usable]
                for name in ("current", "tachometer")
                if name in recording and len(recording[name].values) == len(usable)
            },
        )

    def between(self, begin: float, end: float) -> Array:
        """Return the counts from one time [s] on, and before another; at least the sample that is nearest to the first."""
        counts = self.counts[(self.t >= begin) & (self.t < end)]
        return counts if len(counts) else self.counts[[int(np.argmin(np.abs(self.t - begin)))]]

    def at(self, time: float) -> float:
        """Return the counts at the last sample up to a time [s]."""
        return float(self.counts[max(int(np.searchsorted(self.t, time, side="right")) - 1, 0)])

    def speed(self, begin: float, end: float) -> float:
        """Return the mean speed between two times [counts/s]: the slope of a straight line."""
        inside = (self.t >= begin) & (self.t < end)
        t = self.t[inside]
        if len(t) < 2:
            return 0.0
        t = t - t.mean()
        return round(float(t @ self.counts[inside] / (t @ t)), 6)

    def range(self, begin: float, end: float) -> float:
        """Return the difference between the largest and the smallest count between two times [s]."""
        return float(np.ptp(self.between(begin, end)))

    @property
    def duration(self) -> float:
        """The time of the last sample [s]."""
        return float(self.t[-1]) if len(self.t) else 0.0
