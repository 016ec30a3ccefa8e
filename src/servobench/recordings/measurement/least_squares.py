"""The stage `least_squares`: the slope of the straight line through the samples of a window."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Self, TypeAlias

import numpy as np

from servobench.core.channels import Array
from servobench.core.numbers import check_positive, number_text
from servobench.recordings.measurement.base import STAGES, Kind, speed_of_position
from servobench.recordings.measurement.stage_text import quantity_in
from servobench.recordings.measurement.window import first_filled

Samples: TypeAlias = tuple[tuple[float, float], ...]  # (age [s], value), oldest first

_ROUNDING = 1e-9  # of the window: sample times are rounded, and a sample at its edge belongs to it


@STAGES.member("least_squares")
@dataclass(frozen=True, kw_only=True)
class LeastSquares:
    """The speed y = Σ (t - t̄)(x - x̄)/Σ (t - t̄)² over the samples of the last W seconds, of a position x.

    It uses all positions of the window where `tachometer` uses two, so that its noise is lower by about √(n/6) for n samples, at
    the same lag of W/2 (Brown, Schneider and Mulligan 1992). A W below the time between samples goes over the last two; while
    the record is shorter than W it goes over what there is, and the first output is zero.
    """

    linear: ClassVar[bool] = True
    examples: ClassVar[tuple[str, ...]] = ("least_squares 20 ms", "least_squares 0.0333 s")

    window: float = field(metadata={"unit": "s"})

    def __post_init__(self) -> None:
        check_positive("the window of `least_squares`", self.window, "s")

    @classmethod
    def parse(cls, arguments: tuple[str, ...]) -> Self:
        """Return the stage for a time with its unit."""
        return cls(window=quantity_in("s", "least_squares", arguments, cls.examples))

    @property
    def symbol(self) -> tuple[str, ...]:
        """The transfer function of the slope over all positions of the window, as numerator and denominator, for a diagram."""
        w = number_text(self.window)
        return (
            f"6·({w}·s·(1 + e^{{−{w}·s}}) − 2·(1 − e^{{−{w}·s}}))",
            f"{number_text(self.window**3)}·s·s",
        )

    def yields(self, kind: Kind) -> Kind:
        """A speed, of a position."""
        return speed_of_position("least_squares", kind)

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
        """The slope over the window after one more sample; the state is the samples in it."""
        aged = [(age + dt, value) for age, value in state]
        aged.append((0.0, x))
        while len(aged) > 2 and aged[0][0] > self.window * (1.0 + _ROUNDING):
            del aged[0]
        if len(aged) == 1:
            return tuple(aged), 0.0
        ages, values = np.array(aged).T
        earlier = ages.mean() - ages
        return tuple(aged), float(earlier @ (values - values.mean()) / (earlier @ earlier))

    def __call__(self, x: Array, t: Array) -> Array:
        """All slopes."""
        from servobench.recordings.measurement.kernels import line_slope

        signals = x.reshape(len(x), -1) if x.size else x.reshape(len(x), 0)
        return line_slope(np.ascontiguousarray(signals), t, self.window * (1.0 + _ROUNDING)).reshape(x.shape)

    def __str__(self) -> str:
        return f"least_squares {number_text(self.window)} s"
