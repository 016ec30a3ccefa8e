"""The limits of a fleet's motors, as a TOML file says them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from servobench.core.errors import FormatError, UnitError, UnknownName, UsageError
from servobench.core.parameter_names import PARAMETER_NAMES
from servobench.core.toml import loads
from servobench.core.units import quantity
from servobench.fleet.decision import (
    RULES,
    Decision,
    Measured,
    Rule,
    conformance_probability,
    decide,
)
from servobench.fleet.row import IDENTIFIED, Row

_COMBINATIONS = ("lag", "speed_at_level", "acceleration", "acceleration_at_level")
_EXAMPLE = 'for example: [gain] low = "22 rad/(s*V)" high = "25 rad/(s*V)"'


@dataclass(frozen=True, kw_only=True)
class Limit:
    """The limits of one parameter as they were written, a number in the results' unit or a text with its own; None for none."""

    parameter: str
    low: float | str | None
    """The lower limit."""
    high: float | str | None
    """The upper limit."""

    def ends(self, unit: str) -> tuple[float, float]:
        """Return both limits in a unit, infinite where there is none; raises `UsageError` where they measure something else."""
        ends = []
        for name, limit, none in (("low", self.low, -math.inf), ("high", self.high, math.inf)):
            try:
                ends.append(none if limit is None else quantity(limit, unit))
            except UnitError as error:
                raise UsageError(f"the limit {name} of {self.parameter}: {error}") from None
        low, high = ends
        if not low < high:
            raise UsageError(
                f"the limits of {self.parameter}: low ({self.low}) isn't below high ({self.high})"
            )
        return low, high


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """The judgement on a motor by its limits.

    `decided_by` says why, for each parameter that isn't within its limits. `consumer_risk` is, of a motor that passes, the
    largest probability that it isn't within its limits after all; `producer_risk`, of one that fails, that it is. Both are None
    elsewhere.
    """

    decision: Decision
    """Pass, fail or undecided."""
    decided_by: str
    consumer_risk: float | None = None
    producer_risk: float | None = None


@dataclass(frozen=True, kw_only=True)
class Limits:
    """The limits of several parameters, and the rule that decides."""

    rule: Rule
    limits: tuple[Limit, ...]

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Limits:
        """Return the limits in a TOML file; raises `FormatError`, which names it, where they can't be understood.

        A table for each parameter has `low`, `high` or both, numbers in SI units or texts with a unit; `rule` names the
        decision rule.
        """
        file = Path(path)
        try:
            document = loads(file.read_text(encoding="utf-8"))
        except OSError as error:
            raise FormatError(f"{file} can't be read: {error.strerror or error}") from error
        except (ValueError, RecursionError) as error:
            raise FormatError(f"{file} isn't TOML: {error}; {_EXAMPLE}") from error
        try:
            return cls.parse(document)
        except UsageError as error:
            raise FormatError(f"{file}: {error}") from None

    @classmethod
    def parse(cls, document: Mapping[str, Any]) -> Limits:
        """Return the limits in plain data; raises `UsageError` where they can't be understood."""
        name = document.get("rule", "iso-14253-1")
        if not isinstance(name, str) or name not in RULES:
            raise UnknownName("decision rule", name, RULES)
        limits = tuple(_limit(each, value) for each, value in document.items() if each != "rule")
        if not limits:
            raise UsageError(f"there are no limits in it; {_EXAMPLE}")
        return cls(rule=RULES[name], limits=limits)

    def judge(self, row: Row) -> Judgement:
        """Return what the limits say of a motor; raises `UsageError` where they have the unit of another quantity.

        A motor fails if a parameter does, and passes if all do. It is undecided where there is no trusted result, or a parameter
        isn't known.
        """
        if row["outcome"] != IDENTIFIED or row.get("verdict") != "trusted":
            verdict = row.get("verdict") or row["outcome"]
            return Judgement(decision=Decision.UNDECIDED, decided_by=f"{verdict}: {row['reason']}")
        outside, open_, outside_chance, inside_chance = [], [], 0.0, 1.0
        for limit in self.limits:
            measured = _value_of(row, limit.parameter)
            if measured is None:
                open_.append(f"{limit.parameter} isn't known")
                continue
            low, high = limit.ends(row[f"{limit.parameter}_unit"])
            decision = decide(measured, low, high, self.rule)
            chance = conformance_probability(measured, low, high)
            if decision is Decision.FAIL:
                outside.append(
                    f"{limit.parameter} is {'below' if measured.value < low else 'above'} its limits"
                )
                inside_chance = min(inside_chance, chance)
            elif decision is Decision.UNDECIDED:
                open_.append(f"{limit.parameter} is within its limits with {_percent(chance)}")
            outside_chance += 1.0 - chance
        if outside:
            return Judgement(
                decision=Decision.FAIL, decided_by="; ".join(outside), producer_risk=inside_chance
            )
        if open_:
            return Judgement(decision=Decision.UNDECIDED, decided_by="; ".join(open_))
        # However the parameters' errors go together: the probability of any is at most the sum of all.
        return Judgement(decision=Decision.PASS, decided_by="", consumer_risk=min(1.0, outside_chance))


def _value_of(row: Row, name: str) -> Measured | None:
    if row.get(f"{name}_state") != "known" or any(
        row.get(each) is None for each in (name, f"{name}_low", f"{name}_high")
    ):
        return None
    return Measured(value=row[name], low=row[f"{name}_low"], high=row[f"{name}_high"])


def _limit(name: str, entry: Any) -> Limit:
    known = (*PARAMETER_NAMES, *_COMBINATIONS)
    if name not in known:
        raise UnknownName("parameter", name, known)
    if not isinstance(entry, Mapping) or not entry or not set(entry) <= {"low", "high"}:
        raise UsageError(f"[{name}]: expected low, high or both, {_EXAMPLE}")
    for end, value in entry.items():
        if isinstance(value, bool) or not isinstance(value, int | float | str) or value != value:
            raise UsageError(
                f'[{name}]: {end} is {value!r}; expected a number, or a text with a unit such as "120 ms"'
            )
    return Limit(parameter=name, low=entry.get("low"), high=entry.get("high"))


def _percent(probability: float) -> str:
    return f"{100 * probability:.3g} %"
