"""Numbers for people: rounded to the known digits, with a unit of a suitable size."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

SPACE = "\u00a0"  # one that no line breaks at
TWO_SIDED = 1.959964  # standard deviations of a normal distribution on each side of a 95 % interval
_LARGEST = 7  # digits before the point, or zeros behind it, that are still read at a glance
_MOST_DIGITS = 12
_UNEVEN = 0.1  # of half an interval: a value further than that from the middle isn't the value ± half
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
# SI prefixes are for units that take one as they stand; a number in any other unit gets a power of ten.
_PREFIXED = {"s", "V", "A", "N", "m", "rad", "Hz", "rad/s", "m/s"}
_PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M"}


@dataclass(frozen=True, kw_only=True)
class Rounded:
    """A value and half of its interval, as texts with the same number of decimals.

    `half` is empty where the interval isn't known, or lies unevenly about the value. `low` and `high` are the ends of the
    interval, empty where it isn't known; all have the same unit.
    """

    value: str
    half: str
    low: str
    high: str
    unit: str

    def __str__(self) -> str:
        plus_minus = f"{SPACE}±{SPACE}{self.half}" if self.half else ""
        number = (
            f"({self.value}{plus_minus})"
            if plus_minus and self.unit.startswith("×")
            else self.value + plus_minus
        )
        if self.low and not self.half:
            number = f"{self.value} ({self.low} to {self.high})"
        return f"{number}{SPACE}{self.unit}".rstrip()


def plain(value: float, digits: int = 4) -> str:
    """Return a number with that many significant digits at the most, such as `0.09253`, `−1749` or `1.2×10⁻⁹`."""
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else ("∞" if value > 0 else "−∞")
    if value == 0:
        return "0"
    exponent = _exponent(value, digits)
    if -5 <= exponent < max(_LARGEST, digits):
        text = f"{value:.{max(digits - 1 - exponent, 0)}f}"
        return _minus(text.rstrip("0").rstrip(".") if "." in text else text)
    mantissa = f"{value:.{digits - 1}e}".partition("e")[
        0
    ]  # a division would overflow, or underflow, at a float's ends
    mantissa = mantissa.rstrip("0").rstrip(".") if "." in mantissa else mantissa
    return f"{_minus(mantissa)}×{power_of_ten(exponent)}"


def microseconds(time: float) -> str:
    """Return a time [s] in µs, with three digits at most and none below a nanosecond: no clock of a computer shows less."""
    return plain(round(1e6 * time, 3), 3)


def milliseconds(time: float) -> str:
    """Return a time [s] in ms, with three digits at most and none below a nanosecond."""
    return plain(round(1e3 * time, 6), 3)


def with_unit(value: float, unit: str, digits: int = 4) -> str:
    """Return a number with its unit, prefixed where that makes it handier: 0.00014 s are `0.14 ms`."""
    factor, scaled = handy_unit(unit, abs(value))
    return f"{plain(value / factor, digits)}{SPACE}{scaled}".rstrip()


def round_value(value: float, half: float, unit: str) -> Rounded:
    """Return a value with half of its interval, both rounded to two significant digits of the latter.

    Without a known interval (infinite or NaN) the value has four significant digits, with one of zero width six.
    No number has more than twelve digits.
    """
    factor, scaled = handy_unit(unit, max(abs(value), half if math.isfinite(half) else 0.0))
    x, h = value / factor, half / factor
    if not (math.isfinite(h) and math.isfinite(x)):
        return Rounded(value=plain(x), half="", low="", high="", unit=scaled)
    if h <= 0:
        return Rounded(value=plain(x, 6), half="0", low=plain(x, 6), high=plain(x, 6), unit=scaled)
    decimals = min(1 - _exponent(h, 2), _MOST_DIGITS - _exponent(max(abs(x), h), 2))
    texts = [_fixed_point(number, decimals) for number in (x, h, x - h, x + h)]
    return Rounded(value=texts[0], half=texts[1], low=texts[2], high=texts[3], unit=scaled)


def rounded_interval(value: float, interval: tuple[float, float], unit: str) -> Rounded:
    """Return a value with its interval, in one unit: with half of it where it lies evenly about the value, or else its ends.

    Beside an uneven interval the value has at least two significant digits.
    """
    low, high = interval
    half = 0.5 * (high - low)
    rounded = round_value(value, half, unit)
    if not rounded.half or half <= 0:
        return rounded
    factor, scaled = handy_unit(unit, max(abs(value), half))
    decimals = min(
        1 - _exponent(half / factor, 2), _MOST_DIGITS - _exponent(max(abs(value), half) / factor, 2)
    )
    rounded = replace(
        rounded,
        low=_fixed_point(low / factor, decimals),
        high=_fixed_point(high / factor, decimals),
        unit=scaled,
    )
    if abs(value - 0.5 * (low + high)) <= _UNEVEN * half:
        return rounded
    enough = max(decimals, 1 - _exponent(value / factor, 2)) if value else decimals
    # An end that is rounded past the value would leave it out.
    ends = [
        _fixed_point(end, enough if (round(end, decimals) - value / factor) * side < 0 else decimals)
        for end, side in ((low / factor, -1.0), (high / factor, 1.0))
    ]
    return replace(rounded, value=_fixed_point(value / factor, enough), half="", low=ends[0], high=ends[1])


def as_known(value: float, half: float) -> float:
    """Return a value to two digits of the half of its interval, and to two of its own at least; as it is without an interval."""
    if not (math.isfinite(half) and half > _TINIEST and abs(value) > _TINIEST):
        return value
    return round(value, 1 - min(_exponent(half, 2), _exponent(value, 2)))


_TINIEST = 1e-300  # below this a power of ten is no float any more


def handy_unit(unit: str, largest: float) -> tuple[float, str]:
    """Return a factor and a unit, so that a value divided by the factor is in that unit and neither tiny nor huge.

    Values from 0.1 to a million stay as they are, and from 0.01 where the unit takes no prefix. A mere number has no unit.
    """
    unit = "" if unit == "1" else unit
    smallest = 0.1 if unit in _PREFIXED else 0.01
    if not (math.isfinite(largest) and largest > _TINIEST) or smallest <= largest < 1e6:
        return 1.0, unit
    power = 3 * math.floor(math.log10(largest) / 3)
    if largest < 1 and largest / 10.0**power >= 100:
        power += 3  # 0.14 ms rather than 144 µs
    if unit in _PREFIXED and power in _PREFIXES:
        return 10.0**power, f"{_PREFIXES[power]}{unit}"
    if power == 0:
        return 1.0, unit
    return 10.0**power, f"×{power_of_ten(power)} {unit}".rstrip()


def percent(value: float) -> str:
    """Return a percentage with one decimal or, so that 99.998 doesn't become 100, as many as what is missing to 100 asks for."""
    missing = 100 - value
    if not math.isfinite(value) or missing <= 0:
        return plain(value)
    return _fixed_point(value, min(max(1 - _exponent(missing, 2), 1), 9))


