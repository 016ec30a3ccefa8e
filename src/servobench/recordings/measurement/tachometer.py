"""The stage `tachometer`: the mean speed over a fixed time."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from servobench.core.channels import Array
from servobench.core.numbers import check_positive, number_text
from servobench.recordings.measurement.base import STAGES, Kind, speed_of_position
from servobench.recordings.measurement.stage_text import quantity_in
from servobench.recordings.measurement.window import Samples, edge, first_filled, slide


@STAGES.member("tachometer")
@dataclass(frozen=True, kw_only=True)
class Tachometer:
    """The mean speed over the last W seconds (`window`) of a position x, straight between samples.

    By definition y(t) = (x(t) - x(t - W)) / W. A W below the time between samples gives the mean speed since the sample before,
    as there is nothing to see in between. While the record is shorter than W the mean goes over what there is; the first output
    is zero.
    """

    linear: ClassVar[bool] = True
    examples: ClassVar[tuple[str, ...]] = ("tachometer 10 ms", "tachometer 0.0333 s")

    window: float = field(metadata={"unit": "s"})

    def __post_init__(self) -> None:
        check_positive("the window of `tachometer`", self.window, "s")

    @classmethod
    def parse(cls, arguments: tuple[str, ...]) -> Self:
        """Return the stage for a time with its unit."""
        return cls(window=quantity_in("s", "tachometer", arguments, cls.examples))

    @property
    def symbol(self) -> tuple[str, ...]:
        """Numerator and denominator of the transfer function, for a diagram."""
        return f"1 − e^{{−{number_text(self.window)}·s}}", number_text(self.window)

    def yields(self, kind: Kind) -> Kind:
        """A speed, of a position."""
        return speed_of_position("tachometer", kind)

    def first_valid(self, first: int, t: Array) -> int:
        """The first output with a whole window of valid inputs, one sample later than the input at least."""
        return max(first + 1, first_filled(first, t, self.window))

    def start_response(self, t: Array) -> None:
        """There is no infinite decay: the stage looks back by its window."""
        return None

    def start(self) -> Samples:
        """No samples yet."""
        return ()

    def step(self, state: Samples, x: float, dt: float) -> tuple[Samples, float]:
        """The mean speed over the window after one more sample; the state is the samples in it."""
        samples = slide(state, x, dt, self.window)
        if len(samples) == 1:
            return samples, 0.0
        width, value = edge(samples, self.window)
        return samples, (x - value) / width

    def __call__(self, x: Array, t: Array) -> Array:
        """All mean speeds in one pass."""
        from servobench.recordings.measurement.kernels import mean_slope

        signals = x.reshape(len(x), -1) if x.size else x.reshape(len(x), 0)
        return mean_slope(np.ascontiguousarray(signals), t, self.window).reshape(x.shape)

    def __str__(self) -> str:
        return f"tachometer {number_text(self.window)} s"
