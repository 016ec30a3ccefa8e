"""Units: SI inside; other units at the edges only.

A unit is a product of powers of base units: `rad/s`, `kg·m²`, `g*cm^2`, `N·m/√Hz`, `counts/rev`.
Angle is kept as a dimension of its own, so that a position, a speed and a frequency can be told apart,
and `Hz` is one revolution per second: a cut-off of `8 Hz` read in `rad/s` is 50.3.
The radian alone may be left out, as SI allows (`N·m/A` is `V·s/rad`).
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cache

from servobench.errors import UnitError

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
}
_PLAIN: dict[str, tuple[float, Dimension]] = {
    "1": (1.0, _NONE),
    "deg": (math.pi / 180, _dimension(angle=1)),
    "rev": (2 * math.pi, _dimension(angle=1)),
    "count": (1.0, _dimension(count=1)),
    "rpm": (2 * math.pi / 60, _dimension(s=-1, angle=1)),
    "min": (60.0, _dimension(s=1)),
    "h": (3600.0, _dimension(s=1)),
    "%": (1.0, _dimension(percent=1)),
}
_PREFIXES = {"p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 1e-1, "k": 1e3, "M": 1e6, "": 1.0}
_ALIASES = {
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "millisecond": "ms", "milliseconds": "ms",
    "msec": "ms", "microseconds": "us", "usec": "us", "minutes": "min",
    "volt": "V", "volts": "V", "Volt": "V", "Volts": "V", "v": "V", "amp": "A", "amps": "A", "ampere": "A",
    "Ohm": "ohm", "\u03a9": "ohm", "\u2126": "ohm", "henry": "H", "meter": "m", "metre": "m", "meters": "m", "metres": "m",
    "radian": "rad", "radians": "rad", "degree": "deg", "degrees": "deg", "°": "deg",
    "turn": "rev", "turns": "rev", "revs": "rev", "rotation": "rev", "rotations": "rev",
    "revolution": "rev", "revolutions": "rev", "r": "rev", "rot": "rev", "cycle": "rev", "cycles": "rev",
    "counts": "count", "ticks": "count", "tick": "count", "pulses": "count",
    "RPM": "rpm", "hz": "Hz", "percent": "%", "dps": "deg/s", "Nm": "N·m", "mNm": "mN·m", "rps": "rev/s",
}  # fmt: skip
_SUPERSCRIPTS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_TOKEN = re.compile(r"\s*(?:(?P<root>√|sqrt)|(?P<name>[A-Za-zµμΩΩ°%]+|1)|(?P<power>(?:\^|\*\*)-?\d+)|(?P<mark>[*·⋅×/()]))")

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

    @property
    def quantity(self) -> str:
        """What the unit measures."""
        return _QUANTITIES.get(self.dimension, "other")

    @property
    def si(self) -> str:
        """The symbol of the SI unit of the same quantity; the unit's own symbol where there is no name for it."""
        return _SI_SYMBOLS.get(self.dimension, self.symbol)


@cache
def unit(text: str) -> Unit:
    """Return the unit that a text names, such as `deg/s`, `mH`, `g*cm^2` or `N·m/√Hz`.

    Raises `UnitError` where the text is no unit.
    """
    factor, dimension = _Parser(text).whole()
    return Unit(symbol=text.strip(), factor=factor, dimension=dimension)


def is_unit(text: str) -> bool:
    """Return whether a text names a unit."""
    try:
        unit(text)
    except UnitError:
        return False
    return True


def convert(value: float, from_unit: str, to_unit: str) -> float:
    """Return a value given in one unit in another unit of the same quantity.

    Raises `UnitError` where the two measure different things.
    """
    source, target = unit(from_unit), unit(to_unit)
    if not _compatible(source, target):
        raise UnitError(f"{from_unit!r} can't be turned into {to_unit!r}: they measure different things")
    return value * source.factor / target.factor


