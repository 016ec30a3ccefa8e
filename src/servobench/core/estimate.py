"""A number with its uncertainty, as all rooms use it."""

from __future__ import annotations

from dataclasses import dataclass

from servobench.core.rounding import rounded_interval


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """One parameter's value, standard deviation and two-sided interval at a level (0.95), with its unit."""

    value: float
    sd: float
    """Standard deviation, in the unit of the value."""
    interval: tuple[float, float]
    level: float
    unit: str

    @property
    def half_width(self) -> float:
        """Half of the interval, in the unit of the value."""
        return 0.5 * (self.interval[1] - self.interval[0])

    def __float__(self) -> float:
        """Return the value, so that an estimate goes where a number goes."""
        return self.value

    def __format__(self, spec: str) -> str:
        """Return the value in a number's format, such as `.3f`; without one what `str` returns."""
        return format(self.value, spec) if spec else str(self)

    def __str__(self) -> str:
        """Return the value with half of its interval and the unit, to as many digits as are known: 21.9 ± 0.3 rad/(s·V)."""
        return str(rounded_interval(self.value, self.interval, self.unit))
