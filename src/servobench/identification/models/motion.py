"""The motion in a record, without any model: a rough speed, its direction, and whether there is any."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.recordings.measurement.dataset import Dataset, keep_with_data

_RARE = 1.5  # times what two readings of a shaft at rest may differ by: the most of a thousand of them do by more than that once


_ONE = 0.9  # of an input's power in one line of its spectrum: a sine
_GRADUAL = 0.05  # of all of a ramp, from sample to sample
_ONE_WAY = 0.9  # of the input's changes
_STILL = 1e-3  # of the largest speed: slower than that a motor stands
_PERIODS = 3  # of a sine in a record: fewer are a step or a ramp
_BACK = 0.1  # of the way: a position that comes back as far turned round
_DIP = 0.05  # of the way: what a sensor dips when a driver's current rushes in, under an input that asks for one direction only
_UNSTEADY = 0.3  # of the speed: what it may vary by
_FEWEST = 10  # samples that show whether it does


@keep_with_data
def directions(data: Dataset) -> Array:
    """Return the direction of motion at each output sample, -1, 0 or 1, from the smoothed speed, shape (M,)."""
    speed = smooth_speed(data)
    scale = float(np.percentile(np.abs(speed), 95))
    return np.where(np.abs(speed) > 0.02 * scale, np.sign(speed), 0.0)


def turns_both_ways(data: Sequence[Dataset]) -> bool:
    """Return whether at least one sample in fifty was taken while the motor turned the other way."""
    senses = np.concatenate([_senses(record) for record in data])
    return bool(min(np.mean(senses > 0), np.mean(senses < 0)) > 0.02)


def turns_between_rows(data: Sequence[Dataset]) -> bool:
    """Return whether a shaft mostly turns by more than half a turn from row to row.

    What repeats with each turn happens between the rows then, and they show another wave, its alias.
    """
    turns = [np.diff(each.y) for each in data if each.kind == "position" and each.position_unit == "rad"]
    return any(map(len, turns)) and float(np.median(np.abs(np.concatenate(turns)))) > np.pi


@keep_with_data
def _senses(data: Dataset) -> Array:
    """The directions (M,); all forward where a position comes back by no more than noise at rest does, or a sensor's dip."""
    senses = directions(data)
    if data.kind == "speed":
        return senses
    forward = 1.0 if data.y[-1] >= data.y[0] else -1.0
    way = forward * data.y
    whole = float(np.ptp(way))
    least = min(_RARE * data.noise, _BACK * whole)
    if data.u.min() * data.u.max() >= 0.0:
        least = max(least, _DIP * whole)
    if float(np.max(np.maximum.accumulate(way) - way)) > least:
        return senses
    return np.where(senses * forward > 0.0, senses, 0.0)


@keep_with_data
def smooth_speed(data: Dataset) -> Array:
    """Return a speed for orientation only, in the unit of the position a second, shape (M,).

    A position is differenced over the shortest span in which a step of the encoder is below a twentieth of the motion.
    """
    if data.kind == "speed":
        return data.y
    after, before = _apart(data)
    return (data.y[after] - data.y[before]) / (data.t_output[after] - data.t_output[before])


def steady_speed(data: Dataset) -> float | None:
    """Return the speed at which a motor turns throughout a record, in the unit of the position a second.

    None where the input changes, or the speed varies by 30 % of it or more.
    """
    speed = smooth_speed(data)
    middle = float(np.median(speed))
    if len(speed) < _FEWEST or not (data.u == data.input_before).all():
        return None
    return middle if np.ptp(speed) < _UNSTEADY * abs(middle) else None


def stands(data: Dataset) -> NDArray[np.bool_]:
    """Return which samples (M,) were taken while the motor stood still."""
    speed = np.abs(smooth_speed(data))
    return np.asarray(speed <= _STILL * speed.max())


def smoothing_span(data: Dataset) -> int:
    """Return how many samples apart the two values are from which a smoothed speed is taken; 1 for a measured speed."""
    return 1 if data.kind == "speed" else 2 * _span(data)


def _apart(data: Dataset) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The samples (M,) after and before each one between which its smoothed speed is taken."""
    span, last = _span(data), len(data.y) - 1
    index = np.arange(last + 1)
    return np.minimum(index + span, last), np.maximum(index - span, 0)


def _span(data: Dataset) -> int:
    """The samples to either side over which a position is differenced."""
    y = data.y
    span = 1
    limit = max(1, len(y) // 20)
    quantum = data.quantum or 0.0
    while span < limit:
        moved = np.abs(y[span:] - y[:-span])
        enough = np.count_nonzero(moved > 20 * quantum) > 0.1 * len(moved)
        if enough and np.count_nonzero(moved) > 0.5 * len(moved):
            break
        span = min(2 * span, limit)
    return span


def check_moves(data: Dataset, parameters: int) -> None:
    """Raise `NotIdentifiable` where a record has too few samples for so many parameters, or its output never moves."""
    needed = 2 * parameters + 4
    if len(data.y) < needed:
        raise NotIdentifiable(
            f"{data.name}: {len(data.y)} samples of the output; at least {needed} are needed: record for longer"
        )
    if np.ptp(data.y) == 0:
        why = (
            "friction holds the shaft, it was blocked, the encoder isn't connected, or it's the wrong column"
            if data.u.any()
            else "nothing drives the motor, as the input is zero"
        )
        raise NotIdentifiable(
            f"{data.name}: the output stays at {data.y[0]:g} {data.output_unit} throughout: {why}; leave this record out, or "
            "record the motor while it turns"
        )


def is_one_sine(u: Array) -> bool:
    """Return whether nearly all of an input u (N,) on an even grid is one sine: that tells two numbers, and no order."""
    power = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(len(u)))) ** 2
    at = int(np.argmax(power))
    return bool(at >= _PERIODS and power[at - 2 : at + 3].sum() > _ONE * power.sum())


def is_ramp(data: Dataset) -> bool:
    """Return whether the input changes from sample to sample by little at the most, and goes one way."""
    changes = np.diff(data.u)
    size, way = float(np.abs(changes).max(initial=0.0)), abs(float(data.u[-1] - data.u[0]))
    return 0.0 < size <= _GRADUAL * way and way >= _ONE_WAY * float(np.abs(changes).sum())
