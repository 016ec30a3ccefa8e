"""Fewer points for the same picture: a figure needs no more points than it has columns of pixels."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array


def decimate(t: Array, y: Array, columns: int) -> tuple[Array, Array]:
    """Return the points of a line (N,) that a picture of so many columns can show; at most four for each column.

    The line goes through y at times t [s]. The first, the last, the lowest and the highest point of each column are kept, so
    that no spike is lost and the line that is drawn covers the same pixels (Jugel et al. 2014, "M4"). Times increase.
    """
    if len(t) <= 4 * columns:
        return t, y
    edges = np.searchsorted(t, np.linspace(t[0], t[-1], columns + 1)[1:-1])
    starts = np.unique(np.concatenate([[0], edges]))
    starts = starts[starts < len(t)]
    positions: set[int] = set()
    for start, end in zip(starts, [*starts[1:], len(t)], strict=True):
        part = y[start:end]
        positions.update((start, start + part.argmin(), start + part.argmax(), end - 1))
    index = np.array(sorted(positions))
    return t[index], y[index]


def hold_line(t: Array, u: Array, before: float, end: float) -> tuple[Array, Array]:
    """Return the corners of the line that an input draws which holds u (N,) from t (N,) on, until the time `end` [s].

    Before the first time it was `before`; a change there is drawn as an edge.
    """
    if not len(t):
        return np.array([0.0, end]), np.array([before, before])
    changes = np.flatnonzero(np.diff(u, prepend=before))
    levels = np.concatenate([[before], u[changes]])
    start = min(t[0], end)
    times = np.concatenate([[start], np.repeat(t[changes], 2), [max(end, t[-1])]])
    return times, np.repeat(levels, 2)
