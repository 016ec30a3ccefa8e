"""Checks of an exercise's rules before anything is run: whether their facts are known, and whether their units fit.

Names are checked of all rules, but for what a study finds (`NAME_...`), which only its run tells. The unit of a blank is held
against the dimension of its answer where that follows from the facts: a number such as 10 in it may be 10 V, and then nothing
follows. 1, 1000, a million and a billion count as changes of prefix; where there is no number at all, the unit can have no
prefix. Angles, counts and per cent count as plain numbers. The unit of a correction is checked likewise.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING, TypeAlias

from servobench.core.errors import UnknownName, UsageError
from servobench.core.units import Unit
from servobench.core.units import unit as unit_named
from servobench.lab.expression import Expression
from servobench.lab.studies.values import Values

if TYPE_CHECKING:
    from servobench.lab.exercise import Exercise

_Powers: TypeAlias = tuple[float, float, float, float]
"""Powers of kg, m, s and A."""

_NUMBER: _Powers = (0.0, 0.0, 0.0, 0.0)
_PREFIXES = (1.0, 1e3, 1e6, 1e9)
_SHEET = "sheet_"
_DEVICE = {"counts_per_rev": "counts/rev", "counter_bits": "1", "voltage_limit": "V"}
_STATED = {"sample_time": "s", "duration": "s", **_DEVICE}
_READ = {"read_gain": "rad/(s·V)", "read_time_constant": "s", "chain_lag": "s"}
_MOTOR = {
    "resistance": "Ω",
    "inductance": "H",
    "motor_constant": "V·s/rad",
    "rotor_inertia": "kg·m²",
    "hub_inertia": "kg·m²",
    "disc_inertia": "kg·m²",
    "inertia": "kg·m²",
    "viscous_friction": "N·m·s/rad",
    "coulomb_torque": "N·m",
    "dead_band": "V",
    "gain": "rad/(s·V)",
    "time_constant": "s",
    "delay": "s",
}
# Between them these have all terms of the ladder, whose structures are made from their names.
_LADDER = ("first_order_coulomb_stribeck_gravity_load", "first_order_asymmetric_gravity")


@cache
def identifiable() -> Mapping[str, str]:
    """Return the units of all parameters that a recording may tell, by name: of an angle in rad and an input in V."""
    from servobench.identification.models.base import STRUCTURES

    structures = (*STRUCTURES, *(STRUCTURES[name] for name in _LADDER))
    return {
        parameter.name: parameter.unit.format(position="rad", input="V")
        for structure in structures
        for parameter in structure.parameters
    }


@cache
def units_of_facts() -> Mapping[str, str]:
    """Return the units of all facts by name, but for those of studies."""
    sheet = {f"{_SHEET}{name}": unit for name, unit in {**_MOTOR, **_DEVICE}.items()}
    return {**identifiable(), **_STATED, **_READ, **sheet}


def check_blanks(exercise: Exercise) -> None:
    """Raise `UsageError`, with file and line, for the first blank whose id another has already."""
    lines_by_id: dict[str, int] = {}
    for blank, line in zip(exercise.blanks, exercise.lines, strict=True):
        if blank.id in lines_by_id:
            raise UsageError(
                f"{exercise.source}:{line}: two blanks have the id {blank.id!r}, the other in line {lines_by_id[blank.id]}; "
                "give each its own"
            )
        lines_by_id[blank.id] = line


def check_rules(exercise: Exercise) -> None:
    """Raise `UsageError`, with file and line, for the first rule with an unknown fact, or a unit that can't fit."""
    for place, text in _rules(exercise):
        try:
            _check_names(exercise, Expression(text).names)
        except UsageError as error:
            raise UsageError(f"{place}: `{text}`: {error}") from None
    for blank in exercise.blanks:
        _check_sums(f"{exercise.place(blank)}: blank {blank.id!r}", blank.answer)
        _check_unit(f"{exercise.place(blank)}: blank {blank.id!r}", blank.answer, blank.unit, "the blank")
    for each in exercise.corrections:
        if each.answer:
            place = f"{exercise.place_of_correction(each)}: the correction of {each.where!r}"
            _check_unit(place, each.answer, each.unit, "the correction")


def _rules(exercise: Exercise) -> Iterator[tuple[str, str]]:
    """The rules of an exercise, each with the place where it stands."""
    for blank in exercise.blanks:
        place = f"{exercise.place(blank)}: blank {blank.id!r}"
        yield place, blank.answer
        for mistake in blank.mistakes:
            yield f"{place}, a mistake", mistake.answer
    for name, study in exercise.studies.items():
        if isinstance(study, Values):
            for row in study.rows:
                yield f"{exercise.place_of_study(name)}: the study {name!r}", row.answer
    for correction in exercise.corrections:
        if correction.answer:
            yield (
                f"{exercise.place_of_correction(correction)}: the correction of {correction.where!r}",
                correction.answer,
            )


def _check_names(exercise: Exercise, names: Iterable[str]) -> None:
    known = units_of_facts()
    for name in names:
        study, _, rest = name.partition("_")
        if rest and study in exercise.studies:
            continue
        if name not in known:
            raise UnknownName("fact", name, [*known, *(f"{study}_..." for study in exercise.studies)])
        if name.startswith(_SHEET) and not exercise.experiment.nominal:
            raise UsageError(
                f"{name!r} comes from a data sheet, and the experiment names none; add nominal to the table "
                "[experiment]"
            )


