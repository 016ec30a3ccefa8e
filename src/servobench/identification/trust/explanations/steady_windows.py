"""Times at which a motor turned evenly: what an input does there no cause may deny.

An equation that fits the fast part of a record better may say of an input that it hardly acts. A motor that goes on at its speed
under it for several time constants says otherwise, also where a controller and its noise never hold the input still.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.explanations.equation import Motion

_LONG = 4.0  # time constants: without its input a motor would be at a fiftieth of its speed
_EVEN = 0.1  # of its mean: by what the speed changes from one half of the time to the other
_FEWEST = 4  # points of the grid in a half


def steady_windows(motions: Sequence[Motion], time_constant: float) -> Array:
    """Return mean speed, smallest and largest input (S, 3) of all windows of 4 time constants [s] with an even speed.

    Inputs and speeds are without their sign; a window in which either changes its sign is none. Windows don't overlap. There are
    none for a time constant that isn't above zero.
    """
    if not 0.0 < time_constant < np.inf:
        return np.zeros((0, 3))
    return np.concatenate([_of(each, time_constant) for each in motions])


def _of(motion: Motion, time_constant: float) -> Array:
    count = max(int(np.ceil(min(_LONG * time_constant / motion.step, len(motion.t)))), 2 * _FEWEST)
    windows = len(motion.t) // count
    speed = np.interp(motion.t, motion.data.t_output, smooth_speed(motion.data))
    u, w = (x[: windows * count].reshape(windows, count) for x in (motion.u, speed))
    halves = np.abs(w[:, : count // 2].mean(axis=1)), np.abs(w[:, count // 2 :].mean(axis=1))
    even = np.abs(halves[1] - halves[0]) <= _EVEN * np.maximum(*halves)
    one_sign = (np.ptp(np.sign(u), axis=1) == 0) & (np.ptp(np.sign(w), axis=1) == 0)
    size = np.abs(u)
    columns = np.abs(w.mean(axis=1)), size.min(axis=1), size.max(axis=1)
    return np.asarray(np.column_stack(columns)[even & one_sign], dtype=np.float64)
