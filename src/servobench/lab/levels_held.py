"""What a recording says of each level of a staircase in its second half: the mean current and the mean speed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from servobench.errors import MissingInformation

if TYPE_CHECKING:
    from servobench.recording.recording import Recording

_LEAST = 2  # samples of a half level


@dataclass(frozen=True, kw_only=True)
class Level:
    """A voltage [V], and the mean current [A] and speed [rad/s] over the second half of the time that it was held."""

    voltage: float
    current: float
    speed: float


def at_levels(recording: Recording, dwell: float) -> tuple[Level, ...]:
    """Return what happened in the second half of each level, each held for `dwell` [s] from the first sample on.

    Raises `MissingInformation` for a recording without a current.
    """
    from servobench.measurement.measure import measure

    data = measure(recording)
    if data.current is None:
        raise MissingInformation(recording.name, ["a channel with the armature's current"])
    t = data.t_output - data.t_output[0]
    found = []
    for number in range(round((t[-1] + data.sample_time) / dwell)):
        # A sample on the edge is latched before the next voltage acts, so it belongs to this level.
        late = (t > (number + 0.5) * dwell) & (t <= (number + 1) * dwell + 1e-6 * data.sample_time)
        if np.count_nonzero(late) < _LEAST:
            continue
        y, when = data.y[late], t[late]
        held = int(np.searchsorted(data.t_input, data.t_output[late][0], side="left")) - 1
        found.append(
            Level(
                voltage=float(data.u[held]),
                current=float(np.nanmean(data.current[late])),
                speed=float((y[-1] - y[0]) / (when[-1] - when[0])),
            )
        )
    return tuple(found)
