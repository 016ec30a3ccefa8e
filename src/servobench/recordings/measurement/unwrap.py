"""The stage `unwrap`: the travel of a counter or an angle that starts again at the end of its range."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import UnitError, UsageError
from servobench.core.numbers import check_positive, number_text
from servobench.core.units import unit as unit_named
from servobench.recordings.measurement.base import STAGES, Kind, Mask
from servobench.recordings.measurement.stage_text import expectation, number_and_unit

_LARGEST_BITS = 53  # a float holds whole numbers up to 2^53
_MOST_WRAPS = 2.0**53


@dataclass(frozen=True, kw_only=True, eq=False)
class Unwrapped:
    """The result of the inverse modulus for N samples, arrays along the first axis.

    `count` is the value without wraps, `delta` its change since the sample before (0 for the first), `wrap` the signed number of
    wraps in that step, up is positive, and `ambiguous` says where the step is half the modulus, so that it may as well have
    gone the other way.
    """

    count: Array
    delta: Array
    wrap: NDArray[np.int64]
    ambiguous: Mask


def unwrap(x: Array, modulus: float) -> Unwrapped:
    """Return samples x (N,) or (N, P) without the wraps of a value that is known up to multiples of a modulus.

    With d = x[k] - x[k-1], wrap = -round(d/M), delta = d + wrap·M, and count = x + M·(wraps so far), which for whole numbers is
    exact and starts at x[0]. It is right where the true change between samples is less than half the modulus (inverse modulus,
    section II.D of the paper).
    Raises `UsageError` where there would be more wraps than can be counted.
    """
    d = np.zeros(x.shape)
    d[1:] = np.diff(x, axis=0)
    turns = -np.rint(d / modulus)
    if (np.abs(turns) > _MOST_WRAPS).any():
        raise UsageError(
            f"values up to {np.abs(x).max():g} can't be unwrapped by {modulus:g}: the steps between samples are too long"
        )
    delta = d + turns * modulus
    return Unwrapped(
        count=x + modulus * np.cumsum(turns, axis=0),
        delta=delta,
        wrap=turns.astype(np.int64),
        ambiguous=np.abs(delta) >= 0.5 * modulus,
    )


@STAGES.member("unwrap")
@dataclass(frozen=True, kw_only=True)
class Unwrap:
    """A position without its wraps: the `count` of `unwrap`.

    `modulus` is in `unit`, a unit of position (`16 bit` is 65536 counts); the samples are in SI units or in counts.
    Not linear: it belongs before all else, and a prediction doesn't go through it.
    Raises `UsageError` for a modulus that isn't above 0, or a unit that is none of position.
    """

    linear: ClassVar[bool] = False
    examples: ClassVar[tuple[str, ...]] = (
        "unwrap 16 bit",
        "unwrap 360 deg",
        "unwrap 2048 counts",
        "unwrap 32 bit",
    )

    modulus: float
    unit: str

    def __post_init__(self) -> None:
        check_positive("the modulus of `unwrap`", self.modulus, self.unit)
        if unit_named(self.unit).quantity != "position":
            raise UsageError(
                f"the modulus of `unwrap` is in {self.unit}; expected a unit of position: counts, deg, rev, m"
            )

    @classmethod
    def parse(cls, arguments: tuple[str, ...]) -> Self:
        """Return the stage for a number of bits, or a modulus with its unit."""
        text = " ".join(arguments)
        number, symbol = number_and_unit("unwrap", arguments, cls.examples[:2])
        if not symbol:
            raise UsageError(f"`unwrap {text}`: {expectation('a modulus with its unit', cls.examples[:2])}")
        if symbol in {"bit", "bits"}:
            if not number.is_integer() or not 1 <= number <= _LARGEST_BITS:
                raise UsageError(
                    f"`unwrap {text}`: expected a whole number of bits from 1 to {_LARGEST_BITS}"
                )
            return cls(modulus=2.0**number, unit="counts")
        try:
            return cls(modulus=number, unit=symbol)
        except UnitError as error:
            raise UsageError(f"`unwrap {text}`: {error}") from None

    @property
    def si_modulus(self) -> float:
        """The modulus in SI units; counts stay counts."""
        return self.modulus * unit_named(self.unit).factor

    @property
    def symbol(self) -> tuple[str, ...]:
        """The modulus, for a diagram."""
        bits = math.log2(self.modulus)
        power = f"2^{{{bits:g}}}" if bits.is_integer() else number_text(self.modulus)
        return (f"mod {power}" if self.unit == "counts" else f"mod {power} {self.unit}",)

    def yields(self, kind: Kind) -> Kind:
        """A position, of a position."""
        if kind != "position":
            raise UsageError("`unwrap` needs a position; a speed doesn't wrap")
        return kind

    def first_valid(self, first: int, t: Array) -> int:
        """The first valid input gives the first valid output."""
        return first

    def start_response(self, t: Array) -> None:
        """Not linear."""
        return None

    def start(self) -> tuple[float | None, float]:
        """No sample before the first, no wraps so far."""
        return None, 0.0

    def step(
        self, state: tuple[float | None, float], x: float, dt: float
    ) -> tuple[tuple[float, float], float]:
        """One sample; the state is the sample before and the wraps so far."""
        before, turns = state
        if before is not None:
            turns -= round((x - before) / self.si_modulus)
        return (x, turns), x + self.si_modulus * turns

    def block(
        self, state: tuple[float | None, float], x: Array, dt: Array
    ) -> tuple[tuple[float, float], Array]:
        """A block of samples (N,), N at least 1."""
        from servobench.recordings.measurement.kernels import unwrap_block

        before, turns = state
        turns, y = unwrap_block(x, float(x[0] if before is None else before), turns, self.si_modulus)
        return (float(x[-1]), turns), y

    def __call__(self, x: Array, t: Array) -> Array:
        """All samples at once."""
        return unwrap(x, self.si_modulus).count

    def __str__(self) -> str:
        return f"unwrap {number_text(self.modulus)} {self.unit}"
