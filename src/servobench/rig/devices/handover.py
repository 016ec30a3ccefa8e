"""The hand-over of a twin, its guard and the guard's monitors to a block of ticks in one compiled call, and back.

Each of them writes its limits into the numbers `p` and its state into `s`, both laid out below, and reads its state from there
afterwards (`Handing`). The block itself is `servobench.rig.loop.blocks.kernels.run_block`. Counts and flags are numbers, too;
whole ones are exact up to 2^53.
"""

from __future__ import annotations

import math
import sys
from typing import Protocol, runtime_checkable

import numpy as np

from servobench.core.channels import Array

# The numbers p: of the twin, of the guard, of its picture of the motion, and of each monitor.
(
    TICK, DELAY, BLOCKED, LIMIT, DEAD_BAND, COUNTS_PER_REV, HALF_RANGE,
    CURRENT_RANGE, CURRENT_STEP, CURRENT_NOISE, SPEED_STEP, SPEED_NOISE, TORQUE_NOISE,
    TIMEOUT, LARGEST, SLEW, EXACT,
    HALF_COUNTER, ANGLE, SMOOTHING, FEEDBACK,
    MOST_CURRENT, MOST_SPEED, MOST_TRAVEL, STEPS, FASTEST_STEP,
    STALL_VOLTAGE, STALL_SPEED, STALL_WARNING, STALL_DURATION,
    PATIENCE, SUSPECT_VOLTAGE, AT_SPEED, RESISTANCE,
    POLARITY, FINEST, SUSPECT_SHARE,
    NUMBERS,
) = range(38)  # fmt: skip

# The state s, in the same order; the points of the polarity monitor come last, four numbers each.
(
    INDEX, CURRENT, SPEED, THETA, PLANT_TIME, VOLTAGE, FIRST_COMING, COMING, DRAWS,
    FED_AT, WRITES, CLIPPED, SATURATED, COMMANDED,
    COUNTS, TIME, DT, STEP, POSITION, SMOOTH_SPEED, FASTEST, APPLIED, SEEN_CURRENT, SEEN_SPEED,
    STALLED, LONGEST_STALL, STALL_WARNINGS,
    ANCHOR, BEFORE, SMOOTH_DROP, AT_REST, DROVE, STANDING, PUSHED, DIRECTION,
    GRID_TIME, FROM_REST, LAST_STEP, IMPULSE, SINCE, POINTS,
    FIRST_POINT,
) = range(42)  # fmt: skip
POINT, MOST_POINTS = 4, 61
NEVER = sys.maxsize

_NEVER = (
    LARGEST,
    MOST_CURRENT,
    MOST_SPEED,
    MOST_TRAVEL,
    STALL_VOLTAGE,
    STALL_DURATION,
    SUSPECT_VOLTAGE,
    SLEW,
)


class Handover:
    """The input and output of a block: the numbers `p` (NUMBERS,) and the state `s`.

    A limit that nobody writes is never reached.
    Of the twin besides: its solver's `coefficients`, the voltages that are `coming` (N, 2), each with the time [s] from which it
    acts, and what is `random` in it, with the `factors` (N, 3, 3) of a random torque in a tick and in its `parts` (N,), where
    there is one.
    """

    def __init__(self) -> None:
        self.p: Array = np.zeros(NUMBERS)
        self.s: Array = np.zeros(FIRST_POINT + POINT * MOST_POINTS)
        self.p[list(_NEVER)] = math.inf
        self.p[RESISTANCE] = math.nan
        self.coefficients: Array = np.empty(0)
        self.coming: Array = np.empty((0, 2))
        self.random: np.random.Generator | None = None
        self.parts: Array = np.empty(0)
        self.factors: Array = np.empty((0, 3, 3))
        self.until = NEVER
        """The number of the first tick that a fault has to see."""


@runtime_checkable
class Handing(Protocol):
    """A part that can take part in a block of ticks."""

    def hand_over(self, to: Handover) -> None:
        """Write limits and state."""
        ...

    def take_back(self, block: Handover) -> None:
        """Read the state after the last tick of the block."""
        ...


def handover_part(device: object) -> Handing | None:
    """Return what hands a device's numbers over, its `in_blocks`; None where it has to go tick by tick.

    A device around a device that hands everything on which it hasn't itself is none: its reads and writes may be others.
    """
    part = device.in_blocks if hasattr(type(device), "in_blocks") else None  # type: ignore[attr-defined]
    return part if isinstance(part, Handing) else None
