"""The units that a column's name and its values suggest, and those that they contradict."""

from __future__ import annotations

import re

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.core.rounding import plain
from servobench.core.units import is_unit, unit
from servobench.recordings.formats.columns import heading
from servobench.recordings.formats.epoch import epoch_unit
from servobench.recordings.formats.roles import CAPITAL, Role, quantity_of, shell_text
from servobench.recordings.recording import Series

LARGEST_SUPPLY = 60.0
"""The voltage [V] up to which whole numbers are taken as volts without a doubt.

Beyond it they are more often the raw counts of a pulse-width modulator, which are always whole. Motors of 90 V and more exist,
but their voltage is measured, or computed by a controller, and has decimals.
"""

_DUTY_WORDS = frozenset({"pwm", "duty", "dutycycle", "power", "pwr", "throttle"})
_VOLTAGE_WORDS = frozenset({
    "v", "mv", "volt", "volts", "voltage", "millivolts", "spannung", "tension", "supply", "battery", "vbat", "vbus", "bus",
})  # fmt: skip
_FULL_SCALES = (255, 1023, 4095, 65535)  # of 8, 10, 12 and 16 bits
_DYNAMIXEL = 885  # the full scale of `goal_pwm` and `present_pwm`
_ELECTRICAL = re.compile(r"(?:^|[^a-z])e_?rpm(?:[^a-z]|$)")
_COUNT_WORDS = frozenset({"count", "counts", "tick", "ticks", "pulse", "pulses", "steps"})
_RATE_WORDS = frozenset(
    {"s", "sec", "second", "per", "rate", "speed", "velocity", "vel", "freq", "frequency", "hz"}
)
_SEVERAL = 3  # sizes: two have a common factor by chance
_SERVO_PULSES = (700.0, 2300.0)  # us: 1000 to 2000, and what some servos take beyond
_DEFAULT: dict[Role, tuple[str, ...]] = {
    "input": ("V",),
    "output": ("deg", "deg/s"),
    "reference": ("deg",),
    "supply": ("V",),
    "current": ("A",),
}

# What a wrong unit of each makes wrong.
_FIGURES = {
    "input": ("gain", "coulomb_voltage"),
    "output": ("gain",),
    "supply": ("gain", "coulomb_voltage"),
    "time": ("gain", "time_constant", "delay"),
}


def unit_examples(role: Role, series: Series) -> str:
    """Return units that a column without one may have, each as it has to be said, as the end of a sentence."""
    name, values = series.channel.name, _finite(series.values)
    if role == "input" and (is_duty_name(name) or (_are_whole(values) and _largest(values) > LARGEST_SUPPLY)):
        return f"{_duty_examples(name, values)}; give its supply as `supply=...`"
    symbols = " or ".join(shell_text(f"{name}:{symbol}") for symbol in _DEFAULT[role])
    if role == "output" and _are_whole(values):
        new = (
            " (and `chain=accumulate` if each row holds the counts since the row before)"
            if _words(name) & _COUNT_WORDS
            else ""
        )
        return f"{shell_text(f'{name}:counts')} with `counts_per_rev=...`{new}, or {symbols}"
    return symbols


def _duty_examples(name: str, values: Array) -> str:
    """The units of a duty that fit its values."""
    largest = _largest(values)
    percent = shell_text(f"{name}:%")
    if heading(name).unit == "%":
        return percent
    if largest <= 1.0:
        return f"{shell_text(f'{name}:1')} (a fraction) or {percent}"
    if not _are_whole(values):
        return percent
    scale = next((each for each in _FULL_SCALES if largest <= each), round(largest))
    if largest <= _DYNAMIXEL and {"goal", "present"} & _words(name):
        scale = _DYNAMIXEL
    counts = f"{shell_text(f'{name}:PWM/{scale}')} (raw counts, if {scale} is 100 %)"
    return f"{counts} or {percent}" if largest <= 100.0 else counts


def is_duty_name(name: str) -> bool:
    """Return whether a name is that of a duty, as `motor_pwm` is; `pwm_voltage` and `power_supply` are those of voltages."""
    words = _words(name)
    return bool(words & _DUTY_WORDS) and not words & _VOLTAGE_WORDS


def about_input_unit(series: Series, from_file: bool) -> list[Finding]:
    """Return a doubt of an input whose name or values contradict its unit.

    `from_file` says that the unit stands in the file, which is then right about the name.
    """
    name, symbol, values = series.channel.name, series.channel.unit, _finite(series.values)
    if quantity_of(symbol) == "voltage" and not from_file and is_duty_name(name):
        sentence = (
            f"`{name}` is named like a duty cycle but read in {symbol}, so the gain may be off by any factor. Say what it "
            f"is, such as {_duty_examples(name, values)}, with `supply=...`; or write V beside its name in the file if it holds "
            "volts."
        )
        return [warning("unit-contradicted", sentence, parameters=("gain", "coulomb_voltage"))]
    if symbol == "%" and 0.0 < _largest(values) <= 1.0 and not _are_whole(values):
        sentence = (
            f"`{name}` is read in %, but never exceeds {plain(_largest(values), 3)} %, which moves no motor. "
            f"If it is a fraction, with 1 for 100 %, say `input={shell_text(f'{name}:1')}`."
        )
        return [warning("unit-contradicted", sentence, parameters=("gain", "coulomb_voltage"))]
    return []


