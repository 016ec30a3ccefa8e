"""Units: SI inside; other units at the edges only.

A unit is a product of powers of base units, read from left to right: `rad/s`, `kg·m²`, `g*cm^2`, `N·m/√Hz`, `counts/rev`.
Angle is kept as a dimension of its own, so that a position, a speed and a frequency can be told apart,
and `Hz` is one revolution per second: a cut-off of `8 Hz` read in `rad/s` is 50.3.
The radian alone may be left out, as SI allows (`N·m/A` is `V·s/rad`).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from decimal import Decimal
from difflib import get_close_matches
from functools import cache

from servobench.core.errors import UnitError

# Powers of (kg, m, s, A, angle, count, percent).
Dimension = tuple[float, ...]
_NONE: Dimension = (0.0,) * 7


def _dimension(**powers: float) -> Dimension:
    names = ("kg", "m", "s", "A", "angle", "count", "percent")
    return tuple(float(powers.get(name, 0)) for name in names)


# name -> (factor to SI, dimension); only these take an SI prefix.
_PREFIXED: dict[str, tuple[float, Dimension]] = {
    "s": (1.0, _dimension(s=1)),
    "V": (1.0, _dimension(kg=1, m=2, s=-3, A=-1)),
    "A": (1.0, _dimension(A=1)),
    "ohm": (1.0, _dimension(kg=1, m=2, s=-3, A=-2)),
    "H": (1.0, _dimension(kg=1, m=2, s=-2, A=-2)),
    "m": (1.0, _dimension(m=1)),
    "g": (1e-3, _dimension(kg=1)),
    "N": (1.0, _dimension(kg=1, m=1, s=-2)),
    "W": (1.0, _dimension(kg=1, m=2, s=-3)),
    "J": (1.0, _dimension(kg=1, m=2, s=-2)),
    "Hz": (2 * math.pi, _dimension(s=-1, angle=1)),
    "rad": (1.0, _dimension(angle=1)),
    "Ω": (1.0, _dimension(kg=1, m=2, s=-3, A=-2)),
    "Ohm": (1.0, _dimension(kg=1, m=2, s=-3, A=-2)),
    "Nm": (1.0, _dimension(kg=1, m=2, s=-2)),
}
_PLAIN: dict[str, tuple[float, Dimension]] = {
    "1": (1.0, _NONE),
    "deg": (math.pi / 180, _dimension(angle=1)),
    "rev": (2 * math.pi, _dimension(angle=1)),
    "count": (1.0, _dimension(count=1)),
    "rpm": (2 * math.pi / 60, _dimension(s=-1, angle=1)),
    "ft": (0.3048, _dimension(m=1)),
    "inch": (0.0254, _dimension(m=1)),
    "min": (60.0, _dimension(s=1)),
    "h": (3600.0, _dimension(s=1)),
    "%": (1.0, _dimension(percent=1)),
}
_PREFIXES = {"p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 1e-1, "k": 1e3, "M": 1e6}
_ALIASES = {
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "millisecond": "ms", "milliseconds": "ms", "msec": "ms",
    "msecs": "ms", "millis": "ms", "millisec": "ms", "millisecs": "ms",
    "microsecond": "us", "microseconds": "us", "usec": "us", "usecs": "us", "micros": "us", "microsec": "us", "microsecs": "us",
    "segundos": "s", "secondes": "s", "secondi": "s", "Sekunden": "s",
    "milisegundos": "ms", "milissegundos": "ms", "millisecondes": "ms", "millisecondi": "ms", "Millisekunden": "ms",
    "minute": "min", "minutes": "min",
    "hr": "h", "hour": "h", "hours": "h",
    "volt": "V", "volts": "V", "Volt": "V", "Volts": "V", "v": "V", "millivolt": "mV", "millivolts": "mV",
    "amp": "A", "amps": "A", "ampere": "A", "amperes": "A", "milliamp": "mA", "milliamps": "mA",
    "ohms": "ohm", "Ohms": "ohm", "henry": "H", "henries": "H",
    "meter": "m", "metre": "m", "meters": "m", "metres": "m",
    "foot": "ft", "feet": "ft", "inches": "inch", "gram": "g", "grams": "g", "kilogram": "kg", "kilograms": "kg",
    "newton": "N", "newtons": "N", "watt": "W", "watts": "W", "joule": "J", "joules": "J",
    "radian": "rad", "radians": "rad", "degree": "deg", "degrees": "deg", "°": "deg",
    "turn": "rev", "turns": "rev", "revs": "rev", "rotation": "rev", "rotations": "rev",
    "revolution": "rev", "revolutions": "rev", "r": "rev", "rot": "rev", "cycle": "rev", "cycles": "rev",
    "counts": "count", "ticks": "count", "tick": "count", "pulse": "count", "pulses": "count",
    "step": "count", "steps": "count", "increments": "count",
    "RPM": "rpm", "hz": "Hz", "hertz": "Hz", "Hertz": "Hz", "percent": "%",
}  # fmt: skip
_BEHIND_A_NUMBER = {"in": "inch"}  # by itself it ends too many names that aren't lengths
_AS_SHOWN = ("counts", "°")  # other names that are written wherever a unit is shown
_SHORT = {"dps": "deg/s", "rps": "rev/s"}
_OF_THE_FIELD = {
    "U/min": "rpm", "Umdr/min": "rpm",  # German: U alone is a voltage's symbol, and no unit
    "in/s": "inch/s", "in/sec": "inch/s", "in/second": "inch/s", "in/min": "inch/min",  # by itself `in` is a word
    "1/min": "rpm", "min^-1": "rpm", "min-1": "rpm", "min⁻¹": "rpm",  # ISO 80000: a rotational frequency, with the turn left out
}  # fmt: skip
_LONGEST = 80  # characters; no unit needs more, and a longer text must not cost time or depth
_SPELLINGS = str.maketrans(
    {"µ": "u", "μ": "u", "\u2126": "Ω"}
)  # micro sign, Greek mu; ohm sign to Greek omega
_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_TOKEN = re.compile(
    r"\s*(?:(?P<root>√|sqrt)|(?P<name>[A-Za-zΩ°]+|%|1(?![0-9]))|(?P<power>(?:\^|\*\*)-?[0-9]+)|(?P<mark>[*·⋅×./()]))"
)
_QUANTITY = re.compile(
    r"\s*(?P<number>[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*(?P<unit>.*?)\s*"
)

_QUANTITIES: dict[Dimension, str] = {
    _dimension(s=1): "time",
    _dimension(kg=1, m=2, s=-3, A=-1): "voltage",
    _dimension(A=1): "current",
    _dimension(percent=1): "duty",
    _dimension(angle=1): "position",
    _dimension(m=1): "position",
    _dimension(count=1): "position",
    _dimension(angle=1, s=-1): "speed",
    _dimension(m=1, s=-1): "speed",
    _dimension(count=1, s=-1): "speed",
    _dimension(kg=1, m=2, s=-2): "torque",
    _dimension(kg=1, m=1, s=-2): "force",
}
_SI_SYMBOLS: dict[Dimension, str] = {
    _dimension(s=1): "s",
    _dimension(kg=1, m=2, s=-3, A=-1): "V",
    _dimension(A=1): "A",
    _dimension(percent=1): "%",
    _dimension(angle=1): "rad",
    _dimension(m=1): "m",
    _dimension(count=1): "counts",
    _dimension(angle=1, s=-1): "rad/s",
    _dimension(m=1, s=-1): "m/s",
    _dimension(count=1, s=-1): "counts/s",
    _dimension(kg=1, m=2, s=-2): "N·m",
    _dimension(kg=1, m=1, s=-2): "N",
}


@dataclass(frozen=True)
class Unit:
    """A unit: a value in it times `factor` is the value in SI units.

    `quantity` is what it measures (`position`, `speed`, `voltage`, `time`, `current`, `duty`, `torque`, `force`)
    or `other`; `si` is the symbol of the SI unit of that quantity. Counts and per cent have no SI unit and stay.
    """

    symbol: str
    factor: float
    dimension: Dimension
    """Exponents of the base quantities."""
    radians: bool = True
    """Whether the unit contains no angle, or only the radian."""

    @property
    def quantity(self) -> str:
        """The quantity that the unit measures."""
        return _QUANTITIES.get(self.dimension, "other")

    @property
    def si(self) -> str:
        """The symbol of the SI unit of the same quantity, put together from base units where it has no name."""
        if self.dimension in _SI_SYMBOLS:
            return _SI_SYMBOLS[self.dimension]
        return self.symbol if self.factor == 1 else _in_base_units(self.dimension)


@cache
def unit(text: str) -> Unit:
    """Return the unit that a text names, such as `deg/s`, `mH`, `g*cm^2` or `N·m/√Hz`.

    Raises `UnitError` where the text is no unit.
    """
    if len(text) > _LONGEST:
        raise UnitError(f"{text[:20]!r}... isn't a unit: it has {len(text)} characters")
    parser = _Parser(_OF_THE_FIELD.get(text.strip(), text))
    factor, dimension = parser.whole()
    return Unit(symbol=text.strip(), factor=factor, dimension=dimension, radians=parser.radians)


def is_unit(text: str) -> bool:
    """Return whether a text names a unit."""
    try:
        unit(text)
    except UnitError:
        return False
    return True


def in_symbols(text: str) -> str:
    """Return a unit's text with a symbol in place of each word or abbreviation of a file's heading: `ms` for `msec`."""
    return re.sub(
        r"[A-Za-zΩ°]+",
        lambda word: word[0] if word[0] in _AS_SHOWN else _ALIASES.get(word[0], word[0]),
        text,
    )


def convert(value: float, from_unit: str, to_unit: str) -> float:
    """Return a value given in one unit in another unit of the same quantity.

    Between decimal multiples the point is shifted, so that 9 ms are 0.009 s to the last digit.
    Raises `UnitError` where the two measure different quantities.

    >>> convert(9, "ms", "s")
    0.009
    """
    source, target = unit(from_unit), unit(to_unit)
    if not _compatible(source, target):
        raise UnitError(f"{from_unit!r} can't be converted to {to_unit!r}: they measure different quantities")
    ratio = source.factor / target.factor
    exponent = round(math.log10(ratio))
    # A product of a few rounded factors is off by some 1e-15; no two of our units differ by a factor this near to a power of ten.
    if math.isclose(ratio, 10.0**exponent, rel_tol=1e-12):
        return float(Decimal(repr(float(value))).scaleb(exponent))
    return value * ratio


def quantity(value: object, si: str) -> float:
    """Return a quantity in the unit `si`; a text has its own unit (`"1.16 mH"`), a bare number is in `si` already.

    Raises `UnitError` where it isn't a number with a unit, a quantity of another kind, or too large.

    >>> quantity("1.16 mH", "H")
    0.00116
    """
    expected = f'expected something in {si} (for example "1 {si}")'
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            raise UnitError(f"a whole number of {len(str(value))} digits is too large; {expected}") from None
    match = _QUANTITY.fullmatch(str(value))
    if not match:
        raise UnitError(f"{value!r} isn't a number with a unit; {expected}")
    symbol = _BEHIND_A_NUMBER.get(match["unit"], match["unit"])
    if re.match(r",\d", symbol):
        raise UnitError(f"{value!r} has a comma; write a decimal point, {expected}")
    try:
        number = convert(float(match["number"]), symbol, si) if symbol else float(match["number"])
    except UnitError as error:
        raise UnitError(f"{value!r}{_why_not(symbol, error)}; {expected}") from None
    if not math.isfinite(number):
        raise UnitError(f"{value!r} is too large; {expected}")
    return number


def _why_not(symbol: str, error: UnitError) -> str:
    """The reason why a quantity with this unit isn't of the expected kind, as the middle of a sentence."""
    if not is_unit(symbol):
        return f": {error}"
    what = "frequency" if symbol.endswith("Hz") else unit(symbol).quantity
    return f" is a {what}" if what != "other" else ": the unit measures something else"


