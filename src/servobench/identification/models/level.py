"""The levels of the input at which a motor moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.models.base import Structure
from servobench.identification.models.motion import smooth_speed
from servobench.recordings.measurement.dataset import Dataset, keep_with_data

_MOVING = 0.05  # of the largest speed: below it the shaft may as well stand
_FEW = 10  # samples that move, too few to tell the levels
_BRIEF = 4  # samples of a run-down
_SHORT = 20  # of these parts of a record is the longest span over which motion has to be seen
_ONE = 0.03  # of the largest input: levels that lie nearer than that are one level
_FEW_LEVELS = 3  # as many as there are parameters for them
ALIKE = 0.1
"""Of the largest input: levels, or magnitudes to and fro, that differ by less say next to nothing of friction."""
HARDLY_CONDUCTS = 1 / 16
"""Of the largest input: a pulse so narrow that a driver conducts next to never, and may let go of the motor."""
_NOISY = 0.1  # of the largest input: measured values that lie no further apart may be one level with noise
_SPANS = 50  # parts of a record, whose means have next to no noise


def single_level(records: Sequence[Dataset]) -> float | None:
    """Return the one level of the input that moved the motor, in its unit; None where there were several, or none.

    Coasting under no input counts as a second level: it is friction alone that brakes there.
    """
    return _level_of_one(records[0]) if len(records) == 1 else _level_of(records)


def has_one_level_each(records: Sequence[Dataset]) -> bool:
    """Return whether there are several records, each under one level of the input."""
    return len(records) > 1 and all(single_level([record]) is not None for record in records)


@dataclass(frozen=True, kw_only=True)
class OneLevel:
    """The only level of the input, which shows the speed alone of gain and Coulomb voltage."""

    level: float
    """In the input's unit."""
    gain: int
    """The index of the gain among the parameters."""
    friction: int
    """That of the Coulomb voltage."""

    def speed(self, theta: Array) -> float:
        """Return K (u - u_c) for parameters theta (P,), in the unit of the output's speed."""
        return float(theta[self.gain] * (self.level - theta[self.friction]))


def one_level(structure: Structure, records: Sequence[Dataset]) -> OneLevel | None:
    """Return the only level of the input, where there is one and the structure has a gain and a Coulomb voltage.

    Friction brakes whichever way the shaft turns, so that its level has no sign; the constant of a motor that turns one way has.
    """
    names = [parameter.name for parameter in structure.parameters]
    level = single_level(records) if {"gain", "coulomb_voltage"} <= set(names) else None
    if level is None:
        return None
    driven = abs(level) if structure.friction else level
    return OneLevel(level=driven, gain=names.index("gain"), friction=names.index("coulomb_voltage"))


def few_levels(records: Sequence[Dataset]) -> Array | None:
    """Return the two or three levels (L,) that drove a motor to and fro, in the input's unit; None where there were others.

    Under so few a friction, an offset and a gain that differs by direction look like one another; under one magnitude both ways
    only the shape of the reversals tells them apart, and that is another case.
    """
    levels = _to_and_fro(records)
    return levels if levels is not None and not _are_alike(levels) else None


def has_one_magnitude(records: Sequence[Dataset]) -> bool:
    """Return whether one level drove a motor to and fro: its reversals alone tell friction from a smaller gain."""
    levels = _to_and_fro(records)
    return levels is not None and _are_alike(levels)


def _are_alike(levels: Array) -> bool:
    return bool(np.ptp(np.abs(levels)) <= ALIKE * np.abs(levels).max())


def _to_and_fro(records: Sequence[Dataset]) -> Array | None:
    """The two or three levels (L,) that drove a motor both ways; None where there were others."""
    u = np.concatenate([record.u for record in records])
    least = _ONE * float(np.abs(u).max(initial=0.0))
    values = np.unique(u[np.abs(u) > least])
    if not values.min(initial=0.0) < 0.0 < values.max(initial=0.0):
        return None
    groups = np.split(values, np.flatnonzero(np.diff(values) > least) + 1)
    if len(groups) > _FEW_LEVELS or any(np.ptp(group) > least for group in groups):
        return None  # more levels, or none at all
    return np.array([group.mean() for group in groups])


@keep_with_data
def _level_of_one(record: Dataset) -> float | None:
    return _level_of((record,))


def _level_of(records: Sequence[Dataset]) -> float | None:
    every = np.concatenate([np.append(record.u, record.input_before) for record in records])
    largest = float(np.abs(every).max(initial=0.0))
    if largest == 0:
        return None
    # Either says that there was one: a short motion has few samples that noise can't explain, a noisy rest many that move.
    for clear in (False, True):
        levels = np.concatenate([_while_moving(record, clear) for record in records])
        if len(levels) < _FEW:
            continue
        low, high = _but_for_a_few(levels)
        if high - low <= _ONE * largest or (high - low <= _NOISY * largest and _is_noisy(levels, largest)):
            return 0.5 * (low + high)
    return None


def _but_for_a_few(levels: Array) -> tuple[float, float]:
    """The lowest and the highest of the levels (N,) but for a percent, or for samples too few to show how a motor brakes."""
    few = max(len(levels) // 100, min(_BRIEF, len(levels) // 7))
    ascending = np.sort(levels)
    return float(ascending[few]), float(ascending[-1 - few])


def _is_noisy(levels: Array, largest: float) -> bool:
    """Whether an input's deviations from one level average out over a fiftieth of its samples, as noise does."""
    span = max(len(levels) // _SPANS, 1)
    means = levels[: len(levels) // span * span].reshape(-1, span).mean(axis=1)
    return bool(np.ptp(means) <= 0.5 * _ONE * largest)


def _while_moving(record: Dataset, clear: bool) -> Array:
    """The input at those samples of the output at which the shaft moves and the input stays; `clear`: by more than noise does."""
    speed = np.abs(smooth_speed(record))
    least = _MOVING * float(speed.max(initial=0.0))
    moves = speed > least
    if clear:
        moves &= _beyond_noise(record, least)
    u = record.input_at_output
    # A log whose rows have the input of the sample before, or the one after, shows a motion under two levels where one acted.
    lasts = np.abs(np.diff(u, append=u[-1])) <= _NOISY * float(np.abs(u).max(initial=0.0))
    return np.asarray(u[moves & lasts], dtype=np.float64)


def _beyond_noise(record: Dataset, speed: float) -> NDArray[np.bool_]:
    """Whether at each sample (M,) the shaft has come further until then than noise alone takes a reading of one that stands.

    Back over as many samples as that noise is a small `speed` for; a span around each sample would call the last ones before
    a step motion.
    """
    count = len(record.y)
    step = (record.t_output[-1] - record.t_output[0]) / max(count - 1, 1)
    noise, longest = record.noise, max(count // _SHORT, 1)
    if record.kind == "position":
        way = np.cumsum(np.diff(record.y, prepend=record.y[0]))
        wanted = noise / (speed * step) if speed > 0 else 1.0
    else:
        way = np.cumsum(record.y)
        wanted = (0.5 * noise / speed) ** 2 if speed > 0 else 1.0
    span = int(np.clip(np.ceil(wanted), 1, longest))
    start = np.maximum(np.arange(count) - span, 0)
    moved = np.abs(way - way[start])
    least = noise if record.kind == "position" else 0.5 * noise * np.sqrt(span)
    return np.asarray(moved > least, dtype=np.bool_)
