"""Signals one after the other."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from servobench.core.channels import Array
from servobench.core.settings import PositiveTime, Settings, Time
from servobench.systems.signals.base import SIGNALS, AnySignal, at_least_one
from servobench.systems.signals.edges import is_past


class Segment(Settings):
    """A part of a sequence: a signal, and for how long it holds."""

    duration: PositiveTime
    """The duration of the segment [s]."""
    signal: AnySignal
    """The signal; its time counts from the beginning of the segment."""


@SIGNALS.member("sequence")
class Sequence(Settings):
    """Its segments in their order, the first from `start` on; 0 before the first and after the last."""

    segments: Annotated[
        tuple[Segment, ...],
        AfterValidator(at_least_one),
        Field(
            examples=[
                [
                    {"duration": "2.5 s", "signal": {"type": "step"}},
                    {"duration": "1 s", "signal": {"type": "prbs"}},
                ]
            ]
        ),
    ]
    """The segments in their order."""
    start: Time = 0.0
    """Time at which the first segment begins [s]."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        t = np.asarray(t, dtype=float)
        values = np.zeros(t.shape)
        begin = self.start
        for segment in self.segments:
            end = begin + segment.duration
            during = is_past(t, begin) & ~is_past(t, end)
            # A time that counts as on the edge is on it for the segment's signal too.
            values[during] = segment.signal(np.maximum(t[during] - begin, 0.0))
            begin = end
        return values

    @property
    def period(self) -> None:
        """There is none: it ends."""
        return None

    @property
    def shortest_change(self) -> float:
        """The shortest duration of a segment, or change within one [s]."""
        within = (segment.signal.shortest_change for segment in self.segments)
        return min(*(segment.duration for segment in self.segments), *filter(None, within))
