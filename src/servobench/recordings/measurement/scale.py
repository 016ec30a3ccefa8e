"""The stage `scale`: a constant factor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Self

from servobench.core.channels import Array
from servobench.core.errors import UnitError, UsageError
from servobench.core.numbers import number_text
from servobench.core.units import unit as unit_named
from servobench.recordings.measurement.base import STAGES, Kind
from servobench.recordings.measurement.stage_text import number_and_unit


@STAGES.member("scale")
@dataclass(frozen=True, kw_only=True)
class Scale:
    """The input times a factor, by definition y = factor · x.

    A factor without a unit is part of the measurement, such as a gear, and a prediction goes through it.
    With a unit, such as `scale 0.17578125 deg/count`, it says what a value means: counts go in and a position in rad comes
    out, and `measure` takes it for a conversion of units, which a prediction in rad does not go through.
    Raises `UsageError` for a factor that is 0 or not finite, and a unit that isn't one of position by another.
    """

    linear: ClassVar[bool] = True
    examples: ClassVar[tuple[str, ...]] = ("scale -1", "scale 0.17578125 deg/count", "scale 0.0030679616")

    factor: float
    unit: str | None = None

    def __post_init__(self) -> None:
        if not math.isfinite(self.factor) or self.factor == 0.0:
            raise UsageError(
                f"the factor of `scale` is {self.factor:g}; expected a finite number other than zero"
            )
        if self.unit is not None and not _leads_between_positions(self.unit):
            raise UsageError(
                f"the factor of `scale` is in {self.unit}; expected a unit of position by another, such as deg/count or m/rad"
            )

    @classmethod
    def parse(cls, arguments: tuple[str, ...]) -> Self:
        """Return the stage for a number, and a unit or none."""
        factor, symbol = number_and_unit("scale", arguments, cls.examples[:2])
        try:
            return cls(factor=factor, unit=symbol or None)
        except UnitError as error:
            raise UsageError(f"`scale {' '.join(arguments)}`: {error}") from None

    @property
    def si_factor(self) -> float:
        """The factor from SI units to SI units; counts stay counts."""
        return self.factor if self.unit is None else self.factor * unit_named(self.unit).factor

    @property
    def symbol(self) -> tuple[str, ...]:
        """The factor, with its unit if it has one, for a diagram."""
        return (f"{number_text(self.factor)} {self.unit or ''}".rstrip(),)

    def yields(self, kind: Kind) -> Kind:
        """The same as goes in."""
        return kind

    def first_valid(self, first: int, t: Array) -> int:
        """The first valid input gives the first valid output."""
        return first

    def start_response(self, t: Array) -> None:
        """No state."""
        return None

    def start(self) -> None:
        """No state."""
        return None

    def step(self, state: None, x: float, dt: float) -> tuple[None, float]:
        """One sample times the factor."""
        return None, self.si_factor * x

    def __call__(self, x: Array, t: Array) -> Array:
        """All samples times the factor."""
        return self.si_factor * x

    def __str__(self) -> str:
        return " ".join(["scale", number_text(self.factor), *([self.unit] if self.unit else [])])


def _leads_between_positions(symbol: str) -> bool:
    unit_named(symbol)  # raises where it is none
    return any(unit_named(f"({start})*({symbol})").quantity == "position" for start in ("counts", "rad", "m"))
