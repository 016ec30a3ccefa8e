"""A shaft that runs away from the voltage: the encoder counts backwards, or the motor's leads are swapped."""

from __future__ import annotations

from itertools import pairwise
from typing import ClassVar, NamedTuple, Self

import numpy as np

from servobench.core.finding import Finding
from servobench.rig.devices import handover as at
from servobench.rig.devices.guard.base import MONITORS, Alarm, Motion, Rig
from servobench.rig.devices.handover import Handover

MOST_POINTS = 60  # that are kept; 0.3 s at the finest, and of a longer motion every other one
GRID = 0.005  # s between the points that are kept of it, or a sample time where that is longer
FEWEST_POINTS = 16  # of a motion; a delay of three samples moves a shaft against the voltage for three
FEWEST_COUNTS = 16
LONGEST_DELAY = 3  # points by which the voltage may act late
CLOSE = 0.03  # of the motion's own root mean square, left over by the flipped motor
ROUNDING = 0.45  # counts; the anchor's rounding and each point's make 0.41 together
SHARE = 0.5  # of the largest voltage; a motor that needs more to hold its load can hardly move it


class Point(NamedTuple):
    """The motion at one `time` [s]: its `impulse` ∫u dt so far [V·s], the mean `voltage` [V] since the point before, `position`.

    The position is in counts.
    """

    time: float
    impulse: float
    voltage: float
    position: int


@MONITORS.member("polarity")
class PolarityMonitor:
    """A fault where, under feedback, the shaft moves as a motor does whose encoder counts the other way.

    From rest a motor follows dω/dt = (K (u - u₀) - ω)/τ, with u₀ the voltage that held it at rest against friction and load.
    Integrated twice, its angle is y = α X - β Y, where X is the double integral of u - u₀, Y the integral of y, and α = K/τ and
    β = 1/τ are positive, whatever the motor. A shaft that brakes, coasts, is blocked or is reversed slows down where it moves
    against the voltage, so that no such α and β describe its motion with the sign turned round. They do where the encoder is
    flipped, to its rounding. A hand or a weight moves the shaft first, and the controller's voltage follows: that doesn't
    fit, either, but by chance. So the voltage has to be at least half of the largest one, the motion to have gone on against it
    from rest for 16 points, 5 ms (or a sample time) apart, and for 16 counts, and 3 % of it may be left over.

    Without feedback nothing runs away, and the sign may be what somebody wants to find out: there it isn't watched.
    """

    heading: ClassVar[str] = "Sign of the encoder"
    codes: ClassVar[tuple[str, ...]] = ("encoder-flipped",)

    def __init__(self, sample_time: float, largest: float) -> None:
        self._finest = max(GRID, sample_time) * (1 - 1e-6)
        self._suspect = SHARE * largest
        self._points: list[Point] = []
        self._grid = self._finest
        self._from_rest, self._step = True, 0
        self._impulse, self._since = 0.0, 0.0

    @classmethod
    def of(cls, rig: Rig) -> Self | None:
        """Return a monitor where what is put out is a voltage."""
        channel = rig.info.with_limit(rig.limits.voltage).channel("voltage")
        largest = (
            rig.limits.voltage if channel is None else min(abs(channel.minimum or 0), channel.maximum or 0)
        )
        return cls(rig.sample_time, largest or rig.limits.voltage) if rig.in_volts else None

    @property
    def limit(self) -> str:
        """The reason for ending the run."""
        return "under feedback, a shaft that accelerates against the voltage, as with a reversed encoder"

    def check(self, motion: Motion) -> Alarm | None:
        """Return an alarm where the motion of the last 0.3 s is that of a flipped motor."""
        if not motion.feedback:
            self._points.clear()
            return None
        points = self._points
        self._impulse += motion.applied * motion.dt
        self._since += motion.dt
        if points and self._since < self._grid:
            return None
        mean = (self._impulse - points[-1].impulse) / self._since if points else 0.0
        self._since = 0.0
        self._take(Point(motion.time, self._impulse, mean, motion.position))
        if len(points) <= FEWEST_POINTS or -self._suspect < mean < self._suspect:
            return None
        return self._alarm(mean) if self._runs_away(1 if mean > 0 else -1) else None

    def hand_over(self, to: Handover) -> None:
        """Write the limits and the state."""
        to.p[at.POLARITY], to.p[at.FINEST], to.p[at.SUSPECT_SHARE] = 1.0, self._finest, self._suspect
        to.s[at.GRID_TIME : at.FIRST_POINT] = (
            self._grid,
            self._from_rest,
            self._step,
            self._impulse,
            self._since,
            len(self._points),
        )
        to.s[at.FIRST_POINT : at.FIRST_POINT + at.POINT * len(self._points)] = np.ravel(self._points)

    def take_back(self, block: Handover) -> None:
        """Read the state."""
        self._grid, from_rest, step, self._impulse, self._since, count = block.s[
            at.GRID_TIME : at.FIRST_POINT
        ].tolist()
        self._from_rest, self._step = bool(from_rest), int(step)
        rows = block.s[at.FIRST_POINT : at.FIRST_POINT + at.POINT * int(count)].reshape(-1, at.POINT)
        self._points = [
            Point(time, impulse, mean, int(counts)) for time, impulse, mean, counts in rows.tolist()
        ]

    def findings(self) -> tuple[Finding, ...]:
        """Return nothing: what there is to say is the fault."""
        return ()

    def _take(self, point: Point) -> None:
        """Take a point; those before the last time at rest are let go, and of a long motion every other one."""
        points = self._points
        if points:
            sign, step = (1 if point.voltage > 0 else -1), point.position - points[-1].position
            if point.voltage * points[-1].voltage <= 0 or sign * step > 0:
                # The voltage changed its direction, or the shaft goes with it: what was before says nothing of the sign.
                # A shaft that was turning already when the voltage turned against it isn't at rest, and is left to come to it.
                self._from_rest = sign * self._step >= -1 or sign * step > 0
                del points[:-1]
                self._grid = self._finest
            elif point.position == points[0].position and len(points) >= FEWEST_POINTS:
                del points[0]  # still at rest
                self._from_rest = True
            elif len(points) >= MOST_POINTS:
                del points[1::2]
                self._grid *= 2
            self._step = step
        points.append(point)

    def _runs_away(self, sign: int) -> bool:
        """Whether the motion until now, under a voltage of that sign, is that of a flipped motor."""
        points = self._points
        if not self._from_rest or sign * (points[0].position - points[-1].position) < FEWEST_COUNTS:
            return False
        last = max(k for k, point in enumerate(points) if point.position == points[0].position)
        return any(
            len(points) - begin > FEWEST_POINTS and _is_flipped(points[begin:], sign) for begin in {0, last}
        )

    def _alarm(self, voltage: float) -> Alarm:
        return Alarm(
            "encoder-flipped",
            f"the shaft accelerates against the voltage ({voltage:.3g} V), as it does if the encoder counts "
            "backwards: swap its channels A and B, the motor's leads, or the sign in the device's settings. If a "
            "weight or a hand drove it, use larger gains",
        )


