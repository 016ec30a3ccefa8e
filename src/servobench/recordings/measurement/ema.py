"""The stage `ema`: exponential smoothing, the filter of most sketches for small boards."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Self

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.numbers import check_positive, number_text
from servobench.recordings.measurement.base import STAGES, Kind
from servobench.recordings.measurement.stage_text import expectation, number_and_unit, quantity_in

_EVERY = "every"
_A_PASS = 0.75  # of a pass of the loop: rows as far apart hold whole passes, however their times jitter


@STAGES.member("ema")
@dataclass(frozen=True, kw_only=True)
class Ema:
    """The exponential moving average y[k] = y[k-1] + α (x[k] - y[k-1]), once every pass of a loop with the `period` [s].

    In a program: `y += 0.2 * (x - y)`, or `y = 0.8 * y + 0.2 * x`, with the `weight` α of the newest sample between 0 and 1. It
    remembers (1 - α)/α passes. The newest sample counts at once; `lowpass` by `zoh` or `euler` is a sample later. Rows n passes
    apart have the weight 1 - (1 - α)^n, as if the sample had been the newest one for that long.
    The state starts at zero, and the first output is zero. Raises `UsageError` for a weight outside that range, or a period that
    isn't above 0.
    Source: Brown (1959), Statistical Forecasting for Inventory Control.
    """

    linear: ClassVar[bool] = True
    examples: ClassVar[tuple[str, ...]] = ("ema 0.2 every 10 ms", "ema 0.05 every 1 ms")

    weight: float
    period: float = field(metadata={"unit": "s"})

    def __post_init__(self) -> None:
        check_positive("the time between two passes of an `ema`", self.period, "s")
        if not 0.0 < self.weight < 1.0:
            raise UsageError(
                f"an `ema` can't weigh the newest sample by {self.weight:g}; expected a number between 0 and 1, such as 0.2 for "
                "`y += 0.2 * (x - y)`"
            )

    @classmethod
    def parse(cls, arguments: tuple[str, ...]) -> Self:
        """Return the filter for the weight of the newest sample and how often the loop computes it (`0.2 every 10 ms`)."""
        weight, rest = number_and_unit("ema", arguments, cls.examples)
        every, *time = rest.split() or [""]
        if every != _EVERY:
            what = "the weight of the newest sample and how often the loop computes it"
            raise UsageError(f"`{' '.join(('ema', *arguments))}`: {expectation(what, cls.examples)}")
        return cls(weight=weight, period=quantity_in("s", f"ema {weight:g} {_EVERY}", time, cls.examples))

    @property
    def symbol(self) -> tuple[str, ...]:
        """Numerator and denominator of the low-pass that remembers as long, with ω = -ln(1 - α)/period, for a diagram."""
        cutoff = number_text(float(f"{-np.log1p(-self.weight) / self.period:.4g}"))
        return cutoff, f"s + {cutoff}"

    def decay(self, dt: Array) -> Array:
        """Return what is left of the output before, (1 - α)^n, for times dt (N,) [s] since the sample before of n passes each."""
        passes = dt / self.period
        return np.asarray((1.0 - self.weight) ** np.where(passes > _A_PASS, np.rint(passes), passes))

    def yields(self, kind: Kind) -> Kind:
        """The same as goes in."""
        return kind

    def first_valid(self, first: int, t: Array) -> int:
        """The first valid input gives the first valid output, but for the start state."""
        return first

    def start_response(self, t: Array) -> Array:
        """(1 - α) to the power of the passes since the first sample."""
        return np.asarray(np.cumprod(self.decay(np.diff(t, prepend=t[:1]))), dtype=np.float64)

    def start(self) -> float:
        """No output before the first sample."""
        return 0.0

    def step(self, state: float, x: float, dt: float) -> tuple[float, float]:
        """One sample; the state is the output of the sample before."""
        decay = float(self.decay(np.array([dt]))[0])
        y = decay * state + (1.0 - decay) * x
        return y, y

    def block(self, state: float, x: Array, dt: Array) -> tuple[float, Array]:
        """The average over a block of samples (N,), N at least 1."""
        y = self._average(x[:, None], dt, state)[:, 0]
        return float(y[-1]), y

    def __call__(self, x: Array, t: Array) -> Array:
        """The average over a whole record."""
        signals = x.reshape(len(x), -1) if x.size else x.reshape(len(x), 0)
        return self._average(signals, np.diff(t, prepend=t[:1]), 0.0).reshape(x.shape)

    def __str__(self) -> str:
        return f"ema {number_text(self.weight)} {_EVERY} {number_text(self.period)} s"

    def _average(self, x: Array, dt: Array, before: float) -> Array:
        """That of signals (N, P), all with the same output before them."""
        from servobench.recordings.measurement.kernels import first_order_recursion

        decay = self.decay(dt)
        drive = (1.0 - decay)[:, None] * np.ascontiguousarray(x)
        drive[:1] += decay[:1, None] * before
        return first_order_recursion(decay, drive)
