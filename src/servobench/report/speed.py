"""A speed for the eye: what a position looks like when it's differenced over a time that a person can read."""

from __future__ import annotations

import numpy as np

from servobench.channels import Array
from servobench.measurement.dataset import Dataset

_STEPS = 50.0  # the encoder's step in the speed shall be this much smaller than the typical speed
_LONGEST = 20  # and the window no longer than this part of the record


def eye_window(data: Dataset) -> int:
    """Return over how many samples a position is to be differenced, so that its quantum doesn't hide the speed.

    Even, at least 2: as many as the shaft takes, on average, for fifty quanta, and not more than a twentieth of the record.
    """
    travelled = float(np.sum(np.abs(np.diff(data.y))))
    quantum = data.quantum or 0.0
    intervals = len(data.y) - 1
    wanted = _STEPS * quantum * intervals / travelled if travelled > 0 else 0.0
    most = max(2, intervals // _LONGEST)
    return 2 * int(np.ceil(min(max(wanted, 2.0), most) / 2))


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
