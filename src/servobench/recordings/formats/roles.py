"""The channel that a given name refers to, and the channels that are recognised by their own names."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Literal, TypeAlias
from unicodedata import combining, normalize

import numpy as np

from servobench.core.errors import UnitError, UnknownName, UsageError
from servobench.core.finding import Finding, info
from servobench.core.units import is_unit, unit
from servobench.recordings.formats.base import load
from servobench.recordings.formats.columns import REMARK, bare_name, heading
from servobench.recordings.formats.direction import with_sign
from servobench.recordings.formats.sensitivity import sensitivity
from servobench.recordings.formats.unreadable import demote_unused, has_numbers
from servobench.recordings.recording import Recording, Series

Role: TypeAlias = Literal["input", "output", "reference", "supply", "current"]
"""A channel's role: the input of the motor, a measured output, a loop's reference, the amplifier's supply, or a current."""

ARMATURE_CURRENT = "armature_current"
"""The name of the channel of a measured current declared by the user; it has priority over all others."""

VOLTS_BY_CONVENTION = frozenset({"u", "v", "voltage"})
"""The names of an input that mean volts unless another unit is given."""

INPUT_NAMES = VOLTS_BY_CONVENTION | {
    "volt", "volts", "vm", "um", "input", "control", "command", "cmd", "pwm", "duty", "duty_cycle", "applied",
    "pwm_value", "pwm_duty", "pwm_cmd", "motor_pwm", "motor_command", "motor_cmd", "input_signal", "control_signal",
    "voltaje", "voltagem", "tension", "tensao", "tensione", "spannung", "entrada", "eingang",
    "motor_voltage", "input_voltage", "applied_voltage", "control_voltage", "voltage_command", "command_voltage",
    "plant_input", "motor_input", "control_input", "control_output", "controller_output",
}  # fmt: skip
"""The names by which a motor's input is recognised, in lower case and without a unit."""

OUTPUT_NAMES = frozenset({
    "y", "theta", "θ", "phi", "omega", "ω", "position", "pos", "angle", "speed", "velocity", "vel", "rpm",
    "counts", "encoder", "encoder_counts", "enc", "enc_count", "enc_counts", "count", "cnt", "pulses", "pulse_count",
    "tachometer", "motor_speed", "motor_position", "motor_angle",
    "shaft_speed", "shaft_angle", "angular_velocity", "angular_speed", "angular_position", "angular_rate",
    "motor_velocity", "motor_vel", "motor_pos", "joint_position", "joint_velocity", "present_position", "present_velocity",
    "omega_m", "ω_m", "theta_m", "θ_m", "theta_dot", "thetadot", "dtheta",
    "encoder_position", "encoder_count", "encoder_value", "encoder_ticks", "ticks", "motor_rpm", "rotor_speed",
    "wheel_speed", "wheel_velocity", "shaft_position", "actual_speed", "actual_velocity", "actual_position", "actual_angle",
    "measured_speed", "measured_velocity", "measured_position", "measured_angle",
    "velocidad", "velocidade", "velocita", "vitesse", "geschwindigkeit", "drehzahl", "posicion", "posicao", "posizione",
    "angulo", "angolo", "winkel", "salida", "saida",
    *(f"tim{timer}_cnt" for timer in range(1, 25)),  # the registers in which STM32 timers count an encoder's edges
})  # fmt: skip
"""The names by which a motor's measured output is recognised, in lower case and without a unit."""

OUTPUT_NAMES_WITH_UNIT = frozenset({
    "n", "w", "wm", "w_m", "q", "qm", "q_m", "dq", "qd", "x", "v", "actual", "feedback", "measured", "measurement", "response",
})  # fmt: skip
"""Ambiguous names: recognised as the output only with the unit of a position or a speed, if there is no other output."""

REFERENCE_NAMES = frozenset({
    "r", "ref", "reference", "setpoint", "set_point", "goal", "goal_position", "goal_velocity", "target", "target_position",
    "target_velocity", "target_speed", "target_counts", "target_angle", "desired", "desired_position", "desired_velocity",
    "desired_speed", "commanded", "demand", "position_reference", "velocity_reference", "speed_reference",
})  # fmt: skip
"""The names of a loop's possible reference; such a column leads to a question, and is never assumed."""

