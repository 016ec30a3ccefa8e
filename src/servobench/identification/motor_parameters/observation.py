"""Observations of a motor: numbers from the data, each with its law, and their joint covariance."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from servobench.core.arguments import to_number
from servobench.core.channels import Array
from servobench.core.errors import UnknownName, UsageError
from servobench.core.finding import Finding
from servobench.core.parameter_names import parameter_in_words

Motor: TypeAlias = Mapping[str, float]
Law: TypeAlias = Callable[[Motor], float]

UNITS = {
    "resistance": "Ω",
    "motor_constant": "V·s/rad",
    "inertia": "kg·m²",
    "viscous_friction": "N·m·s/rad",
    "coulomb_torque": "N·m",
    "inductance": "H",
}
"""The parameters of a motor and their units; all but the viscous friction are above zero."""

_EXACT = 1e-6  # of its value: the standard deviation of a number stated without one


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """Numbers `values` (N,) with covariance (N, N), each with its law in `laws`.

    `sentence` says where they come from, `findings` what there is to know of them.
    """

    laws: tuple[Law, ...]
    values: Array
    covariance: Array
    sentence: str = ""
    findings: tuple[Finding, ...] = ()


def nothing(*findings: Finding) -> Observation:
    """Return no number at all, and why."""
    return Observation(laws=(), values=np.empty(0), covariance=np.empty((0, 0)), findings=findings)


def stiffness(motor: Motor) -> float:
    """Return R b + k²."""
    return motor["resistance"] * motor["viscous_friction"] + motor["motor_constant"] ** 2


def from_values(known: Mapping[str, float | tuple[float, float]]) -> Observation:
    """Return the values that the user states, `name: value` or `name: (value, sd)` in SI units.

    A value without a standard deviation is taken as exact. Raises `UnknownName` for a name that is no parameter of a motor, and
    `UsageError` for a value that no motor has.
    """
    laws, values, sds = [], [], []
    for name, entry in known.items():
        if name not in UNITS:
            raise UnknownName("parameter of a motor", name, UNITS)
        stated = entry if isinstance(entry, tuple) and len(entry) == 2 else (entry, 0.0)
        value, sd = (to_number(f"known {name}", each) for each in stated)
        if not (math.isfinite(value) and value > 0 and math.isfinite(sd) and sd >= 0):
            raise UsageError(
                f"known {name}: {value:g} with a standard deviation of {sd:g} {UNITS[name]}; expected a value above 0, and a "
                "standard deviation of 0 or more"
            )
        laws.append(_itself(name))
        values.append(value)
        sds.append(max(sd, _EXACT * value))
    named = " and ".join(parameter_in_words(name) for name in known)
    return Observation(
        laws=tuple(laws),
        values=np.array(values),
        covariance=np.diag(np.square(sds)),
        sentence=f"the {named} that you gave" if known else "",
    )


def _itself(name: str) -> Law:
    return lambda motor: motor[name]
