"""A speed for plots: differences of a position over intervals long enough to be readable."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.measurement.dataset import Dataset

_QUANTA = 50.0  # the encoder's step in the speed shall be this much smaller than the typical speed
_HOLDS = 6.0  # and the window this much longer than a value of the position stands still
_LONGEST = 20  # but no longer than this part of the record


def eye_window(data: Dataset) -> int:
    """Return over how many samples a position is to be differenced, so that a speed can be seen. Even, at least 2.

    As many as the shaft takes, on average, for fifty quanta, and six times as many as there are between two changes of the
    position in motion (a logger may repeat old values); not more than a twentieth of the record.
    """
    steps = np.abs(np.diff(data.y))
    travelled, changes = float(steps.sum()), np.flatnonzero(steps)
    if len(changes) < 2:
        return 2
    quanta = _QUANTA * (data.quantum or 0.0) * len(steps) / travelled
    holds = _HOLDS * float(np.median(np.diff(changes)))
    most = max(2, len(steps) // _LONGEST)
    return 2 * int(np.ceil(min(max(quanta, holds), most) / 2))


def eye_speed(t: Array, position: Array, window: int) -> tuple[Array, Array]:
    """Return the times (K,) and central differences over `window` samples (K,) of a position (N,) at times t (N,) [s].

    No lag; edges are rounded off by half a window. The same differences of a measured and a simulated position can be held
    against each other. Empty for a record that is no longer than the window.
    """
    if len(t) <= window:
        return t[:0], position[:0]
    half = window // 2
    return t[half : len(t) - window + half], (position[window:] - position[:-window]) / (
        t[window:] - t[:-window]
    )