def _check_unit(place: str, answer: str, unit: str, of: str) -> None:
    """Raise `UsageError` where an answer can't be in the unit that stands beside it, which is the unit `of` something."""
    tree = ast.parse(answer.strip(), mode="eval").body
    powers = _powers(tree)
    if powers is None:
        return
    own = unit_named(unit or "1")
    if powers != _mechanical(own):
        raise UsageError(
            f"{place}: `{answer}` comes out in {_unit_text(powers)}, apart from a prefix or an angle, and the unit of "
            f"{of} is {unit or 'none'!r}; correct one of them"
        )
    if powers != _NUMBER and own.factor != 1.0 and not _has_numbers(tree) and not _counts(tree):
        raise UsageError(
            f"{place}: `{answer}` comes out in {_unit_text(powers)}, as facts are in SI units, and the unit of {of} is "
            f"{unit!r}; multiply by {1 / own.factor:.6g}, or use the SI unit"
        )


def _check_sums(place: str, answer: str) -> None:
    """Raise `UsageError` for a sum of facts that differ in kind; a number in it may have any unit. A paper's sums may do so."""
    for node in ast.walk(ast.parse(answer.strip(), mode="eval")):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
            a, b = _powers(node.left), _powers(node.right)
            if a is None or b is None or a == b or _has_numbers(node.left) or _has_numbers(node.right):
                continue
            one, other = (f"`{ast.unparse(side)}`" for side in (node.left, node.right))
            raise UsageError(
                f"{place}: `{answer}`: {one} is in {_unit_text(a)} and {other} in {_unit_text(b)}; different quantities can't "
                "be added or subtracted"
            )


def _unit_text(powers: _Powers) -> str:
    si = Unit(symbol="", factor=0.0, dimension=(*powers, 0.0, 0.0, 0.0)).si
    if si == "1":
        return "no unit"
    # As the list of facts has it, rather than in base units: rad/(s·V) for kg^-1·m^-2·s^2·A.
    names = (unit for unit in units_of_facts().values() if _mechanical(unit_named(unit)) == powers)
    return next(names, si) if "·" in si else si


def _has_numbers(node: ast.expr) -> bool:
    """Whether there are numbers in an expression that may stand for a prefix or a quantity: exponents and logarithms don't."""
    match node:
        case ast.Constant():
            return True
        case ast.Name(id=name):
            return name == "pi"
        case ast.UnaryOp(operand=inner):
            return _has_numbers(inner)
        case ast.Call(func=ast.Name(id=name), args=[inner]):
            return name not in ("exp", "log") and _has_numbers(inner)
        case ast.BinOp(left=left, op=ast.Pow()):
            return _has_numbers(left)
        case ast.BinOp(left=left, right=right):
            return _has_numbers(left) or _has_numbers(right)
    return True


def _counts(tree: ast.expr) -> bool:
    """Whether counts stand in an expression: there a turn may be one, 2π or 2048."""
    return any(isinstance(node, ast.Name) and "count" in node.id for node in ast.walk(tree))


def _mechanical(unit: Unit) -> _Powers:
    kg, m, s, a = unit.dimension[:4]
    return kg, m, s, a


def _powers(node: ast.expr) -> _Powers | None:
    """The dimension of what an expression gives; None where a number or a study in it may have any."""
    match node:
        case ast.Constant(value=number):
            return _NUMBER if number in _PREFIXES else None
        case ast.Name(id=name):
            unit = "1" if name == "pi" else units_of_facts().get(name)
            return None if unit is None else _mechanical(unit_named(unit))
        case ast.UnaryOp(operand=inner):
            return _powers(inner)
        case ast.Call(func=ast.Name(id=name), args=[inner]):
            if name in ("exp", "log"):
                return _NUMBER
            return _times(_powers(inner), 0.5 if name == "sqrt" else 1.0)
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            # -2 is a sign before a number; any other exponent than a number leaves open what comes out.
            sign, size = (-1.0, right.operand) if isinstance(right, ast.UnaryOp) else (1.0, right)
            return _times(_powers(left), sign * float(size.value)) if isinstance(size, ast.Constant) else None  # type: ignore[arg-type]
        case ast.BinOp(left=left, op=op, right=right):
            return _combine(left, op, right)
    return None


def _combine(left: ast.expr, op: ast.operator, right: ast.expr) -> _Powers | None:
    a, b = _powers(left), _powers(right)
    if isinstance(op, ast.Add | ast.Sub):
        # A number that stands by itself in a sum is in the unit of the rest.
        open_ended = [isinstance(node, ast.Constant) for node in (left, right)]
        if any(open_ended) and not all(open_ended):
            return b if open_ended[0] else a
        return a if a == b else None
    sign = 1.0 if isinstance(op, ast.Mult) else -1.0
    other = _times(b, sign)
    if a is None or other is None:
        return None
    return a[0] + other[0], a[1] + other[1], a[2] + other[2], a[3] + other[3]


def _times(powers: _Powers | None, factor: float) -> _Powers | None:
    if powers is None:
        return None
    kg, m, s, a = powers
    return kg * factor, m * factor, s * factor, a * factor
