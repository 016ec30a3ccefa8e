"""The series for each role, with its unit: by the user's options first, then by the recording, then by the names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UnitError, UsageError
from servobench.core.finding import Finding, info, warning
from servobench.core.units import unit
from servobench.recordings.formats.columns import TIME_NAMES, Heading, heading, quote, time_unit
from servobench.recordings.formats.likely_units import (
    about_full_scale,
    about_stated_unit,
    is_duty_name,
    pulse_remedy,
    unit_examples,
)
from servobench.recordings.formats.roles import (
    CAPITAL,
    REFERENCE_NAMES,
    VOLTS_BY_CONVENTION,
    ColumnSpec,
    Role,
    column_of_side,
    controller_columns,
    find_series,
    full_scale,
    may_be_supply,
    one_of_several,
    plain_name,
    quantity_of,
    recognise,
    shell_text,
    sides_of,
)
from servobench.recordings.formats.sensitivity import Sensitivity, sensitivity
from servobench.recordings.formats.unreadable import check_readable, has_numbers
from servobench.recordings.recording import Recording, Series

_MEANING = {"input": "what drives the motor", "output": "what was measured on the motor"}


def spec_of(column: str | ColumnSpec | None, recording: Recording) -> ColumnSpec | None:
    """The column that is meant; a channel's whole name is that channel, whatever a colon in it looks like."""
    if column is None or isinstance(column, ColumnSpec):
        return column
    return ColumnSpec(column=column) if column in recording else ColumnSpec.parse(column)


@dataclass(frozen=True, kw_only=True)
class Choice:
    """The series of a role, in its unit, and findings about the choice."""

    series: Series
    findings: tuple[Finding, ...] = ()


def choose(
    recording: Recording, role: Role, spec: ColumnSpec | None, taken: Sequence[str], in_counts: bool = False
) -> Choice | str:
    """Return the series for a role; or the sentence that asks for it, or for its unit. `taken` are names that it can't be.

    Where nothing says the unit, it is counts if it is `in_counts`.
    Raises `UsageError` for a column that holds the times.
    """
    known = getattr(recording, role, None)
    findings: list[Finding] = []
    symbol = None
    if spec is not None:
        series, findings = find_series(recording, spec, role)
        symbol = spec.unit
    elif known is not None:
        series = recording[known]
    else:
        candidates = recognise(recording, role, without=taken)
        if len(candidates) != 1:
            return _which(recording, role, [each.name for each in candidates], taken)
        series, findings, symbol = recording[candidates[0].name], [candidates[0].finding], candidates[0].unit
    name, unit_text = series.channel.name, series.channel.unit
    symbol = symbol or unit_text
    if role in _MEANING:
        check_readable(recording, series, role)
    if role in _MEANING and _holds_the_times(series):
        raise UsageError(
            f"{recording.name}: `{name}` holds the times; the {role} is {_MEANING[role]}: say `{role}=COL:UNIT` with "
            f"another of {long_columns(recording)}"
        )
    if symbol is None and role == "input" and plain_name(name) in VOLTS_BY_CONVENTION:
        symbol = "V"
        sentence = f"`{name}` is read in V by convention; otherwise say `input={shell_text(f'{name}:UNIT')}`."
        findings.append(info("unit-by-convention", sentence))
    if symbol is None and in_counts:
        symbol = "counts"
        sentence = (
            f"`{name}` is read in counts, as the counts per turn are given; otherwise say `{role}=COL:UNIT`."
        )
        findings.append(info("unit-by-convention", sentence))
    if symbol is None:
        examples = unit_examples(role, series)
        return (
            f"the unit of the {role} `{name}`: say `{role}={shell_text(f'{name}:UNIT')}`, such as {examples}"
        )
    if (scale := full_scale(symbol)) is not None:
        return _duty_of_counts(recording, role, series, scale, findings)
    if role == "output" and (scaled := sensitivity(symbol)) is not None:
        return _of_sensor(recording, series, scaled, findings)
    _check_unit(recording, role, series, symbol)
    findings += about_stated_unit(series, symbol, role)
    return Choice(series=_in_unit(series, symbol), findings=tuple(findings))


def _in_unit(series: Series, symbol: str) -> Series:
    """The series with another unit of its values, which stay; what was known in the old unit is gone."""
    channel = series.channel
    if channel.unit == symbol:
        return series
    if channel.unit is not None:
        channel = replace(channel, minimum=None, maximum=None, resolution=None)
    return replace(series, channel=replace(channel, unit=symbol))


