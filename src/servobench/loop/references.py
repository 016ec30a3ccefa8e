"""What a controller is to follow: a signal at the scheduled times of the ticks."""

from __future__ import annotations

import numpy as np

from servobench.channels import Array
from servobench.errors import UsageError
from servobench.signals.base import Signal

BLOCK = 512  # evaluated at once: a call of a signal costs far more than one more value in it


class References:
    """The reference at each tick, in blocks; the first at once, as a mistake should show before anything moves.

    `first_tick` is the tick at which the signal's own time is 0. Raises `UsageError` for values of another shape.
    """

    def __init__(self, signal: Signal, sample_time: float, first_tick: int = 0) -> None:
        self._signal = signal
        self._sample_time = sample_time
        self._first_tick = first_tick
        self._evaluate(first_tick)

    def __getitem__(self, index: int) -> float:
        if not self._first <= index < self._first + BLOCK:
            self._evaluate(index)
        return self._values[index - self._first]

    def _evaluate(self, first: int) -> None:
        ticks: Array = np.arange(first - self._first_tick, first - self._first_tick + BLOCK, dtype=np.float64)
        t = ticks * self._sample_time
        values = np.asarray(self._signal(t), dtype=np.float64)
        if values.shape != t.shape:
            raise UsageError(
                f"the signal {self._signal!r} gave shape {values.shape} for times of shape {t.shape}"
            )
        self._first = first
        self._values: list[float] = values.tolist()
