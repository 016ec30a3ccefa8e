"""The stage `average`: the mean over a fixed time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise
from typing import ClassVar, Self

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.numbers import check_positive, number_text
from servobench.recordings.measurement.base import STAGES, Kind
from servobench.recordings.measurement.stage_text import number_and_unit, quantity_in
from servobench.recordings.measurement.window import Samples, edge, first_filled, slide


@STAGES.member("average")
@dataclass(frozen=True, kw_only=True)
class Average:
    """The mean over the last W seconds (`window`), with straight lines between the samples.

    By definition y(t) = (1/W) ∫ x from t - W to t. Exact for a signal that is straight between samples, at regular or irregular
    times, whether or not W is a number of sample times; the firmware behind a log samples faster than the log, so that its
    average is near to that of the signal itself. Slow signals are delayed by W/2. (The mean of the last n logged samples
    instead delays by half a sample less, with W = n Δt.) While the record is shorter than W the mean goes over what there is;
    the first output is the first sample.
    """

    linear: ClassVar[bool] = True
    examples: ClassVar[tuple[str, ...]] = ("average 0.103 s", "average 20 ms")

    window: float = field(metadata={"unit": "s"})

    def __post_init__(self) -> None:
        check_positive("the window of `average`", self.window, "s")

    @classmethod
    def parse(cls, arguments: tuple[str, ...]) -> Self:
        """Return the stage for a time with its unit; how long a number of samples takes isn't known here."""
        number, symbol = number_and_unit("average", arguments, cls.examples)
        if symbol in ("", "sample", "samples") and number.is_integer():
            raise UsageError(
                f"`average {' '.join(arguments)}`: that is a number of samples, and the stage takes a time, as the firmware may "
                f"sample faster than the record. Multiply by the sample time of the averaging: {number:g} samples of 1 ms are "
                f"`average {number:g} ms`"
            )
        return cls(window=quantity_in("s", "average", arguments, cls.examples))

    @property
    def symbol(self) -> tuple[str, ...]:
        """Numerator and denominator of the transfer function, for a diagram."""
        return f"1 − e^{{−{number_text(self.window)}·s}}", f"{number_text(self.window)}·s"

    def yields(self, kind: Kind) -> Kind:
        """The same as goes in."""
        return kind

    def first_valid(self, first: int, t: Array) -> int:
        """The first output with a whole window of valid inputs."""
        return first_filled(first, t, self.window)

    def start_response(self, t: Array) -> None:
        """There is no infinite decay: the stage looks back by its window."""
        return None

    def start(self) -> Samples:
        """No samples yet."""
        return ()

    def step(self, state: Samples, x: float, dt: float) -> tuple[Samples, float]:
        """The mean over the window after one more sample; the state is the samples in it."""
        samples = slide(state, x, dt, self.window)
        if len(samples) == 1:
            return samples, x
        width, value = edge(samples, self.window)
        corners = [(width, value), *samples[1:]]
        areas = [(a - b) * 0.5 * (x_a + x_b) for (a, x_a), (b, x_b) in pairwise(corners)]
        return samples, math.fsum(areas) / width

    def __call__(self, x: Array, t: Array) -> Array:
        """All means in one pass."""
        from servobench.recordings.measurement.kernels import moving_mean

        signals = x.reshape(len(x), -1) if x.size else x.reshape(len(x), 0)
        return moving_mean(np.ascontiguousarray(signals), t, self.window).reshape(x.shape)

    def __str__(self) -> str:
        return f"average {number_text(self.window)} s"