def _duty_of_counts(
    recording: Recording, role: Role, series: Series, scale: float, findings: list[Finding]
) -> Choice:
    """The input as a duty in per cent, of the raw counts of a pulse-width modulator and its full scale."""
    name = series.channel.name
    if role != "input":
        raise UsageError(
            f"{recording.name}: the {role} `{name}` is in counts of a pulse width; only the input can be"
        )
    sentence = f"`{name}` is read as a duty in raw counts, with {scale:g} counts for 100 %."
    channel = replace(series.channel, unit="%", minimum=None, maximum=None, resolution=None)
    duty = Series(channel=channel, values=series.values * (100.0 / scale), t=series.t)
    return Choice(
        series=duty, findings=(*findings, info("duty-scaled", sentence), *about_full_scale(series, scale))
    )


def _of_sensor(recording: Recording, series: Series, scaled: Sensitivity, findings: list[Finding]) -> Choice:
    """The output as a position or a speed, of what a sensor gives and its sensitivity."""
    name, given_in = series.channel.name, series.channel.unit
    try:
        factor = scaled.factor_from(given_in)
    except UnitError:
        raise UsageError(
            f"{recording.name}: the output `{name}` is in {given_in}, and `{scaled}` is for something in {scaled.per}; expected "
            f"a sensitivity for {given_in}"
        ) from None
    channel = replace(series.channel, unit=scaled.unit, minimum=None, maximum=None, resolution=None)
    shaft = Series(channel=channel, values=factor * series.values, t=series.t)
    sentence = f"`{name}` is read with {scaled}."
    return Choice(series=shaft, findings=(*findings, info("output-scaled", sentence)))


def _check_unit(recording: Recording, role: Role, series: Series, symbol: str) -> None:
    name, what = series.channel.name, unit(symbol).quantity
    if role == "supply" and what != "voltage":
        raise UsageError(f"{recording.name}: the supply `{name}` is in {symbol}; expected a voltage (V, mV)")
    if role == "current" and what != "current":
        raise UsageError(f"{recording.name}: the current `{name}` is in {symbol}; expected A or mA")
    if role == "output" and what not in {"position", "speed"}:
        example = shell_text(f"{name}:142.9 rpm/V")
        metres = f". If ms is m/s here, say `output={shell_text(f'{name}:m/s')}`" if symbol == "ms" else ""
        raise UsageError(
            f"{recording.name}: the output `{name}` is in {symbol}; expected a position (rad, deg, rev, counts, m), a speed "
            f"(rad/s, deg/s, rpm, rev/s, counts/s, m/s), or a sensor's sensitivity, such as `output={example}`{metres}"
        )
    if role == "input" and what == "time":
        raise UsageError(
            f"{recording.name}: the input `{name}` is in {symbol}; expected V, % or the like, not a time. "
            f"{pulse_remedy(_in_unit(series, symbol))}"
        )


def _holds_the_times(series: Series) -> bool:
    """Whether a channel is the column that its own times come from."""
    parsed = heading(series.channel.name)
    symbol = time_unit(Heading(name=parsed.name, unit=series.channel.unit or parsed.unit))
    if series.t is None or symbol is None or len(series.t) < 2:
        return False
    return bool(np.allclose(series.values * unit(symbol).factor, series.t, rtol=1e-12, equal_nan=True))