def share_explained(value: float) -> str:
    """Return how little a simulation explains [%], in words: below zero the output's mean predicts better."""
    return f"only {value:.0f} %" if round(value) > 0 else "nothing"


SAME = "either way"  # of two values that their digits don't tell apart


def instead_of(first: float, second: float, digits: int = 4, unit: str = "") -> str:
    """Return `22.21 rad/s instead of 21.9 rad/s`, or `22.21 rad/s either way` where so many digits don't tell them apart."""
    texts = [f"{plain(value, digits)} {unit}".rstrip() for value in (first, second)]
    return f"{texts[0]} {SAME}" if texts[0] == texts[1] else " instead of ".join(texts)


def change_text(value: float, usual: float) -> str:
    """Return `18 % smaller`, `2.5 times as large`, `25 times smaller`, `the same` or `of the other sign`: one beside another."""
    ratio = value / usual if usual else 0.0
    if not ratio > 0:
        return "of the other sign"
    if ratio >= 100:
        return "more than a hundred times as large"
    if ratio >= 2:
        return f"{plain(ratio, 2)} times as large"
    if ratio <= 0.01:
        return "more than a hundred times smaller"
    if ratio < 0.1:
        return f"{plain(1 / ratio, 2)} times smaller"
    percent = 100 * abs(ratio - 1)
    return f"{plain(percent, 2)} % {'larger' if ratio > 1 else 'smaller'}" if percent >= 0.001 else "the same"


def power_of_ten(exponent: int) -> str:
    """Return `10⁻⁶` for -6."""
    return f"10{str(exponent).translate(_SUPERSCRIPTS)}"


def count_text(number: int, singular: str, plural: str = "") -> str:
    """Return `1 sample`, `5 000 samples`, with thin spaces between thousands."""
    return f"{group_digits(number)} {singular if number == 1 else plural or singular + 's'}"


def group_digits(number: int) -> str:
    """Return a whole number with thin spaces between thousands, from five digits on."""
    return _minus(f"{number:,}".replace(",", "\u202f") if abs(number) >= 10_000 else str(number))


def _exponent(value: float, digits: int) -> int:
    """The power of ten of the first digit, after rounding to that many."""
    return int(f"{value:.{digits - 1}e}".partition("e")[2])


def _fixed_point(value: float, decimals: int) -> str:
    text = f"{round(value, decimals):.{max(decimals, 0)}f}"
    return _minus("0" if text.strip("-0.") == "" and decimals <= 0 else text)


def _minus(text: str) -> str:
    """The same with a real minus sign, and none before a zero."""
    return text.removeprefix("-") if not text.strip("-0.") else text.replace("-", "−")
