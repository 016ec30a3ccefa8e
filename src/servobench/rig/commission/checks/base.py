"""The kind `checks`: each finds out one fact of a bench that is commissioned.

A member is a class that `CHECKS.member(name)` decorates. Adding one is adding a file; `place` says where in the order it comes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal, Protocol, TypeAlias

from servobench.core.registry import Registry
from servobench.core.rounding import rounded_interval, with_unit

if TYPE_CHECKING:
    from servobench.rig.commission.bench import Bench

State: TypeAlias = Literal["verified", "failed", "unsupported", "unknown"]


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One thing that a check measured: its name, value, unit and, where one follows from the data, the interval it lies in."""

    name: str
    value: float
    unit: str
    interval: tuple[float, float] | None = None

    def __str__(self) -> str:
        if self.interval is None:
            return with_unit(self.value, self.unit)
        return str(rounded_interval(self.value, self.interval, self.unit))


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A check's outcome: its state, what was done, what was expected, what was found, and what to do about it.

    `found` is a sentence, `figures` are what was measured, `remedy` is empty where there is nothing to be done. `learned` is what
    later checks need, in SI units or counts.
    """

    state: State
    did: str
    """The check's action, in a sentence."""
    expected: str
    found: str
    figures: tuple[Figure, ...] = ()
    remedy: str = ""
    carried_out: bool = True
    """Whether the check had its turn."""
    learned: Mapping[str, float] = field(default_factory=dict)


def as_sentence(text: str) -> str:
    """Return what a device or the guard said as a sentence: with a capital letter and one full stop."""
    text = text.rstrip(". ")
    return f"{text[:1].upper()}{text[1:]}."


def no_outcome(reason: str) -> Outcome:
    """Return the outcome of a check that wasn't carried out, for a reason that ends a sentence."""
    sentence = f"Not carried out, as {reason}."
    return Outcome(state="unknown", did="Nothing.", expected="", found=sentence, carried_out=False)


class Check(Protocol):
    """One check: where in the order it comes, and how it is carried out."""

    title: ClassVar[str]
    """The check's subject, in a few words."""
    place: ClassVar[int]
    """Checks are carried out in the order of these numbers; up to 29 at zero volts."""
    needs: ClassVar[tuple[str, ...]]
    """The checks that have to be carried out before without failing."""
    halts: ClassVar[bool]
    """Whether nothing is driven any more where it fails."""
    picture: ClassVar[str]
    """The caption of its picture, for people who would rather look than read; empty if it needs none."""

    def carry_out(self, bench: Bench) -> Outcome:
        """Do what it takes on the bench, and return what was found; raises `CheckEnded` where a run was cut short."""
        ...


CHECKS: Registry[type[Check]] = Registry(
    "check", "servobench.rig.commission.checks", "servobench.commission.checks"
)


def in_order() -> tuple[tuple[str, type[Check]], ...]:
    """Return all checks with their names, in the order in which they are carried out."""
    return tuple(sorted(((name, CHECKS[name]) for name in CHECKS.names()), key=lambda pair: pair[1].place))
