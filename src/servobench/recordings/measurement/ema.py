"""The stage `ema`: exponential smoothing, the filter of most sketches for small boards."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.numbers import number_text
from servobench.recordings.measurement.base import STAGES, Kind
from servobench.recordings.measurement.stage_text import expectation, number_and_unit


@STAGES.member("ema")
@dataclass(frozen=True, kw_only=True)
class Ema:
    """The exponential moving average y[k] = y[k-1] + α (x[k] - y[k-1]) with the `weight` α of the newest sample, between 0 and 1.

    In a program: `y += 0.2 * (x - y)`, or `y = 0.8 * y + 0.2 * x`. It goes by samples and not by time: of samples a time Δt apart
    it remembers (1 - α)/α Δt. The newest sample counts at once; `lowpass` by `zoh` or `euler` is a sample later.
    The state starts at zero. Raises `UsageError` for a weight outside that range.
    Source: Brown (1959), Statistical Forecasting for Inventory Control.
    """

    linear: ClassVar[bool] = True
    examples: ClassVar[tuple[str, ...]] = ("ema 0.2", "ema 0.05")

    weight: float

    def __post_init__(self) -> None:
        if not 0.0 < self.weight < 1.0:
            raise UsageError(
                f"an `ema` can't weigh the newest sample by {self.weight:g}; expected a number between 0 and 1, such as 0.2 for "
                "`y += 0.2 * (x - y)`"
            )

    @classmethod
    def parse(cls, arguments: tuple[str, ...]) -> Self:
        """Return the filter for the weight of the newest sample (`0.2`); raises `UsageError` for anything else."""
        weight, rest = number_and_unit("ema", arguments, cls.examples)
        if rest:
            raise UsageError(
                f"`{' '.join(('ema', *arguments))}`: {expectation('the weight of the newest sample', cls.examples)}"
            )
        return cls(weight=weight)

    @property
    def symbol(self) -> tuple[str, ...]:
        """Numerator and denominator in z, for a diagram."""
        return number_text(self.weight), f"1 − {number_text(1.0 - self.weight)} z^{{−1}}"

    def yields(self, kind: Kind) -> Kind:
        """The same as goes in."""
        return kind

    def first_valid(self, first: int, t: Array) -> int:
        """The first valid input gives the first valid output, but for the start state."""
        return first

    def start_response(self, t: Array) -> Array:
        """(1 - α) to the power of the samples since the first."""
        return np.asarray((1.0 - self.weight) ** np.arange(len(t)), dtype=np.float64)

    def start(self) -> float:
        """No output before the first sample."""
        return 0.0

    def step(self, state: float, x: float, dt: float) -> tuple[float, float]:
        """One sample; the state is the output of the sample before."""
        y = state + self.weight * (x - state)
        return y, y

    def block(self, state: float, x: Array, dt: Array) -> tuple[float, Array]:
        """The average over a block of samples (N,), N at least 1."""
        y = self._average(x[:, None], state)[:, 0]
        return float(y[-1]), y

    def __call__(self, x: Array, t: Array) -> Array:
        """The average over a whole record."""
        signals = x.reshape(len(x), -1) if x.size else x.reshape(len(x), 0)
        return self._average(signals, 0.0).reshape(x.shape)

    def __str__(self) -> str:
        return f"ema {number_text(self.weight)}"

    def _average(self, x: Array, before: float) -> Array:
        """That of signals (N, P), all with the same output before them."""
        from servobench.recordings.measurement.kernels import first_order_recursion

        drive = self.weight * np.ascontiguousarray(x)
        drive[:1] += (1.0 - self.weight) * before
        return first_order_recursion(np.full(len(x), 1.0 - self.weight), drive)
