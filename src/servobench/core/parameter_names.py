"""The names of parameters for programs and for people, their symbols, and their meaning if the model doesn't give it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from servobench.core.units import is_unit, unit

_OF_THE_INPUT = frozenset({"voltage", "current", "duty", "torque", "force"})
_NUMBERED = re.compile(r"(?P<base>[a-z_]+?)_?(?P<index>[0-9]+)")


@dataclass(frozen=True)
class ParameterName:
    """One parameter: its `code` name, its name in `words`, its `symbol`, and its `meaning` where no model structure says it.

    In the words, `{input}` stands for what the input is: a voltage, a current, a duty. In the symbol an index follows `_`.
    """

    code: str
    words: str
    symbol: str = ""
    meaning: str = ""


# fmt: off
_TABLE = (
    # of the models
    ParameterName("gain", "gain", "K"),
    ParameterName("time_constant", "time constant", "τ"),
    ParameterName("electrical_time_constant", "electrical time constant", "τ_e"),
    ParameterName("delay", "delay", "d"),
    ParameterName("coulomb_voltage", "Coulomb {input}", "u_c"),
    ParameterName("coulomb_voltage_forward", "forward Coulomb {input}", "u_c+"),
    ParameterName("coulomb_voltage_backward", "backward Coulomb {input}", "u_c−"),
    ParameterName("offset_voltage", "offset {input}", "u_0"),
    ParameterName("drag_asymmetry", "drag asymmetry", "u_a"),
    ParameterName("stribeck_voltage", "Stribeck {input}", "u_s"),
    ParameterName("stribeck_speed", "Stribeck speed", "ω_s"),
    ParameterName("gravity_voltage_sine", "gravity {input} (sine)", "u_gs"),
    ParameterName("gravity_voltage_cosine", "gravity {input} (cosine)", "u_gc"),
    ParameterName("load_friction", "load friction", "μ"),
    ParameterName("loop_gain", "loop gain", "K"),
    ParameterName("dead_band_position", "dead band", "r_c"),
    ParameterName("offset_position", "position offset", "r_0"),
    ParameterName("a", "a", "a"),
    ParameterName("b", "b", "b"),
    # of a record
    ParameterName("start_position", "start position", "θ_0"),
    ParameterName("start_speed", "start speed", "ω_0"),
    ParameterName("start_state", "start state", "x"),
    ParameterName("start", "start value", "c"),
    ParameterName("output_at_no_input", "output at zero input", "y_0"),
    # of the motor
    ParameterName("resistance", "resistance", "R", "of the winding and everything in series with it"),
    ParameterName("motor_constant", "torque constant", "k", "torque per ampere, and back-emf per rad/s"),
    ParameterName("inertia", "inertia", "J", "of everything that turns"),
    ParameterName("viscous_friction", "viscous friction", "b", "friction torque proportional to the speed"),
    ParameterName("coulomb_torque", "Coulomb torque", "T_c", "friction torque independent of the speed"),
    ParameterName("inductance", "inductance", "L", "of the winding"),
    # derived
    ParameterName("pole", "pole", "p"),
)
# fmt: on
PARAMETER_NAMES: Mapping[str, ParameterName] = MappingProxyType({each.code: each for each in _TABLE})
"""Every parameter by its code name; one with a number at its end, such as `a1` or `start_state_2`, stands here without it."""


def parameter_in_words(name: str, symbol: str = "V") -> str:
    """Return a parameter's name as people write it: `time constant`, `Coulomb voltage`.

    `symbol` is the parameter's unit or the input's: a friction in `%` is a `Coulomb duty`, one in `A` a `Coulomb current`, one in
    a unit of another kind a `Coulomb input`. A name without a row, a plug-in's, counts as its words.
    """
    row, index = _row(name)
    if row is None:
        return plain_words(name)
    return (
        row.words.format(input=_kind(symbol)) + (index if row.words == row.symbol else f" {index}").rstrip()
    )


def parameter_symbol(name: str) -> str:
    """Return a parameter's symbol, its index behind `_`: `u_c`; empty for a name without a row."""
    row, index = _row(name)
    if row is None or not index:
        return row.symbol if row else ""
    return f"{row.symbol}{'' if '_' in row.symbol else '_'}{index}"


def plain_words(name: str) -> str:
    """Return a name with blanks between its words, for settings, members and units, whose names are their words."""
    return name.replace("_", " ")


def _row(name: str) -> tuple[ParameterName | None, str]:
    """The row of a name and the number at the name's end, empty for none."""
    numbered = _NUMBERED.fullmatch(name)
    if name in PARAMETER_NAMES or numbered is None:
        return PARAMETER_NAMES.get(name), ""
    return PARAMETER_NAMES.get(numbered["base"]), numbered["index"]


def _kind(symbol: str) -> str:
    """The name of an input in a unit."""
    quantity = unit(symbol).quantity if is_unit(symbol) else "input"
    return quantity if quantity in _OF_THE_INPUT else "input"
