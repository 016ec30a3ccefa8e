"""An encoder that stands still although the motor must be turning: a stuck channel raises no error of its own."""

from __future__ import annotations

import math
from typing import ClassVar, Self

from servobench.core.finding import Finding
from servobench.core.rounding import milliseconds
from servobench.rig.devices import handover as at
from servobench.rig.devices.guard.base import MONITORS, SMOOTHING, Alarm, Motion, Nominal, Rig
from servobench.rig.devices.handover import Handover

BAND = 2  # counts; a channel that is stuck leaves the other one, which makes a count toggle
_SLUGGISH = 0.5  # of the nominal acceleration; R, k and J 20 % off make 0.8 / 1.2² = 0.56, friction 20 % off another 2 %
_CLEARLY = 2  # times the band: how far the shaft must have turned before its absence is a fault
_AT_SPEED = 0.5  # of the steady speed at the smallest voltage; k and friction 20 % off make 0.73
BLOCKED_SHARE = 0.6  # of what a winding at rest draws; R 20 % off makes 0.83 at rest


@MONITORS.member("plausibility")
class PlausibilityMonitor:
    """A fault where the encoder stands still while the voltage must be turning the shaft.

    The encoder stands while it stays within ±2 counts of where it was. Under a voltage of one direction, of at least
    u = `limits.plausibility.voltage`, a motor near rest accelerates by a = K (u - u_c) / τ, by half of that at the very least
    where its R, k, J and friction are within 20 %. In a time T it covers the smallest range where it comes to rest in the middle
    and turns back: (a/2) (T/2)² / 2. That is twice the band, of 2·2 + 1 counts of q rad, after

        T = √(8 · 2 · 5 q / (a/2)),

    34 ms for a QUBE-Servo with 2048 counts a turn: an encoder that stands for T is not that of a motor that turns freely.

    A blocked shaft looks the same, and belongs to the stall monitor. The current separates the two, if it is
    measured and the winding's resistance is known: at rest it is u/R, so below 0.6 u/R the motor turns, if it was seen to draw
    more before: a voltage that is still on its way, or an amplifier that is off, draws nothing at all. Without a current, and to
    begin with, an encoder is suspect where it went from at least half of the steady speed at u to standing at once, within its
    own smoothing, as no shaft does that isn't hit; one that was dead from the start is not noticed then.
    """

    heading: ClassVar[str] = "Standstill of the encoder"
    codes: ClassVar[tuple[str, ...]] = ("encoder-stands-still",)

    def __init__(
        self, nominal: Nominal, voltage: float, angle: float, smoothing: float, delay: float
    ) -> None:
        slowest = _SLUGGISH * nominal.gain * (voltage - nominal.coulomb_voltage) / nominal.time_constant
        self._patience = math.sqrt(8 * _CLEARLY * (2 * BAND + 1) * angle / slowest) + delay
        self._voltage = voltage * (1 - 1e-9)
        self._at_speed = _AT_SPEED * nominal.gain * voltage
        self._resistance, self._smoothing = nominal.resistance, smoothing
        self._anchor = 0
        self._before = 0.0  # rad/s, when the encoder last left its band
        self._smooth = 0.0  # V
        self._blocked = self._drove = False
        self._standing = self._pushed = 0.0  # s
        self._direction = 0

    @classmethod
    def of(cls, rig: Rig) -> Self | None:
        """Return a monitor if a motor is known to compare the encoder with."""
        if rig.limits.plausibility is None or rig.nominal is None or rig.angle is None or not rig.in_volts:
            return None
        smoothing = max(SMOOTHING, 2 * rig.sample_time)
        return cls(rig.nominal, rig.limits.plausibility.voltage, rig.angle, smoothing, rig.info.delay)

    @property
    def patience(self) -> float:
        """T, how long the encoder may stand while the voltage pushes [s]."""
        return self._patience

    @property
    def limit(self) -> str:
        """The longest standstill of the encoder."""
        return f"at most {1000 * self._patience:.2g} ms while the voltage turns the motor, from {self._voltage:g} V on"

    def check(self, motion: Motion) -> Alarm | None:
        """Return an alarm where the encoder has stood for too long."""
        u, dt = motion.applied, motion.dt
        if -BAND <= motion.position - self._anchor <= BAND:
            self._standing += dt
        else:
            self._anchor, self._standing, self._before = motion.position, 0.0, motion.speed
            self._drove = False
        direction = 1 if u >= self._voltage else -1 if u <= -self._voltage else 0
        if direction != self._direction:
            self._direction, self._pushed, self._drove = direction, 0.0, False
        self._pushed += dt
        if motion.current is not None and self._resistance is not None:
            self._draw(motion.current * self._resistance, abs(u), dt)
        if not direction or self._standing < self._patience or self._pushed < self._patience:
            return None
        return self._alarm(motion) if self._turns(motion) else None

    def hand_over(self, to: Handover) -> None:
        """Write the limits and the state."""
        to.p[at.PATIENCE], to.p[at.SUSPECT_VOLTAGE], to.p[at.AT_SPEED] = (
            self._patience,
            self._voltage,
            self._at_speed,
        )
        to.p[at.RESISTANCE] = math.nan if self._resistance is None else self._resistance
        to.s[at.ANCHOR : at.DIRECTION + 1] = (
            self._anchor,
            self._before,
            self._smooth,
            self._blocked,
            self._drove,
            self._standing,
            self._pushed,
            self._direction,
        )

    def take_back(self, block: Handover) -> None:
        """Read the state."""
        anchor, self._before, self._smooth, blocked, drove, self._standing, self._pushed, direction = block.s[
            at.ANCHOR : at.DIRECTION + 1
        ].tolist()
        self._anchor, self._direction = int(anchor), int(direction)
        self._blocked, self._drove = bool(blocked), bool(drove)

    def findings(self) -> tuple[Finding, ...]:
        """Return nothing: what there is to say is the fault."""
        return ()

    def _draw(self, drop: float, pushing: float, dt: float) -> None:
        """Take what the current takes from the voltage, i R [V], and note whether it was ever that of a winding at rest."""
        self._smooth += (drop - self._smooth) * dt / (self._smoothing + dt)
        at_rest = BLOCKED_SHARE * pushing
        self._blocked = max(drop * self._direction, self._smooth * self._direction) >= at_rest
        self._drove = self._drove or drop * self._direction >= at_rest

    def _turns(self, motion: Motion) -> bool:
        """Whether the shaft turns, for all that is known beside the encoder."""
        was_at_speed = self._before * self._direction >= self._at_speed
        if motion.current is None or self._resistance is None:
            return was_at_speed
        return not self._blocked and (was_at_speed or self._drove)

    def _alarm(self, motion: Motion) -> Alarm:
        stood = min(self._standing, self._pushed)
        return Alarm(
            "encoder-stands-still",
            f"the encoder stood still for {milliseconds(self._standing)} ms, of which the last "
            f"{milliseconds(stood)} ms under {self._voltage:g} V or more ({motion.applied:.3g} V at the end), "
            f"although the motor turns within {1000 * self._patience:.2g} ms; check its cable, and whether "
            "something suddenly blocked the shaft",
        )
