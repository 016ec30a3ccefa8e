"""The names of the nonlinear motors: each says which friction and which gravity it has."""

from __future__ import annotations

import re

from servobench.models.base import STRUCTURES, Parameter
from servobench.models.first_order import COULOMB, DELAY, GAIN, OFFSET, TIME_CONSTANT
from servobench.models.nonlinear.structure import (
    ASYMMETRY,
    BACKWARD,
    COSINE,
    FORWARD,
    LOAD,
    SINE,
    STRIBECK,
    STRIBECK_SPEED,
    NonlinearMotor,
)

FORM = "first_order[_coulomb|_asymmetric|_one_way][_stribeck][_gravity][_load]"
MEANING = (
    "friction first (none, coulomb, asymmetric for unequal friction in the two directions, one_way for a motor that only turned "
    "one way), then stribeck for friction that falls with the speed, gravity for an arm or a pendulum, load for friction that "
    "grows with gravity's load; stribeck and load need a friction, load needs gravity"
)
_FRICTION: dict[str, tuple[Parameter, ...]] = {
    "": (OFFSET,),
    "_coulomb": (COULOMB, OFFSET),
    "_asymmetric": (FORWARD, BACKWARD, ASYMMETRY),
    "_one_way": (COULOMB,),
}


def ladder(name: str) -> NonlinearMotor | None:
    """Return the structure that a name such as `first_order_coulomb_gravity` stands for, None where it stands for none."""
    match = re.fullmatch(r"first_order(_coulomb|_asymmetric|_one_way)?(_stribeck)?(_gravity)?(_load)?", name)
    if match is None:
        return None
    friction, stribeck, gravity, load = (part or "" for part in match.groups())
    if ((stribeck or load) and not friction) or (load and not gravity):
        return None
    if not (stribeck or gravity or friction == "_asymmetric"):
        return None
    return NonlinearMotor(
        (
            GAIN,
            TIME_CONSTANT,
            *_FRICTION[friction],
            *((STRIBECK, STRIBECK_SPEED) if stribeck else ()),
            *((SINE, COSINE) if gravity else ()),
            *((LOAD,) if load else ()),
            DELAY,
        )
    )


STRUCTURES.family(FORM, ladder, MEANING)