SUPPLY_NAMES = frozenset({
    "supply", "supply_voltage", "bus_voltage", "battery", "battery_voltage", "batt", "batt_voltage", "bat_voltage",
    "battery_volts", "vbat", "vbatt", "v_bat", "v_batt", "vbus", "vin", "v_in", "input_volts",
    "input_voltage", "present_input_voltage", "busvoltage",
})  # fmt: skip
"""The names of what may feed the amplifier; such a column is asked about, never taken."""

_KNOWN = INPUT_NAMES | OUTPUT_NAMES | OUTPUT_NAMES_WITH_UNIT | REFERENCE_NAMES | SUPPLY_NAMES
CAPITAL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
"""Where a word begins within a name in camel case."""

_RECOGNISED: dict[Role, str] = {"input": "input-recognised", "output": "output-recognised"}
_BOTH = frozenset({"input_voltage"})  # the motor's, unless a duty is beside it

_MEASURES: dict[Role, list[str]] = {
    "input": ["voltage", "duty"],
    "output": ["position", "speed"],
    "reference": [],
    "supply": ["voltage"],
    "current": ["current"],
}

_COMMON_UNITS = (
    "V", "mV", "%", "A", "mA", "rad", "deg", "rev", "counts", "m", "mm", "rad/s", "deg/s", "rpm", "rev/s", "counts/s", "m/s",
    "s", "ms", "us", "PWM/255",
)  # fmt: skip

