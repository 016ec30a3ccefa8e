"""Duty times supply: the voltage of the motor."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from servobench.core.channels import Array, Channel
from servobench.core.errors import UnitError, UsageError
from servobench.core.finding import info
from servobench.core.units import quantity, unit
from servobench.recordings.formats.roles import ColumnSpec, quantity_of
from servobench.recordings.recording import Recording, Series

_DUTIES = {"%": 0.01, "1": 1.0}
WHOLE = 1.05
"""Of the supply: a duty is never more than 1, but for a percent or two of an amplifier's own scale."""
_FALSE = 2  # rows, or
_FEW = 0.01  # of all: so many may be false
_BEGINS_AS_NUMBER = re.compile(r"\s*[-+]?(?:\d|\.\d)")


def constant(supply: str | ColumnSpec | None, recording: Recording) -> float | None:
    """Return a supply that is a constant, such as `7.4 V` [V]; None for a channel, be it one that is named by its number.

    Raises `UsageError` for a constant that is no supply.
    """
    if not isinstance(supply, str) or supply in recording or supply.strip().isdecimal():
        return None
    if not _BEGINS_AS_NUMBER.match(supply):
        return None
    try:
        volts = quantity(supply, "V")
    except UnitError:
        return None
    if not 0.0 < volts < np.inf:
        raise UsageError(f"the supply is {supply!r}; expected a positive voltage such as 7.4 V")
    return volts


def motor_voltage(recording: Recording, supply: Series | None, volts: float | None) -> Recording:
    """Return the recording with its duty times the supply as the input, a new channel in V.

    The supply is a series in a unit of voltage, or a constant [V]. Between its samples it is on a straight line, before the first
    and after the last it is what it was there: it moves slowly with the load, and the duty is what holds from sample to sample.
    Raises `UsageError` where the input is no duty, or is more than 100 %, or the supply has no sample that can be used.
    """
    if recording.input is None:
        raise UsageError(f"{recording.name}: a supply goes with a duty; name the input")
    duty = recording[recording.input]
    symbol = duty.channel.unit or ""
    if symbol not in _DUTIES:
        raise UsageError(
            f"{recording.name}: the input `{duty.channel.name}` is in {symbol or 'no known unit'}; a supply goes "
            "with a duty, in %, 1 (a fraction) or raw counts such as PWM/885: give its unit, or leave the supply out"
        )
    _check_whole(recording, duty, _DUTIES[symbol])
    at_duty, source = _supply_at(recording, supply, volts, duty)
    name = _free_name(recording)
    channel = Channel(name=name, unit="V")
    product = Series(channel=channel, values=duty.values * _DUTIES[symbol] * at_duty, t=duty.t)
    sentence = f"The input is `{name}`, in V: the duty `{duty.channel.name}` times {source}."
    return replace(
        recording,
        series=(*recording.series, product),
        input=name,
        input_before=None,
        findings=(*recording.findings, info("supply-applied", sentence)),
    )


def _check_whole(recording: Recording, duty: Series, whole: float) -> None:
    """Refuse a duty that is more than the whole in more rows than a few false ones: then what is 100 % was said wrongly."""
    parts = np.abs(duty.values[np.isfinite(duty.values)]) * whole
    if np.count_nonzero(parts > WHOLE) > max(_FALSE, _FEW * len(parts)):
        reached = f"{100 * float(np.percentile(parts, 98)):.4g} %"
        raise UsageError(
            f"{recording.name}: the duty `{duty.channel.name}` reaches {reached} of its supply; expected at most 100 %. Say "
            "which count is 100 %, as in `input=COL:PWM/1023`, or leave the supply out if the column holds volts"
        )


def _supply_at(
    recording: Recording, supply: Series | None, volts: float | None, duty: Series
) -> tuple[Array, str]:
    """The supply at the times of the duty (N,) [V], and what is to be said of it."""
    if supply is None or supply.t is None or duty.t is None:
        constant = float("nan") if volts is None else volts
        return np.full(len(duty.values), constant), f"a supply of {constant:g} V"
    symbol = supply.channel.unit or "V"
    if quantity_of(symbol) != "voltage":
        raise UsageError(f"{recording.name}: the supply `{supply.channel.name}` is in {symbol}; expected V")
    usable = np.isfinite(supply.t) & np.isfinite(supply.values)
    if not usable.any():
        raise UsageError(f"{recording.name}: the supply `{supply.channel.name}` has no finite value")
    order = np.argsort(supply.t[usable], kind="stable")
    t, values = supply.t[usable][order], supply.values[usable][order] * unit(symbol).factor
    text = f"the supply `{supply.channel.name}`, {values.min():.4g} to {values.max():.4g} V"
    if not np.array_equal(t, duty.t):
        text += ", on straight lines between its samples"
    return np.interp(duty.t, t, values), text


def _free_name(recording: Recording) -> str:
    name = "motor_voltage"
    while name in recording:
        name += "_"
    return name
