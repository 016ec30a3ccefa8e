"""A shaft that is said to be at rest when the record begins, and turns already."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_FIRST = 5  # steps from sample to sample, the largest of which is what the motor gains in one
_AHEAD = 2.0  # of these steps: from rest a shaft can't be as fast in the first sample


def _about(records: Sequence[Dataset]) -> list[Finding]:
    return [_finding(record) for record in records if isnt_at_rest(record)]


def isnt_at_rest(data: Dataset) -> bool:
    """Return whether a speed that is said to start at rest is higher at once than a motor gets to in two samples."""
    if not data.starts_at_rest or data.kind != "speed" or len(data.y) <= _FIRST:
        return False
    gained = float(np.abs(np.diff(data.y[: _FIRST + 1])).max())
    return bool(abs(data.y[0]) > max(_AHEAD * gained, data.noise))


def _finding(data: Dataset) -> Finding:
    speed = with_unit(float(data.y[0]), data.output_unit, 3)
    sentence = (
        f"{data.name}: `starts_at_rest=True` says that the record starts at rest, but its first speed is {speed}: the shaft "
        "turned before. Leave that out, or give the rows from before the start as well."
    )
    return warning("not-at-rest", sentence, parameters=("delay", "time_constant"))


DOUBTS.member("rest_claimed")(Doubt(codes=("not-at-rest",), about_data=_about))
