"""The tolerance of a blank: how far an answer may be from what is known, and still be right."""

from __future__ import annotations

import math
from dataclasses import dataclass

from servobench.core.errors import UnitError, UsageError
from servobench.core.units import quantity
from servobench.lab.expression import Fact

_EXPECTED = (
    'expected "exact", or parts joined by +, each "interval", a percentage of the value or a quantity: "interval + 2 %", '
    '"0.5 ms"'
)
_ROUNDING = 1e-9  # relative; what a number loses on its way through decimal digits


@dataclass(frozen=True)
class Tolerance:
    """The tolerance of an answer, as text in the unit of its blank.

    `exact`, or a sum of parts: `interval` (half of the 95 % interval that the recording leaves), a percentage of the value, a
    quantity such as `0.5 ms`. A bare number goes with a blank that has no unit, or has %, where `0.5` is half a percentage point
    and `0.5 %` a two hundredth of the value. Raises `UsageError` for any other text.
    """

    text: str
    unit: str

    def __post_init__(self) -> None:
        if not self._exact and not self._parts():
            raise UsageError(f"{self.text!r} is no tolerance; {_EXPECTED}")

    def around(self, known: Fact) -> float:
        """Return by how much an answer may differ from what is known, in the unit of the blank; infinite where nothing is."""
        total = _ROUNDING * abs(known.value)
        if self._exact:
            return total
        for kind, size in self._parts():
            total += {"interval": known.half, "percent": abs(known.value) * size / 100, "size": size}[kind]
        return total

    @property
    def _exact(self) -> bool:
        return self.text.strip() == "exact"

    def _parts(self) -> list[tuple[str, float]]:
        return [self._part(part.strip()) for part in self.text.split("+")]

    def _part(self, text: str) -> tuple[str, float]:
        if text == "interval":
            return "interval", math.nan
        if text and self.unit not in ("", "%") and text[-1] in "0123456789.":
            raise UsageError(
                f'{text!r} in the tolerance {self.text!r} has no unit; write "{text} %" of the value, or "{text} {self.unit}"'
            )
        kind, unit = ("percent", "%") if text.endswith("%") else ("size", self.unit or "1")
        try:
            size = quantity(text, unit)
        except UnitError as error:
            raise UsageError(f"{self.text!r} is no tolerance: {error}; {_EXPECTED}") from None
        if size <= 0:
            raise UsageError(f"{text!r} in the tolerance {self.text!r} is not above zero; {_EXPECTED}")
        return kind, size
