"""The names of the nonlinear motors; each name gives the kinds of friction and gravity."""

from __future__ import annotations

import re

from servobench.identification.models.base import STRUCTURES, Parameter
from servobench.identification.models.common_parameters import COULOMB, DELAY, GAIN, OFFSET, TIME_CONSTANT
from servobench.identification.models.nonlinear.structure import (
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
    "friction first (none, coulomb, asymmetric for unequal friction in the two directions, one_way for a motor that "
    "turned one way only), then stribeck for friction that falls with the speed, gravity for an arm or a pendulum, "
    "load for friction that grows with gravity's load; stribeck and load need a friction, load needs gravity"
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


def with_term(name: str, term: str) -> str | None:
    """Return the name of the structure with a term more: coulomb, asymmetric, stribeck, gravity, load; None where there is none.

    "coulomb_gravity" is both at once, for a structure that has neither. A structure without friction gets Coulomb friction with a
    Stribeck term, and one whose Coulomb friction was the same in both directions gets one for each.
    """
    if term == "coulomb_gravity":
        return with_term("first_order_coulomb", "gravity") if name == "first_order" else None
    has = name.removeprefix("first_order").split("_")
    if not name.startswith("first_order") or term in has:
        return None
    friction = next((f for f in ("asymmetric", "coulomb", "one_way") if f"_{f}" in name), "")
    if term == "coulomb":
        friction = friction or "coulomb"
    elif term == "asymmetric":
        friction = "asymmetric" if friction != "one_way" else ""
    elif term == "stribeck":
        friction = friction or "coulomb"
    parts = ["first_order", friction, *(t for t in ("stribeck", "gravity", "load") if t in has or t == term)]
    richer = "_".join(part for part in parts if part)
    return richer if richer != name and ladder(richer) is not None else None


STRUCTURES.family(FORM, ladder, MEANING)
