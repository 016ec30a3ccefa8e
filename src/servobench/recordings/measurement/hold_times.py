"""When each voltage of a run began to hold, if the device reports with each sample since when its present voltage has held.

The device doesn't say which voltage that is. Voltage j is handed over at H_j in the device's count, and takes at least the
shortest way c from there: what has held since a is the last change of the voltage with H_j + c <= a.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array

_APART = 1e-9  # s; between voltages that replaced each other at once
_WHOLE = 2e-6  # s; a board counts whole microseconds: of the time of a sample, and of that of a voltage


def hold_times(u: Array, handed: Array, held_since: Array, t: Array) -> Array | None:
    """Return the times (N,) [s] from which the voltages u (N,) [V] of a run held, in the device's count.

    Voltage j answers the sample of time t_j of `t` (N,) [s] and was `handed` over (N,) [s]; that is in the device's count, too
    early by the shortest way of a sample. `held_since` (N,) [s] is what each sample says of the voltage before it, NaN where it
    says nothing. A change that another one followed before a sample could tell of it began to hold the usual way after its
    handing over. Where an earlier sample would then have told of it, it came late, and was replaced at once.
    None where fewer than half of the changes are told of: then nothing bears out which they are.
    """
    changes = np.flatnonzero(np.diff(u, prepend=np.nan) != 0.0)
    rows = np.flatnonzero((np.diff(held_since, prepend=np.nan) != 0.0) & (held_since <= t))
    which, rows = _match(handed, held_since, rows, changes)
    if not len(which) or 2 * len(which) < len(changes):
        return None
    stamps = held_since[rows]
    usual = handed + float(np.median(stamps - handed[which]))
    times = _between(usual, which, stamps, t[rows - 1], changes)
    return times if bool(np.all(np.diff(times) > 0.0)) else None


def _match(
    handed: Array, held_since: Array, rows: NDArray[np.int64], changes: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The voltages that `rows` tell of, each once and in order, and the rows that tell of them."""
    stamps = held_since[rows]

    def last(way: float) -> NDArray[np.int64]:
        until = np.minimum(
            np.searchsorted(handed[changes], stamps - way, side="right"), np.searchsorted(changes, rows)
        )
        return np.concatenate([[-1], changes])[until]

    which = last(0.0)
    shortest = float(np.min((stamps - handed[which])[which >= 0], initial=np.inf))
    which = last(max(shortest - _WHOLE, 0.0)) if np.isfinite(shortest) else which
    new = which > np.maximum.accumulate(np.concatenate([[-1], which]))[:-1]
    return which[new], rows[new]


def _between(
    usual: Array, which: NDArray[np.int64], stamps: Array, untold: Array, changes: NDArray[np.int64]
) -> Array:
    """Times (N,) [s]: of the voltages `which` what was `said`, and of those between them the `usual`, where that can be.

    `untold` are the times of the last samples that didn't tell yet of the voltages `which` [s]. Only of `changes` a sample tells.
    """
    j = np.arange(len(usual))
    following = np.searchsorted(which, j)
    ends, edges = np.append(which, len(usual)), np.append(stamps, np.inf)
    latest = edges[following] - (ends[following] - j) * _APART
    begins, sides = np.insert(which, 0, -1), np.insert(stamps, 0, -np.inf)
    before = np.searchsorted(which, j, side="right")
    earliest = sides[before] + (j - begins[before]) * _APART
    came_late = np.isin(j, changes) & (usual <= np.append(untold, -np.inf)[following])
    times = np.maximum(np.where(came_late, latest, np.minimum(usual, latest)), earliest)
    # What came late was there before all that came after it.
    return np.asarray(np.minimum.accumulate((times - j * _APART)[::-1])[::-1] + j * _APART)
