"""The evidence in the first motion of a record: the longest possible delay, and that the shaft rests until then."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.measurement.dataset import Dataset, keep_with_data

_FEW = 3  # samples that show a rest
_CLEAR = 3.0  # times the noise: a top speed that stands out
_CHANGE = 0.1  # of the input's range
_FAR = 10.0  # times as far as the shaft may have gone unseen: that it has at its top speed, where it is taken to rest


def latest_delay(data: Sequence[Dataset]) -> float:
    """Return the longest delay [s] that the first motion of all records allows; infinite where no record begins before it.

    It is what there is beyond the delay that the device says of itself.
    """
    motions = [(record, record.first_motion) for record in data]
    bounds = [
        each.effect - each.cause + _margin(record) - record.delay
        for record, each in motions
        if each is not None
    ]
    return min(bounds, default=np.inf)


def changes_of_input(data: Sequence[Dataset]) -> int:
    """Return how often the input changes in all records, by a tenth of its range at least.

    The first motion of a record is the answer to one of these changes. The last digit of a measured voltage is none.
    """
    return sum(_clear_changes(record.u) for record in data)


def _clear_changes(u: Array) -> int:
    """The number of samples of an input (N,) that differ clearly from the last one that did."""
    least, held, count = _CHANGE * float(np.ptp(u)), float(u[0]), 0
    for value in u[np.flatnonzero(np.diff(u)) + 1].tolist():
        if abs(value - held) > least:
            held, count = value, count + 1
    return count


@keep_with_data
def rests_at_first(data: Dataset) -> bool:
    """Return whether the shaft rests when a record begins, while its input does more than one thing.

    With one level from the first sample on, a shaft that starts also rests for a few samples: see `stands_at_first`.
    """
    stood = _standstill_time(data)
    changes = data.t_input[1:][data.u[1:] != data.u[0]]
    return stands_at_first(data) and len(changes) > 0 and bool(changes[0] <= data.t_output[0] + stood)


@keep_with_data
def stands_at_first(data: Dataset) -> bool:
    """Return whether the output stands when a record begins, beside noise and counts.

    A position does so for so long that the top speed would have led far away; a speed is none.
    """
    noise = data.noise
    if not noise > 0:
        return False
    if data.kind == "speed":
        # No noise is 0 to the last digit; in a short record a start is taken for noise.
        exactly = not data.y[:_FEW].any()
        return exactly or bool(np.abs(data.y[:_FEW]).max() <= noise and _top_speed(data) > _CLEAR * noise)
    return _top_speed(data) * _standstill_time(data) > _FAR * noise


def _standstill_time(data: Dataset) -> float:
    """The time [s] for which the output keeps its first value; 0 if it never leaves it."""
    away = np.flatnonzero(np.abs(data.y - np.median(data.y[:_FEW])) > data.noise)
    return float(data.t_output[away[0]] - data.t_output[0]) if len(away) else 0.0


def _margin(record: Dataset) -> float:
    """A sample time, of the one of input and output that is sampled more rarely."""
    steps = [step for step in (record.sample_time, record.input_step) if np.isfinite(step)]
    return max(steps)


def _top_speed(data: Dataset) -> float:
    from servobench.identification.models.motion import smooth_speed

    return float(np.percentile(np.abs(smooth_speed(data)), 95))
