"""The sensitivity of a sensor that gives a voltage or a bare number: `142.9 rpm/V`, or `7 V/krpm` as on its data sheet."""

from __future__ import annotations

import re
from dataclasses import dataclass

from servobench.core.units import convert, is_unit, unit

_UNIT = r"\([^()]+\)|[^/\s()]+(?:/s)?"
_TEXT = re.compile(rf"(?P<number>[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(?P<above>{_UNIT})\s*/\s*(?P<below>{_UNIT})")
_THOUSANDS = {"krpm": (1000.0, "rpm")}  # as tachogenerators are specified


@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """`number` of a `unit` of position or speed for one `per` of what the sensor gives."""

    number: float
    unit: str
    per: str

    def factor_from(self, symbol: str | None) -> float:
        """Return the factor from values in a unit, that of `per` where it isn't known, to `unit`.

        Raises `UnitError` where the two measure different quantities.
        """
        return self.number * (1.0 if symbol is None else convert(1.0, symbol, self.per))

    def __str__(self) -> str:
        return f"{self.number:.6g} {self.unit}/{self.per}"


def sensitivity(text: str | None) -> Sensitivity | None:
    """Return the sensitivity that a text describes, either way up; None for anything else."""
    match = _TEXT.fullmatch((text or "").strip())
    if not match:
        return None
    (above, many), (below, few) = _unit_of(match["above"]), _unit_of(match["below"])
    try:
        number = float(match["number"]) * many / few
    except ValueError:
        return None
    if not number or not (is_unit(above) and is_unit(below)):
        return None
    shaft = [unit(each).quantity in {"position", "speed"} for each in (above, below)]
    if shaft == [True, False]:
        return Sensitivity(number=number, unit=above, per=below)
    if shaft == [False, True]:
        return Sensitivity(number=1.0 / number, unit=below, per=above)
    return None


def _unit_of(symbol: str) -> tuple[str, float]:
    """The unit of a symbol that may stand for a thousand of it, and how many of it that is."""
    plain = symbol.strip("()")
    factor, own = _THOUSANDS.get(plain, (1.0, plain))
    return own, factor
