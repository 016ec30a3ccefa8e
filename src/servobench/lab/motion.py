"""The shaft's motion in a recording: voltage and angle over time, the changes of the voltage, and the speed.

At the levels of a staircase the current is examined, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import MissingInformation

if TYPE_CHECKING:
    from servobench.recordings.recording import Recording

_LEAST = 2  # samples of a half level


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Times t [s], applied voltage [V] and angle since the start [rad], each (N,); `count` is the angle of one count [rad].

    The voltage at k holds from t[k] on. The angle is that of the unwrapped counter, whole counts, 0 at the start.
    """

    t: Array
    voltage: Array
    angle: Array
    count: float

    @property
    def area(self) -> float:
        """The integral of the voltage over time [V·s]."""
        return float(self.voltage[:-1] @ np.diff(self.t))

    def between(self, start: float, end: float) -> Motion:
        """Return the part from one time to another [s], both included; times and angles stay as they are."""
        slack = 1e-6 * float(self.t[1] - self.t[0])
        return self.of((self.t >= start - slack) & (self.t <= end + slack))

    def of(self, part: NDArray[np.bool_]) -> Motion:
        """Return the samples for which `part` (N,) is true; times and angles stay as they are."""
        return Motion(t=self.t[part], voltage=self.voltage[part], angle=self.angle[part], count=self.count)

    @property
    def mean_speed(self) -> float:
        """The angle from the first to the last sample over the time between them [rad/s]."""
        return float((self.angle[-1] - self.angle[0]) / (self.t[-1] - self.t[0]))

    @property
    def starts(self) -> tuple[int, ...]:
        """The first sample of each level of the voltage: 0, and each sample whose voltage differs from the one before."""
        return (0, *(int(k) + 1 for k in np.flatnonzero(np.diff(self.voltage))))


def motion_of(recording: Recording) -> Motion:
    """Return the motion in a recording of a run; raises `MissingInformation` where it doesn't say how many counts make a turn."""
    from servobench.recordings.measurement.unwrap import unwrap

    counts = recording["counts"]
    per_rev, bits = counts.channel.counts_per_rev, counts.channel.counter_bits
    t = recording["applied"].t
    if per_rev is None or t is None:
        raise MissingInformation(
            recording.name, ["how many counts make a turn (counts_per_rev), and the times"]
        )
    travel = np.asarray(counts.values, dtype=float)
    if bits is not None:
        travel = unwrap(travel, 2.0**bits).count
    count = 2 * math.pi / per_rev
    return Motion(t=t, voltage=recording["applied"].values, angle=(travel - travel[0]) * count, count=count)


def speed_of(recording: Recording, chain: str) -> tuple[Array, Array]:
    """Return the speed behind a chain [rad/s] and its times [s], (N,) each."""
    from servobench.recordings.measurement.measure import measure

    data = measure(recording, chain)
    return data.t_output, data.y


@dataclass(frozen=True, kw_only=True)
class Level:
    """A voltage [V], and the mean current [A] and speed [rad/s] over the second half of the time that it was held."""

    voltage: float
    current: float
    speed: float


def at_levels(recording: Recording, dwell: float) -> tuple[Level, ...]:
    """Return what happened in the second half of each level, each held for `dwell` [s] from the first sample on.

    Raises `MissingInformation` for a recording without a current.
    """
    from servobench.recordings.measurement.measure import measure

    current = measure(recording).current
    if current is None:
        raise MissingInformation(recording.name, ["a channel with the armature's current"])
    motion = motion_of(recording)
    since = motion.t - motion.t[0]
    step = float(motion.t[1] - motion.t[0])
    levels = []
    for number in range(round((since[-1] + step) / dwell)):
        # A sample on the edge is latched before the next voltage acts, so it belongs to this level.
        late = (since > (number + 0.5) * dwell) & (since <= (number + 1) * dwell + 1e-6 * step)
        if np.count_nonzero(late) < _LEAST:
            continue
        part = motion.of(late)
        levels.append(
            Level(
                voltage=float(part.voltage[0]),
                current=float(np.nanmean(current[late])),
                speed=part.mean_speed,
            )
        )
    return tuple(levels)
