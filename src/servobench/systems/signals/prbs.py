"""A pseudo-random binary sequence of maximum length."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from servobench.core.channels import Array
from servobench.core.settings import PositiveTime, Settings, Time
from servobench.systems.signals.base import SIGNALS, HighLevel, Level
from servobench.systems.signals.edges import periods

# order -> the lags whose bits are added modulo 2. Each row is a primitive polynomial over GF(2), as the tests prove.
_LAGS: dict[int, tuple[int, ...]] = {
    2: (2, 1), 3: (3, 2), 4: (4, 3), 5: (5, 3), 6: (6, 5), 7: (7, 6), 8: (8, 6, 5, 4), 9: (9, 5), 10: (10, 7), 11: (11, 9),
    12: (12, 6, 4, 1), 13: (13, 4, 3, 1), 14: (14, 5, 3, 1), 15: (15, 14), 16: (16, 15, 13, 4), 17: (17, 14), 18: (18, 11),
    19: (19, 6, 2, 1), 20: (20, 17),
}  # fmt: skip


@SIGNALS.member("prbs")
class PRBS(Settings):
    """The output of a linear feedback shift register of n bits, shifted every `bit_time`: `high` for a bit 1,
    `low` for a bit 0.

    The feedback polynomial is primitive, so the register passes through all 2ⁿ - 1 states other than zero before it repeats:
    a period has one more bit 1 than bits 0, and the autocorrelation of the bits, as ±1, is 1 at whole periods
    and -1/(2ⁿ - 1) at all other lags (Golomb, Shift Register Sequences, 1967). `low` before `start`.

    >>> PRBS(low=-3, high=3, order=7, bit_time="10 ms").period
    1.27
    """

    low: Level = -3.0
    """Value of a bit 0 [V]."""
    high: HighLevel = 3.0
    """Value of a bit 1 [V]."""
    bit_time: PositiveTime = 0.04
    """Time for which a bit holds [s]."""
    order: Annotated[int, Field(ge=2, le=20, strict=True)] = 8
    """Length n of the register, from 2 to 20; a period has 2ⁿ - 1 bits."""
    seed: Annotated[int, Field(ge=1, strict=True)] = 1
    """Content of the register at `start`, from 1 to 2ⁿ - 1; its binary digits are the first n bits of the sequence."""
    start: Time = 0.0
    """Time at which the sequence begins [s]."""

    @model_validator(mode="after")
    def _seed_fits(self) -> Self:
        if self.seed >= 2**self.order:
            raise ValueError(
                f"seed = {self.seed} doesn't fit a register of {self.order} bits; expected 1 to {2**self.order - 1}"
            )
        return self

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s]."""
        at = periods(t, 1 / self.bit_time, self.start)
        bits = _bits(self.order, self.seed)
        return np.where(at.started & bits[np.mod(at.whole, len(bits)).astype(int)], self.high, self.low)

    @property
    def period(self) -> float:
        """The time of 2ⁿ - 1 bits [s]."""
        return ((1 << self.order) - 1) * self.bit_time

    @property
    def shortest_change(self) -> float:
        """The time of one bit [s]."""
        return self.bit_time


@lru_cache(maxsize=8)
def _bits(order: int, seed: int) -> NDArray[np.bool_]:
    """One period of the sequence, shape (2^order - 1,).

    x[k] is the sum modulo 2 of x[k - lag] over the lags. As p(x)² = p(x²) over GF(2), the same holds with all lags doubled, so
    that what is known can be continued in blocks of growing length.
    """
    bits = np.zeros(2**order - 1, dtype=bool)
    bits[:order] = [int(digit) for digit in f"{seed:0{order}b}"]
    known, lags = order, np.array(_LAGS[order])
    while known < len(bits):
        if 2 * lags[0] <= known:
            lags = 2 * lags
        block = min(int(lags.min()), len(bits) - known)
        bits[known : known + block] = np.logical_xor.reduce(
            [bits[known - lag : known - lag + block] for lag in lags]
        )
        known += block
    bits.flags.writeable = False
    return bits
