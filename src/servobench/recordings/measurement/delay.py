"""The stage `delay`: the same later."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from servobench.core.channels import Array
from servobench.core.numbers import check_positive, number_text
from servobench.recordings.measurement.base import STAGES, Kind
from servobench.recordings.measurement.stage_text import quantity_in
from servobench.recordings.measurement.window import Samples, edge, first_filled, slide


@STAGES.member("delay")
@dataclass(frozen=True, kw_only=True)
class Delay:
    """The input as it was d seconds before, by definition y(t) = x(t - d), with straight lines between the samples.

    What a device reports late by a time that is known, such as the time between two messages of its bus. A delay that isn't
    known need not be said: one is identified with the motor, and this one is taken off it.
    While the record is shorter than d the output is the first sample.
    """

    linear: ClassVar[bool] = True
    examples: ClassVar[tuple[str, ...]] = ("delay 10 ms", "delay 0.0007 s")

    time: float = field(metadata={"unit": "s"})

    def __post_init__(self) -> None:
        check_positive("the time of `delay`", self.time, "s")

    @classmethod
    def parse(cls, arguments: tuple[str, ...]) -> Self:
        """Return the stage for a time with its unit."""
        return cls(time=quantity_in("s", "delay", arguments, cls.examples))

    @property
    def symbol(self) -> tuple[str, ...]:
        """The transfer function, for a diagram."""
        return (f"e^{{−{number_text(self.time)}·s}}",)

    def yields(self, kind: Kind) -> Kind:
        """The same as goes in."""
        return kind

    def first_valid(self, first: int, t: Array) -> int:
        """The first output that the first valid input has come through to."""
        return first_filled(first, t, self.time)

    def start_response(self, t: Array) -> None:
        """There is no infinite decay: the stage looks back by its time."""
        return None

    def start(self) -> Samples:
        """No samples yet."""
        return ()

    def step(self, state: Samples, x: float, dt: float) -> tuple[Samples, float]:
        """The input of a delay ago; the state is the samples since."""
        samples = slide(state, x, dt, self.time)
        return samples, x if len(samples) == 1 else edge(samples, self.time)[1]

    def __call__(self, x: Array, t: Array) -> Array:
        """All samples at once."""
        if not len(t):
            return np.array(x)
        columns = [np.interp(t - self.time, t, column) for column in x.reshape(len(x), -1).T]
        return np.stack(columns, axis=1).reshape(x.shape) if columns else np.array(x)

    def __str__(self) -> str:
        return f"delay {number_text(self.time)} s"
