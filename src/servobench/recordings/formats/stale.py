"""Values that are older than their rows: a sensor that is read less often than the log gets a row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array

_SHARE = 0.5  # of the rows: values that change in no more of them are stale
_ALIKE = 0.7  # of the changes by the same step, from which on that step counts as the sensor's own
_ONE_STEP = 3.0  # times the smallest change: a larger one isn't the sensor's own step
_FEWEST = 10  # changes that it takes to tell


@dataclass(frozen=True, kw_only=True)
class Stale:
    """The updates of a channel: it changes in `share` of the rows only, usually every `hold` rows."""

    hold: float
    share: float

    def sentence(self, name: str, t: Array | None) -> str:
        """Return this in words for the channel of that name, whose rows have the times t (N,) [s]."""
        # Of uneven rows the mean step, not the usual one: what is read at an even rate passes the long ones, too.
        age = "" if t is None else f" ({1000 * self.hold * float(np.mean(np.diff(t))):.0f} ms)"
        return (
            f"`{name}` changes in {100 * self.share:.0f} % of the rows only, about every {self.hold:g} rows{age}: in "
            "the others the value is older than its row."
        )


def stale(values: Array) -> Stale | None:
    """Return how values (N,) are refreshed; None where they change in most rows, or there are too few changes to tell.

    None, too, where they mostly change by the same step: that is one count of an encoder, or one level of a converter, and there
    was no more to see. Several of its steps are a position at a constant speed. The first tenth of the changes doesn't count, as
    it belongs to the slow beginning of a motion.
    """
    steps = np.abs(np.diff(values))
    changes = np.flatnonzero(steps > 0)
    smallest = float(steps[changes].min(initial=np.inf))
    changes = changes[len(changes) // 10 :]
    if len(changes) < _FEWEST:
        return None
    share = (len(changes) - 1) / float(changes[-1] - changes[0])
    usual = float(np.median(steps[changes]))
    alike = (
        np.isclose(steps[changes], usual, rtol=0.01, atol=0.0).mean() if usual < _ONE_STEP * smallest else 0.0
    )
    hold = float(np.median(np.diff(changes)))
    # What changes in every row of a motion, and rests in between, is fresh.
    return Stale(hold=hold, share=share) if share <= _SHARE and hold >= 2.0 and alike <= _ALIKE else None


def fresh_rows(values: Array, hold: float) -> NDArray[np.int64]:
    """Return the rows of values (N,) in which they were new, where that happens every `hold` rows or so.

    These are the rows of each change, and in between, while nothing moves, those that come a whole number of holds after a
    change; before the first change, that many before it.
    """
    changes = np.flatnonzero(np.diff(values) != 0) + 1
    every = max(round(hold), 1)
    if not len(changes):
        return np.arange(0, len(values), every)
    before = np.arange(changes[0] - every, -1, -every)[::-1]
    # A refresh may come a little early: a row shortly before a change is still the old value.
    ends = np.append(changes[1:] - every // 2, len(values))
    after = [np.arange(start, max(end, start + 1), every) for start, end in zip(changes, ends, strict=True)]
    return np.concatenate([before, *after])