def _which(recording: Recording, role: Role, candidates: Sequence[str], taken: Sequence[str]) -> str:
    """The sentence that asks which column has a role, of those with such a name or else those that measure the right thing."""
    if (columns := controller_columns(recording)) is not None and columns[0] not in taken:
        measured, drive = columns
        likely, other = (drive, measured) if role == "input" else (measured, drive)
        return (
            f"which column is the {role}: in a controller's log `{measured}` is what it measures, and `{drive}` what drives the "
            f"motor. If this is one, say `{role}={_with_unit(recording, likely)}`, otherwise "
            f"`{role}={_with_unit(recording, other)}`"
        )
    wanted = {"voltage", "duty"} if role == "input" else {"position", "speed"}
    names = _free_columns(recording, role, taken)
    possible = [name for name in names if not may_be_supply(name)]
    if role == "output":  # a command is no measurement, whatever its unit
        possible = [name for name in possible if not _COMMAND.search(name.lower())] or possible
    candidates = candidates or [
        each for each in possible if quantity_of(recording[each].channel.unit) in wanted
    ]
    candidates = candidates or one_of_several(
        [name for name in possible if plain_name(name) not in REFERENCE_NAMES], role
    )
    if not candidates and role == "input":
        candidates = [name for name in possible if _COMMAND.search(name.lower()) or is_duty_name(name)]
    moving = [name for name in candidates if _varies(recording[name].values)]
    candidates = moving or candidates
    if candidates:
        options = " or ".join(f"`{role}={_with_unit(recording, name)}`" for name in candidates)
        sentence = f"which column is the {role} (perhaps {quote(candidates)}): say {options}"
        pulses = [
            recording[each] for each in candidates if quantity_of(recording[each].channel.unit) == "time"
        ]
        if pulses and role == "input":
            return f"{sentence}. {pulse_remedy(pulses[0])}"
        return f"{sentence}{_about_sides(recording, role, candidates)}"
    sentence = f"which column is the {role} ({_MEANING[role]}): say `{role}=COL:UNIT`; {_list_of(names)}"
    if role == "input":
        followed = [
            each.channel.name for each in recording.series if plain_name(each.channel.name) in REFERENCE_NAMES
        ]
        if followed:
            sentence += (
                f". {quote(followed[:1])} is, by its name, what a loop follows, and doesn't drive the motor"
            )
        sentence += (
            ". Identification needs an input; name one in another file as FILE#COL, or give a constant one: "
            "`input_value=50:%`"
        )
    return sentence


def _about_sides(recording: Recording, role: Role, candidates: Sequence[str]) -> str:
    """The end of a sentence on columns of several motors, which are called by their sides where each leads to its own column."""
    sides = sides_of(candidates)
    if not sides or sides[0].isdecimal():  # which would be a column's number
        return ""
    # `left` leads nowhere where both `left_pulses` and `left_speed` may be meant.
    if [column_of_side(recording, side, role) for side in sides] != list(candidates):
        return ""
    example = sides[0] if recording[candidates[0]].channel.unit else f"{sides[0]}:UNIT"
    return f". If there are several motors, choose one: `{role}={shell_text(example)}`"


def _free_columns(recording: Recording, role: Role, taken: Sequence[str]) -> list[str]:
    """The columns that may have a role still: as long as the longest, not the times, and not surely something else."""
    other: Role = "output" if role == "input" else "input"
    used = {*taken, *(each.name for each in recognise(recording, other, without=taken))}
    most = max((len(each.values) for each in recording.series), default=0)
    return [
        each.channel.name
        for each in recording.series
        if len(each.values) == most
        and each.channel.name not in used
        and has_numbers(each)
        and not _holds_the_times(each)
        and not (each.t is not None and plain_name(each.channel.name) in TIME_NAMES)
        and not (role == "input" and plain_name(each.channel.name) in REFERENCE_NAMES)
    ]


def _list_of(names: Sequence[str]) -> str:
    if not names:
        return "no column is left for it"
    return (
        f"the only column left is {quote(names)}"
        if len(names) == 1
        else f"the columns are {quote(names, 30)}"
    )


_SIDES = frozenset({"left", "right", "front", "rear", "back", "fl", "fr", "rl", "rr", "bl", "br"})
_COMMAND = re.compile(
    r"(?:^|[/_.])(?:cmds?|commands?|voltages?|volts|efforts?|duty|pwm|controls?)(?:[/_.\d]|$)"
)


def _varies(values: Array) -> bool:
    """Whether a column ever changes: if not, the motor didn't move."""
    finite = values[np.isfinite(values)]
    return bool(len(finite) and (finite != finite[0]).any())