_DUTY_WORDS = re.compile(
    r"pwm|duty|duty[_ ]?cycle|pulse[_ ]?width|pwm[_ ]?counts?|counts?[_ ]pwm", re.IGNORECASE
)
_PULSE_WIDTH = re.compile(r"PWM\s*/\s*([0-9]+(?:\.[0-9]*)?)", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class ColumnSpec:
    """A column as a user names it, `COL[:UNIT]`: a header's name, a variable's, or a column's number counted from 1.

    `FILE#COL` is a column of another file, `COL*SIGN` one whose sign stands in another column. The unit `PWM/885` is that of
    a duty in raw counts, with 885 for 100 %, and `142.9 rpm/V` says what a sensor's output in V stands for.
    """

    column: str
    unit: str | None = None

    @classmethod
    def parse(cls, text: str) -> ColumnSpec:
        """Return the column in a text; what follows the last colon is a unit only if it is one that is known."""
        column, _, tail = text.rpartition(":")
        if column and (is_unit(tail) or full_scale(tail) is not None or sensitivity(tail) is not None):
            return cls(column=column, unit=tail.strip())
        return cls(column=text)

    def __str__(self) -> str:
        return self.column if self.unit is None else f"{self.column}:{self.unit}"


@dataclass(frozen=True, kw_only=True)
class RoleMatch:
    """A channel, by `name`, recognised as input or output, its unit (None if unknown), and the `finding` with the reason."""

    name: str
    unit: str | None
    finding: Finding


def recognise(recording: Recording, role: Role, without: Sequence[str] = ()) -> tuple[RoleMatch, ...]:
    """Return the channels whose names, and units where they have some, are those of an input or of an output.

    Only where there is exactly one is it sure. `without` names channels that are something else.
    """
    series = [
        each
        for each in recording.series
        if each.channel.name not in without
        and not (role == "input" and may_be_supply(each.channel.name))
        and has_numbers(each)
    ]
    fitting = [each for each in series if _fits(role, plain_name(each.channel.name), each.channel.unit)]
    fitting = [each for each in fitting if not _numbers_the_rows(each)]
    if (columns := controller_columns(recording)) is not None:
        fitting = [each for each in fitting if each.channel.name not in columns]
    if role == "output":
        fitting = fitting or [each for each in series if _fits_by_its_unit(each)]
    matches = []
    for each in fitting:
        name, symbol = each.channel.name, each.channel.unit
        text = f"`{name}` is recognised as the {role} by its name"
        if symbol is None and role == "input" and plain_name(name) in VOLTS_BY_CONVENTION:
            symbol = "V"
            text += ", and read in V by convention"
        sentence = f"{text}; if that is wrong say `{role}=COL:UNIT`."
        matches.append(RoleMatch(name=name, unit=symbol, finding=info(_RECOGNISED[role], sentence)))
    return tuple(matches)


def controller_columns(recording: Recording) -> tuple[str, str] | None:
    """Return the columns `input` and `output` of a controller's log, which it measures and by which it drives the motor.

    None where there is no reference beside the two: then they are more likely the motor's. Source: PID_v1 of the Arduino.
    """
    columns = {
        plain_name(each.channel.name): each.channel.name for each in recording.series if has_numbers(each)
    }
    if not columns.keys() & REFERENCE_NAMES or not {"input", "output"} <= columns.keys():
        return None
    return columns["input"], columns["output"]


def _numbers_the_rows(series: Series) -> bool:
    """Whether a `count` rises by one from each row to the next, as one of rows does, and none of an encoder's edges."""
    values = series.values
    return (
        plain_name(series.channel.name) in {"count", "cnt"}
        and len(values) > 2
        and bool((np.diff(values) == 1.0).all())
    )


def _fits_by_its_unit(series: Series) -> bool:
    """Whether the unit shows that an ambiguous name is an output."""
    name, symbol = series.channel.name, series.channel.unit
    return plain_name(name) in OUTPUT_NAMES_WITH_UNIT and quantity_of(symbol) in {"position", "speed"}


def full_scale(symbol: str | None) -> float | None:
    """Return the counts that are a duty of 100 % in a unit such as `PWM/885`; None for any other unit."""
    match = _PULSE_WIDTH.fullmatch((symbol or "").strip())
    return float(match[1]) or None if match else None


def may_be_supply(name: str) -> bool:
    """Return whether a name is that of a supply, as `input_volts` is, which isn't the voltage of a motor."""
    whole = _snake_case(name.rpartition(".")[2])
    return {whole, plain_name(name)} & SUPPLY_NAMES != set() and plain_name(name) not in _BOTH


def plain_name(name: str) -> str:
    """Return a name without its folder (`log.`, `NT:/arm/`), its unit and its accents, in lower case, with `_` between words.

    Of `ex_signal(u)`, and of the `ex_signal_u_` that programs make of it, either part may be the name that is known.
    """
    last = heading(name.rpartition(".")[2] or name).name
    last = last.rpartition("/")[2] or last
    whole = _snake_case(bare_name(last))
    if whole in _KNOWN or not (parts := REMARK.fullmatch(last)):
        return whole
    outside = _snake_case(bare_name(parts["name"].strip()))
    inside = _snake_case(parts["inside"] or parts["between"])
    return inside if inside in _KNOWN and outside not in _KNOWN else outside


def _snake_case(text: str) -> str:
    """A text in lower case without accents, with `_` wherever blanks, hyphens, underscores or capitals part its words."""
    text = "".join(each for each in normalize("NFKD", text) if not combining(each))
    plain = "_".join(re.findall(r"[^-_\s]+", text.lower()))
    return plain if plain in _KNOWN else "_".join(re.findall(r"[^-_\s]+", CAPITAL.sub("_", text).lower()))


def _fits(role: Role, plain: str, symbol: str | None) -> bool:
    what = None if symbol is None else quantity_of(symbol)
    if role == "output":
        return what in {None, "position", "speed"} and (
            plain in OUTPUT_NAMES or (plain == "v" and what == "speed")
        )
    return what in {None, "voltage", "duty", "current", "other"} and plain in INPUT_NAMES


def shell_text(text: str) -> str:
    """Return a text as it has to be typed on a command line."""
    return text if all(letter.isalnum() or letter in "_.:/%-" for letter in text) else f'"{text}"'


def quantity_of(symbol: str | None) -> str:
    """Return what a unit measures; `other` for a text that is no unit."""
    return unit(symbol).quantity if symbol is not None and is_unit(symbol) else "other"


def find_series(recording: Recording, spec: ColumnSpec, role: Role | None) -> tuple[Series, list[Finding]]:
    """Return the series that a user names, and what is to be known of how it was found.

    The name decides, then the number, then a name in other case. `left` is the one channel that begins or ends so
    (`left_voltage`) and is a voltage for an input, a position or else a speed for an output. Raises `UnknownName`, which lists
    the columns.
    """
    names = [each.channel.name for each in recording.series]
    for text in (spec.column, heading(spec.column).name):
        if text in names:
            return recording[text], []
    if spec.column.isdecimal() and len(spec.column) < 9 and 1 <= int(spec.column) <= len(names):
        return recording.series[int(spec.column) - 1], []
    alike = [name for name in names if name.lower() == spec.column.lower()]
    if len(alike) == 1:
        return recording[alike[0]], [info("name-case", f"`{spec.column}` is taken to be `{alike[0]}`.")]
    by_side = _of_side(recording, spec, role)
    if by_side is not None:
        listing = (
            f"`{spec.column}` is taken to be `{by_side.channel.name}`, the {role} whose name contains it."
        )
        return by_side, [info("name-beginning", listing)]
    file, sharp, column = spec.column.rpartition("#")
    if sharp and file:
        return _in_other_file(recording, file, replace(spec, column=column), role)
    size, star, direction = spec.column.rpartition("*")
    if star and size and direction:
        return _with_sign(recording, size, direction, role)
    _check_is_no_unknown_unit(spec, names)
    what = f"column for the {role}" if role else "column"
    unused = [each.sentence for each in recording.findings if each.code == "header-mismatch"]
    ending = "".join(f". {sentence.removesuffix('.')}" for sentence in unused)
    raise UnknownName(f"{what} of {recording.source.name or recording.name}", spec.column, names, ending)


def _with_sign(
    recording: Recording, size: str, direction: str, role: Role | None
) -> tuple[Series, list[Finding]]:
    """A series whose sign stands in another column."""
    (large, about_size), (which, about_which) = (
        find_series(recording, ColumnSpec(column=text), part)
        for text, part in ((size, role), (direction, None))
    )
    series, about_sign = with_sign(large, which)
    return series, [*about_size, *about_which, about_sign]


def _check_is_no_unknown_unit(spec: ColumnSpec, names: Sequence[str]) -> None:
    """Raise `UnitError` if an unknown name is a column's name with something behind a colon that isn't a unit."""
    column, colon, tail = spec.column.rpartition(":")
    known = column.lower() in [name.lower() for name in names] or (
        column.isdecimal() and len(column) < 9 and 1 <= int(column) <= len(names)
    )
    if not colon or not known:
        return
    if _DUTY_WORDS.fullmatch(tail.strip()):
        raise UnitError(
            f"`{spec.column}`: {tail!r} isn't a known unit; a duty is in %, or in PWM/N with the count N that is 100 %: say "
            f"`{column}:%` or, with 8 bits, `{column}:PWM/255`"
        )
    near = get_close_matches(tail, _COMMON_UNITS, n=3, cutoff=0.4)
    hint = f" (did you mean {' or '.join(near)}?)" if near else ""
    # rev/2048, counts/1024 and the like: an encoder's resolution, which has a place of its own.
    turn = (
        f"; for an encoder: {column}:counts, with `counts_per_rev=N`"
        if any(c.isdecimal() for c in tail)
        else ""
    )
    raise UnitError(
        f"`{spec.column}`: {tail!r} isn't a known unit{hint}; known are {', '.join(_COMMON_UNITS)} (255, or "
        f"whatever count is 100 %), and products of these{turn}"
    )


def _of_side(recording: Recording, spec: ColumnSpec, role: Role | None) -> Series | None:
    """The channel that begins or ends with a name and measures what the role wants; a unit that was said narrows that down."""
    side = spec.column.lower()
    wanted = _MEASURES[role] if role is not None else []
    if spec.unit is not None and full_scale(spec.unit) is None:
        wanted = [unit(spec.unit).quantity]
    for what in wanted:
        fitting = [
            each
            for each in recording.series
            if _is_of_side(each.channel.name, side) and quantity_of(each.channel.unit) == what
        ]
        if len(fitting) == 1:
            return fitting[0]
    if role is None:
        return None
    known = INPUT_NAMES if role == "input" else OUTPUT_NAMES
    named = [
        each
        for each in recording.series
        if each.channel.unit is None
        and _is_of_side(each.channel.name, side)
        and plain_name(_without_side(each.channel.name, side)) in known
    ]
    return named[0] if len(named) == 1 else None


def column_of_side(recording: Recording, side: str, role: Role) -> str | None:
    """Return the column that `find_series` takes for the name of a side alone; None where there isn't just one."""
    if side.lower() in (each.channel.name.lower() for each in recording.series):
        return None
    series = _of_side(recording, ColumnSpec(column=side), role)
    return None if series is None else series.channel.name


_JOINTS = "_. -"


def _is_of_side(name: str, side: str) -> bool:
    """Whether a name begins or ends with what tells one of several motors from the others."""
    return any(
        each.startswith(tuple(side + joint for joint in _JOINTS))
        or each.endswith(tuple(joint + side for joint in _JOINTS))
        for each in (name.lower(), CAPITAL.sub("_", name).lower())
    )


def _without_side(name: str, side: str) -> str:
    """A name without what tells one of several motors from the others."""
    lower = CAPITAL.sub("_", name).lower()
    return lower.removeprefix(side).removesuffix(side).strip(_JOINTS)


def one_of_several(names: Sequence[str], role: Role) -> list[str]:
    """Return the names that are known for a role but for a first or last word, which tells several motors apart."""
    known = INPUT_NAMES if role == "input" else OUTPUT_NAMES
    words = {name: [part for part in re.split(r"[_. -]+", CAPITAL.sub("_", name)) if part] for name in names}
    for take in (slice(1, None), slice(None, -1)):
        rests = {name: "_".join(each[take]).lower() for name, each in words.items()}
        for rest in dict.fromkeys(rests.values()):
            alike = [name for name in names if rests[name] == rest]
            if rest in known and len(alike) > 1 and sides_of(alike):
                return alike
    return []


# One motor's voltage as it was requested and as it came; its position as it was requested and as it is.
_STAGES = frozenset({
    "command", "commanded", "cmd", "applied", "measured", "actual", "desired", "target", "reference", "setpoint", "goal",
    "present", "supply", "rad", "deg", "s", "rpm",
})  # fmt: skip


def sides_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return what tells the motors of several columns apart: `left` and `right` of `left_voltage` and `right_voltage`.

    Nothing where the columns are called alike in no other part, or where that part is empty.
    """
    if len(names) < 2:
        return ()
    words = [re.split(r"[_. -]", CAPITAL.sub("_", name)) for name in names]
    for take, rest in ((0, slice(1, None)), (-1, slice(None, -1))):
        sides, others = [each[take] for each in words], {tuple(each[rest]) for each in words}
        if len(others) == 1 and all(others) and len(set(sides)) == len(names) and all(sides):
            if _STAGES & set(map(str.lower, sides)):
                return ()
            return tuple(sides) if () not in others else ()
    return ()


def _in_other_file(
    recording: Recording, file: str, spec: ColumnSpec, role: Role | None
) -> tuple[Series, list[Finding]]:
    """A series of another file, under a name that this recording doesn't have."""
    path = Path(file)
    if not path.exists():
        other_path = Path(recording.source.name).parent / file
        path = other_path if other_path.exists() else path  # a missing file is reported by the given name
    others = load(path)
    if len(others) != 1:
        raise UsageError(
            f"{file} holds {len(others)} recordings; a column can only come from a file with one"
        )
    series, findings = find_series(others[0], spec, role)
    name = f"{path.stem}.{series.channel.name}"
    while name in recording:
        name += "_"
    sentence = f"`{name}` comes from {file} (SHA-256 {others[0].source.sha256})"
    sentence += "." if series.t is None else ", with its times, assumed to come from the same clock."
    channel = replace(series.channel, name=name)
    return replace(series, channel=channel), [
        info("column-from-other-file", sentence),
        *demote_unused(others[0].findings, [series.channel.name]),
        *findings,
    ]
