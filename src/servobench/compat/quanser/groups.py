"""Channels and arrays by their four groups, checked against what a board has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from servobench.compat.quanser.buffers import (
    BOOLEAN,
    DOUBLE,
    INT,
    CType,
    Output,
    channels,
    finite,
    output,
    values,
)
from servobench.compat.quanser.errors import Code, hil_error
from servobench.compat.quanser.layout import Layout
from servobench.compat.quanser.tasks import Groups, Row

GroupChannels: TypeAlias = Sequence[tuple[object, object]]
"""For each group the caller's array of channels, and how many there are."""

_NAMES = ("analog", "second", "digital", "other")
_INPUTS = ("analog", "encoder", "digital", "other")
_OUTPUTS = ("analog", "PWM", "digital", "other")
_IN_TYPES: tuple[CType, ...] = (DOUBLE, INT, BOOLEAN, DOUBLE)
_OUT_TYPES: tuple[CType, ...] = (DOUBLE, DOUBLE, BOOLEAN, DOUBLE)
_GROUPS = 4


def one_group(place: int, channels: object, count: object) -> GroupChannels:
    """Return channels of the group at that place alone."""
    return [(channels, count) if number == place else (None, 0) for number in range(_GROUPS)]


def one_array(place: int, array: object) -> tuple[object, ...]:
    """Return the array of the group at that place alone."""
    return tuple(array if number == place else None for number in range(_GROUPS))


def inputs(layout: Layout, channels: GroupChannels) -> Groups:
    """Return input channels that the board has; raises `HILError` for others."""
    known: tuple[Sequence[int], ...] = (
        range(layout.analog_inputs),
        range(layout.encoders),
        range(layout.digital_inputs),
        layout.other_inputs,
    )
    return _groups(channels, known, _INPUTS, "INPUT")


def outputs(layout: Layout, channels: GroupChannels, *, pwm: bool) -> Groups:
    """Return output channels that the board has; `pwm` says whether it drives its motor by PWM, in the analog output's place."""
    if channels[1][1] and not pwm:
        raise hil_error(Code.PWM_OUTPUTS_NOT_SUPPORTED)
    known: tuple[Sequence[int], ...] = (
        range(0 if pwm else layout.analog_outputs),
        range(layout.pwm_outputs),
        range(layout.digital_outputs),
        layout.other_outputs,
    )
    return _groups(channels, known, _OUTPUTS, "OUTPUT")


def _groups(
    requested: GroupChannels, known: Sequence[Sequence[int]], kinds: Sequence[str], way: str
) -> Groups:
    channels_by_group = {}
    for name, kind, exist, (array, count) in zip(_NAMES, kinds, known, requested, strict=True):
        channels_by_group[name] = channels(
            array, count, f"{kind} channels", Code[f"MISSING_{kind.upper()}_{way}S"]
        )
        for channel in channels_by_group[name]:
            if channel not in exist:
                raise hil_error(Code[f"INVALID_{kind.upper()}_{way}"], f"Channel {channel}.")
    return Groups(**channels_by_group)


def results(groups: Groups, arrays: Sequence[object], samples: int = 1) -> tuple[Output, ...]:
    """Return the caller's arrays for what is read, checked before anything is."""
    return tuple(
        output(
            array,
            len(channels) * samples,
            kind,
            f"{name} buffer",
            Code[f"MISSING_{name.upper()}_INPUT_BUFFER"],
        )
        for array, channels, kind, name in zip(arrays, groups, _IN_TYPES, _INPUTS, strict=True)
    )


def fill(outputs: Sequence[Output], rows: Sequence[Row]) -> None:
    """Write rows into the caller's arrays, sample after sample."""
    for number, target in enumerate(outputs):
        if target.count:
            flat = [value for row in rows for value in row[number]]
            Output(target.array, len(flat), target.kind, target.name, target.missing).fill(flat)


def rows(groups: Groups, arrays: Sequence[object], samples: int = 1) -> list[Row]:
    """Return what the caller wants put out, sample after sample; raises `HILError` for NaN and infinities."""
    flat = [
        finite(
            values(
                array,
                len(channels) * samples,
                kind,
                f"{name} buffer",
                Code[f"MISSING_{name.upper()}_OUTPUT_BUFFER"],
            ),
            f"{name} output",
        )
        for array, channels, kind, name in zip(arrays, groups, _OUT_TYPES, _OUTPUTS, strict=True)
    ]
    widths = [len(channels) for channels in groups]
    return [_sample(flat, widths, number) for number in range(samples)]


def _sample(flat: Sequence[tuple[float, ...]], widths: Sequence[int], number: int) -> Row:
    """The values of one sample, out of those of all."""
    return tuple(
        group_values[number * width : (number + 1) * width]
        for group_values, width in zip(flat, widths, strict=True)
    )
