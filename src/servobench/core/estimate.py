"""A number with its uncertainty, as every room hands it on."""

from __future__ import annotations

from dataclasses import dataclass


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