def _in_base_units(dimension: Dimension) -> str:
    """A dimension as a product of powers of base units."""
    bases = zip(("kg", "m", "s", "A", "rad", "counts", "%"), dimension, strict=True)
    parts = [symbol if power == 1 else f"{symbol}^{power:g}" for symbol, power in bases if power]
    return "·".join(parts) or "1"


def _compatible(a: Unit, b: Unit) -> bool:
    """Whether two units measure the same thing; only a plain radian may be missing on one side."""
    if a.dimension == b.dimension:
        return True
    without_angle = [tuple(p for i, p in enumerate(u.dimension) if i != 4) for u in (a, b)]
    return without_angle[0] == without_angle[1] and a.radians and b.radians and any(without_angle[0])


class _Parser:
    """Reads one unit text: factors joined by `*`, `·`, `.`, a space, `/` or "per", with powers, roots and parentheses."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.radians = True
        self.tokens: list[tuple[str, str]] = []
        rest = re.sub(r"\bper\b", "/", text.strip().translate(_SPELLINGS))
        rest = re.sub(r"[⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+", lambda m: "^" + m[0].translate(_SUPERSCRIPTS), rest)
        rest = re.sub(r"(?<=[A-Za-zΩ])-?[0-9]+", lambda m: "^" + m[0], rest)
        while rest:
            match = _TOKEN.match(rest)
            if not match or match.lastgroup is None:
                raise UnitError(f"{text!r} isn't a unit: {rest!r} isn't understood")
            self.tokens.append((match.lastgroup, match[match.lastgroup]))
            rest = rest[match.end() :].lstrip()
        self.position = 0

    def whole(self) -> tuple[float, Dimension]:
        """The whole text; nothing may be left over."""
        if not self.tokens:
            raise UnitError(f"{self.text!r} isn't a unit: it is empty")
        result = self._product()
        if self.position != len(self.tokens):
            raise UnitError(f"{self.text!r} isn't a unit: {self.tokens[self.position][1]!r} is out of place")
        return result

    def _peek(self) -> tuple[str, str]:
        return self.tokens[self.position] if self.position < len(self.tokens) else ("end", "")

    def _take(self) -> tuple[str, str]:
        token = self._peek()
        self.position += 1
        return token

    def _product(self) -> tuple[float, Dimension]:
        factor, dimension = self._power()
        while True:
            kind, mark = self._peek()
            if kind == "mark" and mark in "*·⋅×./":
                self._take()
                sign = -1.0 if mark == "/" else 1.0
            elif kind in {"name", "root"}:
                sign = 1.0
            else:
                return factor, dimension
            other, powers = self._power()
            factor *= other**sign
            dimension = tuple(a + sign * b for a, b in zip(dimension, powers, strict=True))

    def _power(self) -> tuple[float, Dimension]:
        kind, value = self._take()
        if kind == "root":
            factor, dimension = self._power()
            return math.sqrt(factor), tuple(p / 2 for p in dimension)
        if kind == "name":
            factor, dimension = self._parse_name(value)
        elif value == "(":
            factor, dimension = self._product()
            if self._take()[1] != ")":
                raise UnitError(f"{self.text!r} isn't a unit: a parenthesis isn't closed")
        else:
            raise UnitError(f"{self.text!r} isn't a unit: a name is missing")
        if self._peek()[0] == "power":
            exponent = int(self._take()[1].lstrip("^*"))
            if abs(exponent) > 9:
                raise UnitError(f"{self.text!r} isn't a unit: a power of {exponent} measures nothing")
            return factor**exponent, tuple(p * exponent for p in dimension)
        return factor, dimension

    def _parse_name(self, name: str) -> tuple[float, Dimension]:
        """One name with its prefix, as factor and dimension."""
        if name in _SHORT:
            self.radians = False
            return _Parser(_SHORT[name]).whole()
        base, scale = _ALIASES.get(name, name), 1.0
        if base not in _PLAIN and base not in _PREFIXED:
            if base[0] not in _PREFIXES or base[1:] not in _PREFIXED:
                raise self._unknown(name)
            base, scale = base[1:], _PREFIXES[base[0]]
        factor, dimension = _PLAIN[base] if base in _PLAIN else _PREFIXED[base]
        if dimension[4] and base != "rad":
            self.radians = False
        return scale * factor, dimension

    def _unknown(self, name: str) -> UnitError:
        near = get_close_matches(name, [*_PREFIXED, *_PLAIN, *_ALIASES], n=1)
        hint = f" (did you mean {near[0]!r}?)" if near else ""
        return UnitError(f"{name!r} in {self.text!r} isn't a known unit{hint}")