def quantity(given: float | str, si: str) -> float:
    """Return a quantity in the unit `si`; a text has its own unit (`"1.16 mH"`), a bare number is in `si` already.

    Raises `UnitError` where the text is no number with a unit, or a quantity of another kind.
    """
    if isinstance(given, int | float) and not isinstance(given, bool):
        return float(given)
    match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", str(given))
    example = f'for example "1 {si}"'
    if not match:
        raise UnitError(f"{given!r} is no number with a unit; expected something in {si} ({example})")
    number, symbol = float(match[1]), match[2]
    if not symbol:
        return number
    try:
        return convert(number, symbol, si)
    except UnitError as error:
        if not is_unit(symbol):
            raise UnitError(f"{given!r}: {error}; expected something in {si} ({example})") from None
        what = unit(symbol).quantity
        kind = f" is a {what}" if what != "other" else ""
        raise UnitError(f"{given!r}{kind}; expected something in {si} ({example})") from None


def _compatible(a: Unit, b: Unit) -> bool:
    """Whether two units measure the same thing; only a plain radian may be missing on one side."""
    if a.dimension == b.dimension:
        return True
    without_angle = [tuple(p for i, p in enumerate(u.dimension) if i != 4) for u in (a, b)]
    radians_only = not any(re.search(r"Hz|hz|rev|rot|turn|cyc|deg|°|rpm|RPM|dps|rps", u.symbol) for u in (a, b))
    return without_angle[0] == without_angle[1] and radians_only and any(without_angle[0])


def _named(name: str, text: str) -> tuple[float, Dimension]:
    """One name with its prefix, as factor and dimension."""
    name = name.replace("µ", "u").replace("μ", "u")
    name = _ALIASES.get(name, name)
    if not name.isalpha() and name not in _PLAIN and name != "%":
        return _Parser(name).whole()
    if name in _PLAIN:
        return _PLAIN[name]
    if name in _PREFIXED:
        return _PREFIXED[name]
    for prefix, scale in _PREFIXES.items():
        if prefix and name.startswith(prefix) and name[len(prefix) :] in _PREFIXED:
            factor, dimension = _PREFIXED[name[len(prefix) :]]
            return scale * factor, dimension
    near = get_close_matches(name, [*_PREFIXED, *_PLAIN, *_ALIASES], n=1)
    hint = f" (did you mean {near[0]!r}?)" if near else ""
    raise UnitError(f"{name!r} in {text!r} is no unit that is known here{hint}")


class _Parser:
    """Reads one unit text: factors joined by `*`, `·` or `/`, powers, roots and parentheses, left to right."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens: list[tuple[str, str]] = []
        rest = re.sub(r"([⁰¹²³⁴⁵⁶⁷⁸⁹⁻]+)", lambda m: "^" + m[1].translate(_SUPERSCRIPTS), text.strip())
        rest = re.sub(r"(?<=[A-Za-zΩ])(\d)$|(?<=[A-Za-zΩ])(\d)(?=[*·/)])", lambda m: "^" + (m[1] or m[2]), rest)
        while rest:
            match = _TOKEN.match(rest)
            if not match or match.lastgroup is None:
                raise UnitError(f"{text!r} is no unit: {rest!r} isn't understood")
            self.tokens.append((match.lastgroup, match[match.lastgroup]))
            rest = rest[match.end() :].lstrip()
        self.position = 0

    def whole(self) -> tuple[float, Dimension]:
        """The whole text; nothing may be left over."""
        if not self.tokens:
            raise UnitError(f"{self.text!r} is no unit: it is empty")
        result = self._product()
        if self.position != len(self.tokens):
            raise UnitError(f"{self.text!r} is no unit: {self.tokens[self.position][1]!r} is out of place")
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
            if kind == "mark" and mark in "*·⋅×/":
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
            factor, dimension = _named(value, self.text)
        elif value == "(":
            factor, dimension = self._product()
            if self._take()[1] != ")":
                raise UnitError(f"{self.text!r} is no unit: a parenthesis isn't closed")
        else:
            raise UnitError(f"{self.text!r} is no unit: a name is missing")
        if self._peek()[0] == "power":
            exponent = int(self._take()[1].lstrip("^*"))
            return factor**exponent, tuple(p * exponent for p in dimension)
        return factor, dimension
