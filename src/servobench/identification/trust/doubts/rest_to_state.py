"""A shaft that sets off with the first rows, so that no rest before is to be seen: it may have rested all the same."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_LEAST = 20  # samples under the first input
_RESTING = 0.1  # of the speed that the first input leads to: below that a shaft has just set off
_DRIVEN = 0.02  # of the largest input: below that it is the offset of a measurement


def _rest_to_state(records: Sequence[Dataset]) -> list[Finding]:
    if any(map(_stood_at_first, records)):
        when = "The input is on from the first row, and the rows in which the shaft still stands are left out"
    elif any(map(_sets_off_at_first, records)):
        when = "The input is on from the first row, and the shaft seems to set off there"
    elif any(map(_sets_off_soon, records)):
        when = "The input is on after a few rows, in which the shaft seems to stand"
    else:
        return []
    sentence = (
        f"{when}. If it was at rest before, without an input, say `starts_at_rest=True`: the start then says more of delay and "
        "time constant."
    )
    return [info("rest-to-state", sentence, parameters=("delay", "time_constant"))]


def _stood_at_first(data: Dataset) -> bool:
    """Whether rows were left out in which the shaft stood under an input that never changes: see `without_unknown_input`."""
    return not data.starts_at_rest and not np.ptp(data.u) > 0 and bool(data.t_output[0] > data.t_input[0])


def _sets_off_soon(data: Dataset) -> bool:
    """Whether the input is off for a few rows only, without a motion, and on from there."""
    driven = np.flatnonzero(np.abs(data.u) > _DRIVEN * float(np.abs(data.u).max()))
    if data.starts_at_rest or not len(driven) or not driven[0] > 0:
        return False
    before = data.t_output <= data.t_input[driven[0]]
    if not 0 < before.sum() < _LEAST or len(data.y) < 2 * _LEAST:
        return False
    way = np.abs(np.diff(data.y)) if data.kind == "position" else np.abs(data.y)
    return bool(way[: before.sum()].max() <= _RESTING * float(np.median(way[before.sum() :])))


def _sets_off_at_first(data: Dataset) -> bool:
    """Whether the input is on when the record begins, and the speed is nearly zero then and not soon after."""
    if data.starts_at_rest or data.input_before != data.u[0]:
        return False
    if abs(data.u[0]) <= _DRIVEN * float(np.abs(data.u).max()):
        return False
    speed = _speed_under_the_first_input(data)
    if len(speed) < _LEAST:
        return False
    reached = float(np.median(speed[len(speed) // 2 :]))
    # A position has to move by several of the sensor's steps from row to row, or rest and slow motion look alike.
    coarse = data.kind == "position" and reached * _RESTING < 0.5 * max(data.quantum or 0.0, data.noise)
    return reached > 0 and not coarse and bool(speed[0] <= _RESTING * reached)


def _speed_under_the_first_input(data: Dataset) -> Array:
    """The size of the speed, or of the way from row to row, until the input changes."""
    changes = np.flatnonzero(data.u != data.u[0])
    y = data.y if not len(changes) else data.y[data.t_output < data.t_input[changes[0]]]
    return np.abs(y if data.kind == "speed" else np.diff(y))


DOUBTS.member("rest_to_state")(Doubt(codes=("rest-to-state",), about_data=_rest_to_state))
