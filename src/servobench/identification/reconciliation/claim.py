"""A claimed figure: a parameter, its value as written, and the precision of that value."""

from __future__ import annotations

import re
from dataclasses import dataclass
from decimal import Decimal
from typing import Literal, TypeAlias

from servobench.core.errors import UnitError, UnknownName, UsageError
from servobench.core.parameter_names import parameter_in_words
from servobench.core.units import quantity

Claimed: TypeAlias = Literal["gain", "time_constant"]
_SPELLINGS: dict[str, Claimed] = {
    "gain": "gain",
    "K": "gain",
    "time_constant": "time_constant",
    "tau": "time_constant",
    "τ": "time_constant",
}
# These are parameters of structures too, but the causes only concern gain and time constant.
_NOT_EXPLAINED = ("coulomb_voltage", "offset_voltage", "stribeck_voltage", "delay")
# In SI units: no motor is beyond these, nor is any mistake in a unit.
_RANGES: dict[Claimed, tuple[float, float]] = {"gain": (1e-12, 1e12), "time_constant": (1e-9, 1e6)}
_NUMBER = re.compile(r"\s*[+-]?(?P<digits>\d+\.?\d*|\.\d+)(?:[eE](?P<exponent>[+-]?\d{1,3}))?")
_PLUS_MINUS = re.compile(r"±|\+/?-")
_FEWEST_DIGITS = 2  # of a data sheet's value: 4e-06 was written 4.0e-6


@dataclass(frozen=True, kw_only=True)
class Claim:
    """A claimed gain [unit of the data] or time constant [s], known to ± `half_width`; `text` is how it was written."""

    name: Claimed
    """The kind of the claim."""
    value: float
    """The figure itself."""
    half_width: float
    text: str

    @classmethod
    def parse(cls, text: str, gain_unit: str = "rad/(s·V)") -> Claim:
        """Return the claim that a text makes: `tau=0.13`, `tau=130ms`, `gain=23.8`, `tau=0.13±0.01`.

        Without ± it is known to half a unit of its last digit: 0.13 means 0.125 to 0.135. A gain without a unit is in
        `gain_unit`. Raises `UsageError` if it isn't a claim, or its parameter has no known causes;
        `UnknownName` for what is no parameter.
        """
        name, mark, rest = text.partition("=")
        if not mark or not rest.strip():
            raise UsageError(f"claim {text!r}: expected NAME=VALUE, such as tau=0.13, tau=130ms or gain=23.8")
        if name.strip() in _NOT_EXPLAINED:
            raise UsageError(
                f"claim {text!r}: only a gain or a time constant can be explained; compare a claimed "
                f"{parameter_in_words(name.strip())} with its interval and the findings from `servobench identify`"
            )
        if name.strip() not in _SPELLINGS:
            raise UnknownName("parameter to claim", name.strip(), _SPELLINGS)
        known = _SPELLINGS[name.strip()]
        unit = gain_unit if known == "gain" else "s"
        written, *bounds = _PLUS_MINUS.split(rest.strip())
        try:
            value = quantity(written, unit)
            half = quantity(bounds[0], unit) if len(bounds) == 1 else _half_digit(written, value)
        except UnitError as error:
            raise UsageError(f"claim {text!r}: {error}") from None
        smallest, largest = _RANGES[known]
        if not (value > 0 or known == "gain") or not smallest <= abs(value) <= largest:
            either = "either way" if known == "gain" else "s"
            raise UsageError(
                f"claim {text!r}: a {parameter_in_words(known)} of {value:g} isn't possible; expected "
                f"{smallest:g} to {largest:g}{', ' if known == 'gain' else ' '}{either}"
            )
        if len(bounds) > 1 or not half > 0:
            raise UsageError(f"claim {text!r}: expected one ± and a number above 0 after it")
        return cls(name=known, value=value, half_width=half, text=text.strip())


def last_digit_half_width(value: float) -> float:
    """Return half a unit of the last digit that a number of a data sheet was written with; two digits are the fewest."""
    if value == 0:
        return 0.0
    _, digits, exponent = Decimal(repr(float(value))).normalize().as_tuple()
    lacking = max(_FEWEST_DIGITS - len(digits), 0)
    return 0.5 * 10.0 ** (int(exponent) - lacking)


def _half_digit(written: str, value: float) -> float:
    """Half a unit of the last digit of a number as it was written, in the unit of its value."""
    match = _NUMBER.match(written)
    if match is None:
        raise UnitError(f"{written!r} isn't a number with a unit")
    decimals = len(match["digits"].partition(".")[2])
    number = float(match["digits"]) * 10.0 ** int(match["exponent"] or 0)
    last = 0.5 * 10.0 ** (int(match["exponent"] or 0) - decimals)
    return abs(value) * last / number if number else 0.0