def about_other_roles(
    recording: Recording, driven: Series, used: Sequence[str], known: Sequence[Role]
) -> list[Finding]:
    """Return the questions whether columns, the input included, are a loop's reference or a duty's supply, as their names say.

    `driven` is the input, `used` are the columns that have a role, `known` the roles that need no question.
    """
    unused = [each.channel.name for each in recording.series if has_numbers(each)]
    unused = [name for name in unused if name not in used]
    findings = []
    if is_reference(driven.channel.name) and not _is_of_a_shaft(driven):
        sentence = (
            f"The input `{driven.channel.name}` is, by its name, what a loop follows. If it is, the model describes the whole "
            "loop, controller included, not the motor: name the column of the voltage or the duty as the input."
        )
        findings.append(info("reference-possible", sentence, parameters=("gain", "time_constant")))
    followed = _nearest(
        [name for name in unused if is_reference(name) and _varies(recording[name].values)], used
    )
    if followed is not None and "reference" not in known:
        sentence = (
            f"`{followed}` is, by its name, what a loop follows. If a controller drove the motor, say "
            f"`reference={_with_unit(recording, followed)}`: the data are then tested for whether they tell the motor from it."
        )
        findings.append(info("reference-possible", sentence, parameters=("gain", "time_constant")))
    supply = next(filter(may_be_supply, unused), None)
    if supply is not None and "supply" not in known and quantity_of(driven.channel.unit) == "duty":
        sentence = (
            f"By its name, `{supply}` may feed the amplifier. If it does, say `supply={_with_unit(recording, supply)}`: the "
            "motor's voltage is the duty times the supply, and a battery that sags bends the characteristic of a duty."
        )
        findings.append(info("supply-possible", sentence, parameters=("gain", "time_constant")))
    return findings


def _is_of_a_shaft(series: Series) -> bool:
    """Whether an input is in rad or m, or a speed of these: its unit is doubted then, whatever its name is."""
    symbol = series.channel.unit
    return symbol is not None and unit(symbol).si in {"rad", "rad/s", "m", "m/s"}


def is_reference(name: str) -> bool:
    """Return whether a name is a reference's, as `target` is, or begins like one of a position or speed, as `ref_speed` does."""
    plain = plain_name(name)
    first = plain.partition("_")[0]
    return plain in REFERENCE_NAMES or (
        first in {"ref", "reference", "setpoint", "target", "desired"}
        and not _COMMAND.search(plain)
        and "current" not in plain
    )


def about_two_motors(recording: Recording, driven: str, output: str) -> list[Finding]:
    """Return a doubt of an input that is another motor's than the output, by their names: `drive_2` is there for `speed_2`, too.

    What tells the motors apart is a number, a letter or a side, of which each of the two names has another one.
    """
    own, others = _parts(driven), _parts(output)
    for name in (each.channel.name for each in recording.series if each.channel.name not in (driven, output)):
        here, there = (filter(_tells_apart, each) for each in (own - others, others - own))
        if len(own) > 1 and any(_parts(name) == own - {one} | {other} for one, other in product(here, there)):
            sentence = (
                f"By their names, `{driven}` and `{output}` are of two motors, which may turn alike: `{name}` is there as well. "
                f"If that drives the motor, say `input={shell_text(name)}`, with its unit."
            )
            return [warning("columns-of-two-motors", sentence, parameters=("gain", "time_constant"))]
    return []


def parts_that_tell_apart(name: str) -> set[str]:
    """Return the numbers, letters and sides in a column's name, its unit left out, by which motors are told apart."""
    return set(filter(_tells_apart, _parts(name) - _parts(heading(name).unit or "")))


def _tells_apart(part: str) -> bool:
    return part.isdecimal() or len(part) == 1 or part in _SIDES


def _nearest(names: Sequence[str], used: Sequence[str]) -> str | None:
    """The first name that has most words and numbers in common with those in use, as `TargetM2` has with `DriveM2`."""
    parts = set().union(*map(_parts, used))
    return max(names, key=lambda name: len(_parts(name) & parts), default=None)


def _parts(name: str) -> set[str]:
    """The words and the numbers of a name, in lower case."""
    return set(re.findall(r"[^\W\d_]+|\d+", CAPITAL.sub("_", name).lower()))


def _with_unit(recording: Recording, name: str) -> str:
    """A column as it has to be said, with a place for its unit where that isn't known, or is that of a time."""
    symbol = recording[name].channel.unit
    return shell_text(name if symbol and quantity_of(symbol) != "time" else f"{name}:UNIT")


def long_columns(recording: Recording) -> str:
    """Return the columns of numbers that are as long as the longest, as a list for a sentence; a shorter one is a setting."""
    most = max((len(each.values) for each in recording.series), default=0)
    return quote(
        [each.channel.name for each in recording.series if len(each.values) == most and has_numbers(each)], 30
    )
