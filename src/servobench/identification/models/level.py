"""The levels of the input at which a motor moved."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.identification.models.motion import smooth_speed
from servobench.recordings.measurement.dataset import Dataset, keep_with_data

_MOVING = 0.05  # of the largest speed: below it the shaft may as well stand
_ONE = 0.03  # of the largest input: levels that lie nearer than that are one level


def single_level(records: Sequence[Dataset]) -> float | None:
    """Return the one level of the input that moved the motor, in its unit; None where there were several, or none.

    Coasting under no input counts as a second level: it is friction alone that brakes there.
    """
    levels = np.concatenate([_while_moving(record) for record in records])
    every = np.concatenate([np.append(record.u, record.input_before) for record in records])
    largest = float(np.abs(every).max(initial=0.0))
    if len(levels) < 10 or largest == 0:
        return None
    low, high = (float(level) for level in np.percentile(levels, (1, 99)))
    return 0.5 * (low + high) if high - low <= _ONE * largest else None


@keep_with_data
def _while_moving(record: Dataset) -> Array:
    """The input at those samples of the output at which the shaft moves."""
    speed = np.abs(smooth_speed(record))
    return np.asarray(
        record.input_at_output[speed > _MOVING * float(speed.max(initial=0.0))], dtype=np.float64
    )