def _is_flipped(points: list[Point], sign: int) -> bool:
    """Whether y = α X - β Y holds for the motion against the voltage from the first of the points on, at any of the delays."""
    start = points[0]
    moved, pushed, area = [], [], []
    x = y = before = 0.0
    went = 0.0
    for one, two in pairwise(points):
        dt = two.time - one.time
        impulse = sign * (two.impulse - start.impulse - start.voltage * (two.time - start.time))
        along = float(sign * (start.position - two.position))
        x += 0.5 * (before + impulse) * dt
        y += 0.5 * (went + along) * dt
        before, went = impulse, along
        moved.append(along)
        pushed.append(x)
        area.append(y)
    return any(
        _fits(moved, [0.0] * late + pushed[: len(pushed) - late], area) for late in range(LONGEST_DELAY + 1)
    )


def _fits(y: list[float], x: list[float], area: list[float]) -> bool:
    """Whether least squares of y on X and -Y, both without a negative factor, leave little over."""
    yy = sum(a * a for a in y)
    xx = sum(a * a for a in x)
    aa = sum(a * a for a in area)
    xy = sum(a * b for a, b in zip(x, y, strict=True))
    ay = sum(a * b for a, b in zip(area, y, strict=True))
    xa = sum(a * b for a, b in zip(x, area, strict=True))
    if xx <= 0.0 or xy <= 0.0:
        return False
    determinant = xx * aa - xa * xa
    alpha, beta = xy / xx, 0.0
    if determinant > 1e-9 * xx * aa:
        free = (xa * xy - xx * ay) / determinant
        if free > 0.0:
            beta, alpha = free, (aa * xy - xa * ay) / determinant
    if alpha <= 0.0:
        return False
    left = yy - alpha * xy + beta * ay
    allowed = CLOSE * CLOSE * yy + ROUNDING * ROUNDING * len(y)
    return left <= allowed
