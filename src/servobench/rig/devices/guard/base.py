"""The kind `monitors`: each looks at every sample of a run, and says when the motor must be stopped."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol, Self, runtime_checkable

from servobench.core.channels import DeviceInfo, Sample
from servobench.core.finding import Finding
from servobench.core.registry import Registry
from servobench.rig.devices import handover as at
from servobench.rig.devices.handover import Handover
from servobench.rig.experiment.limits import Limits

# At 2048 counts a turn a count is 0.3 rad/s then, and a shaft that stops dead from 200 rad/s is below 1 rad/s after 53 ms.
SMOOTHING = 0.01  # s


class Alarm(NamedTuple):
    """A reason to stop the motor: a stable code, and a sentence with what was found, what was expected, and what to do."""

    code: str
    sentence: str


@dataclass(frozen=True, kw_only=True)
class Nominal:
    """A motor as known beforehand, within 20 %: gain K [rad/(s·V)], time constant τ [s], Coulomb voltage [V].

    `resistance` of the winding [Ω] is None if unknown.
    """

    gain: float
    time_constant: float
    coulomb_voltage: float
    resistance: float | None = None


@dataclass(frozen=True, kw_only=True)
class Rig:
    """A monitor's conditions: limits, the device's `info`, the sample time [s], and the nominal motor if one is known."""

    limits: Limits
    info: DeviceInfo
    sample_time: float
    nominal: Nominal | None

    @property
    def angle(self) -> float | None:
        """The angle of a count [rad]; None where the device doesn't say how many make a turn."""
        channel = self.info.channel("counts")
        return 2 * math.pi / channel.counts_per_rev if channel and channel.counts_per_rev else None

    @property
    def in_volts(self) -> bool:
        """Whether what is put out is a voltage, so that limits in volts mean something."""
        channel = self.info.channel("voltage")
        return channel is None or channel.unit in (None, "V")


class Motion:
    """The state of a monitor in a run; every sample changes it.

    `time` of the last sample and `dt` since the one before [s]; `step` of the encoder since then and `position` since the start,
    both in counts and unwrapped by the half-range rule: of all steps that the counter may have made, the shortest.
    `speed`, smoothed over 10 ms (two samples where that is more), and `fastest`, the larger one of that and of the
    tachometer, in rad/s, or in counts/s where the counts of a turn aren't known. `current` [A], None where it isn't measured.
    `applied` is the voltage that held until this sample [V]; `feedback` says whether a controller answers to the samples.
    """

    __slots__ = (
        "_angle",
        "_counts",
        "_first",
        "_half",
        "_range",
        "_sample_time",
        "_smoothing",
        "applied",
        "current",
        "dt",
        "fastest",
        "feedback",
        "position",
        "speed",
        "step",
        "time",
    )

    def __init__(self, rig: Rig) -> None:
        channel = rig.info.channel("counts")
        bits = channel.counter_bits if channel else None
        self._half = 1 << (bits - 1) if bits else 0
        self._range = 2 * self._half
        self._angle = rig.angle or 1.0
        self._sample_time = rig.sample_time
        self._smoothing = max(SMOOTHING, 2 * rig.sample_time)
        self._counts: int | None = None
        self._first = 0
        self.time, self.dt = 0.0, rig.sample_time
        self.step = self.position = 0
        self.speed = self.fastest = self.applied = 0.0
        self.current: float | None = None
        self.feedback = False

    def take(self, sample: Sample) -> None:
        """Take the next sample."""
        counts = sample.counts
        if self._counts is None:
            self._counts = self._first = counts
            self.time = sample.time - self._sample_time
        dt = sample.time - self.time
        # A clock that stands or goes back tells nothing; the tick was as long as it should be, for all that is known.
        dt = dt if dt > 0.0 else self._sample_time
        step = counts - self._counts
        if self._half:
            step = (step + self._half) % self._range - self._half
        self._counts, self.time, self.dt, self.step = counts, sample.time, dt, step
        self.position += step
        self.speed += (step * self._angle / dt - self.speed) * dt / (self._smoothing + dt)
        self.current = sample.current
        fastest = self.speed if self.speed >= 0.0 else -self.speed
        if sample.tachometer is not None:
            speed = abs(sample.tachometer)
            fastest = fastest if speed <= fastest else speed  # NaN goes through, to be noticed
        self.fastest = fastest

    @property
    def unwrapped(self) -> int:
        """The last sample's counts as a counter without wraps would show them."""
        return self._first + self.position

    def hand_over(self, to: Handover) -> None:
        """Write what a sample is seen by, and the state after the last one."""
        to.p[at.HALF_COUNTER], to.p[at.ANGLE] = self._half, self._angle
        to.p[at.SMOOTHING], to.p[at.FEEDBACK] = self._smoothing, self.feedback
        to.s[at.COUNTS : at.APPLIED + 1] = (
            self._counts or 0,
            self.time,
            self.dt,
            self.step,
            self.position,
            self.speed,
            self.fastest,
            self.applied,
        )

    def take_back(self, block: Handover) -> None:
        """Read the state after the last sample."""
        counts, self.time, self.dt, step, position, self.speed, self.fastest, self.applied = block.s[
            at.COUNTS : at.APPLIED + 1
        ].tolist()
        self._counts, self.step, self.position = int(counts), int(step), int(position)
        self.current = float(block.s[at.SEEN_CURRENT]) if block.p[at.CURRENT_STEP] else None


@runtime_checkable
class Monitor(Protocol):
    """Looks at each sample of one run; its state is of that run alone."""

    heading: ClassVar[str]
    """The watched quantity, as the heading of a row."""
    codes: ClassVar[tuple[str, ...]]
    """The codes of its alarms and findings."""

    @property
    def limit(self) -> str:
        """The limit that it holds the motor to, with its numbers, in a few words."""
        ...

    @classmethod
    def of(cls, rig: Rig) -> Self | None:
        """Return a monitor for a run, or None where it is switched off or nothing is known to watch by.

        Raises `UsageError` for a limit that can't be checked on this device.
        """
        ...

    def check(self, motion: Motion) -> Alarm | None:
        """Return why the motor must be stopped, or None."""
        ...

    def findings(self) -> tuple[Finding, ...]:
        """Return what is worth knowing of the run so far."""
        ...


MONITORS: Registry[type[Monitor]] = Registry(
    "monitor", "servobench.rig.devices.guard", "servobench.devices.guard"
)
