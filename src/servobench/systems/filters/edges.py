"""The tachometer that measures times: the speed from the time between an encoder's counts."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.numbers import check_positive


def edge_speed(
    t: Array, position: Array, at: Array, quantum: float, counts: int = 4, timer: float = 1e-7
) -> Array:
    """Return the speed (M,) at times `at` (M,) [s] from the time that the last `counts` counts took.

    ω = n Δ/(t_j - t_{j-n}), by definition the mean speed over these counts, t_j the time of the last one, to whole ticks of the
    `timer` [s]. `position` (N,) [rad] at times t (N,) [s] is the shaft's true one, which doesn't fall; between them it is
    straight. `quantum` Δ [rad] is the encoder's step. Where the next count is overdue it is no faster than that allows; before
    `counts` counts, zero. At a constant speed only the timer makes noise: a step of it is ω² timer/(n Δ). Four counts are one
    line of the disc, which leaves out that the four are never quite evenly spaced. It lags by half of the time that it goes
    over, n Δ/(2ω), and by half a count more as the last one is past: late where the shaft is slow, and hardly where it is fast.
    Raises `UsageError` where the shaft turns back: a count then doesn't tell which way it was.
    """
    check_positive("the encoder's step", quantum, "rad")
    check_positive("the tick of the timer", timer, "s")
    if counts < 1:
        raise UsageError(f"a tachometer goes over {counts} counts; expected 1 or more")
    if (np.diff(position) < 0).any():
        raise UsageError(
            "the shaft turns back; expected a position that doesn't fall, as in a step from rest"
        )
    first, last = np.floor(position[0] / quantum) + 1, np.floor(position[-1] / quantum)
    edges = quantum * np.arange(first, last + 1)
    rising = np.concatenate([[True], np.diff(position) > 0])
    times = timer * np.floor(np.interp(edges, position[rising], t[rising]) / timer)
    newest = np.searchsorted(times, at, side="right") - 1
    speeds = np.zeros(len(at))
    enough = newest >= counts
    j = newest[enough]
    took = np.maximum(times[j] - times[j - counts], timer)
    overdue = np.maximum(at[enough] - times[j], timer)
    speeds[enough] = np.minimum(counts * quantum / took, quantum / overdue)
    return speeds