def about_full_scale(series: Series, scale: float) -> list[Finding]:
    """Return a doubt of a duty whose name ends in per cent, where it was said to be raw counts with `scale` counts for 100 %."""
    name = series.channel.name
    named = heading(name)
    if not named.from_name or named.unit != "%" or scale == 100.0:
        return []
    sentence = (
        f"`{name}` is read in counts of which {plain(scale)} are 100 %, as requested, but its name says %: one of the two is "
        f"wrong, by a factor of {plain(max(scale / 100.0, 100.0 / scale))}. Say `input={shell_text(f'{name}:%')}`, or rename the "
        "column if that is wrong."
    )
    return [warning("unit-contradicted", sentence, parameters=_FIGURES["input"])]


def about_stated_unit(series: Series, symbol: str, role: str) -> list[Finding]:
    """Return what is to be known of a unit said for a channel with another one: a doubt where its name ends in that.

    `role` is a `Role`, or `time`. Without a doubt there is nothing to be known of the same unit under another name.
    """
    name, own = series.channel.name, series.channel.unit
    if own is None or _is_the_same(own, symbol):
        return []
    named = heading(name)
    is_doubted = (
        role in _FIGURES
        and named.from_name
        and named.unit == own
        and unit(own).dimension == unit(symbol).dimension
        and not (role == "time" and epoch_unit(series.values) == symbol)
    )
    if not is_doubted:
        return [info("unit-overridden", f"`{name}` is read in {symbol} instead of {own}, as requested.")]
    figures, factor = _FIGURES[role], unit(symbol).factor / unit(own).factor
    sentence = (
        f"`{name}` is read in {symbol}, as requested, but its name says {own}: one of the two is wrong, by a factor of "
        f"{plain(max(factor, 1 / factor))}. Say `{role}={shell_text(f'{name}:{own}')}`, or rename the column if that is wrong."
    )
    return [warning("unit-contradicted", sentence, parameters=figures)]


def _is_the_same(one: str, other: str) -> bool:
    """Whether two units are the same under two names, as counts and steps are."""
    if not (is_unit(one) and is_unit(other)):
        return one == other
    return (unit(one).factor, unit(one).dimension) == (unit(other).factor, unit(other).dimension)


def about_output_unit(series: Series) -> list[Finding]:
    """Return a doubt of a speed that is electrical by its name, or counts in each row, and so isn't the shaft's."""
    if quantity_of(series.channel.unit) != "speed":
        return []
    name = series.channel.name
    if _ELECTRICAL.search(CAPITAL.sub("_", name).lower()) is not None:
        sentence = (
            f"By its name `{name}` is an electrical speed, the shaft's times the number of pole pairs, so the gain is too large "
            "by that number. Say `chain=scale N` with N pole pairs, or `chain=scale 1` if it is the shaft's speed."
        )
        return [warning("unit-contradicted", sentence, parameters=("gain",))]
    if series.channel.unit != "counts/s":
        return []
    words = _words(name)
    if words & _COUNT_WORDS and not words & _RATE_WORDS:
        what = f"`{name}` is named like a count but read in counts/s"
    elif _may_be_counts_of_rows(series):
        what = f"`{name}` holds whole numbers read in counts/s, by which less than a count would pass in each row"
    else:
        return []
    sentence = (
        f"{what}, so the gain may be off by any factor. If each row holds the counts since the row before, say "
        f"`output={shell_text(f'{name}:counts')}` and `chain=accumulate`, or `chain=scale 1` if it is counts/s."
    )
    return [warning("unit-contradicted", sentence, parameters=("gain",))]


def _may_be_counts_of_rows(series: Series) -> bool:
    """Whether whole numbers of counts/s are as good as none in a row: counting shows no such speed, whole or not.

    Several multiples of a number are counts over the time of a row, or of a few, and not counts.
    """
    t, values = series.t, _finite(series.values)
    if t is None or len(t) < 2 or not _are_whole(values):
        return False
    sizes = np.unique(np.abs(np.rint(values).astype(np.int64)))
    if np.count_nonzero(sizes) >= _SEVERAL and np.gcd.reduce(sizes) > 1:
        return False
    return _largest(values) * float(np.median(np.diff(t))) < 1.0 < _largest(values)


def pulse_remedy(series: Series) -> str:
    """Return what to do with an input that is a time, as the width of a pulse is, as a sentence."""
    name = series.channel.name
    values = _finite(series.values) * unit(series.channel.unit or "us").factor * 1e6
    if len(values) and _SERVO_PULSES[0] <= values.min() and values.max() <= _SERVO_PULSES[1]:
        return (
            "These look like servo pulses, 1000 to 2000 us with 1500 us for standstill: write (pulse - 1500)/500 into the file, "
            f"and say `input={shell_text(f'{name}:1')}`"
        )
    return (
        "If it is a pulse width, say what 100 % is, such as "
        f"`input={shell_text(f'{name}:PWM/20000')}` for 20000 {series.channel.unit}"
    )


def _finite(values: Array) -> Array:
    values = np.asarray(values, dtype=np.float64)
    return values[np.isfinite(values)]


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def _are_whole(values: Array) -> bool:
    """Whether there are values, and all of them are whole numbers, as the readings of a counter are."""
    return bool(len(values) and (values == np.rint(values)).all())


def _words(name: str) -> set[str]:
    """The words of a name in lower case, without its digits."""
    return set(re.findall(r"[^\W\d_]+", CAPITAL.sub("_", name).lower()))
