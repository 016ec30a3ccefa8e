"""The interface of a check, and its outcome."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from servobench.core.errors import DeviceError
from servobench.core.parameter_names import plain_words
from servobench.rig.wire.conformance.session import Session

Verdict: TypeAlias = Literal["passed", "failed", "not offered"]
Run: TypeAlias = Callable[[Session], str | None]
"""Carries a check out; returns None where it passed, or what the board doesn't offer. Raises `Broken` where it fails."""


class Broken(Exception):
    """The board doesn't keep a rule; says what it did, and what was expected."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """A rule of the protocol, and how it is tried."""

    name: str
    """Its name in the table."""
    rule: str
    """The sentence of docs/reference/rig-protocol.md that it tests."""
    run: Run
    """The procedure."""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A check's outcome."""

    check: Check
    """The check."""
    verdict: Verdict
    """Whether the board keeps the rule."""
    found: str = ""
    """The observation if the check fails, or the feature that the board lacks."""


def rule(checks: list[Check], sentence: str) -> Callable[[Run], Run]:
    """Decorate a function as the check of that sentence; its name becomes the check's."""

    def add(run: Run) -> Run:
        name = plain_words(getattr(run, "__name__", "").strip("_"))
        checks.append(Check(name=name, rule=sentence, run=run))
        return run

    return add


def expect(holds: bool, sentence: str) -> None:
    """Raise `Broken` with what was found and expected, unless it holds."""
    if not holds:
        raise Broken(sentence)


def outcomes(checks: Iterable[Check], session: Session) -> Iterator[Outcome]:
    """Carry checks out, one after the other; the board is brought to rest before each and after the last.

    Raises `OSError` where the port is gone.
    """
    for check in checks:
        yield _outcome(check, session)
    session.end()


def _outcome(check: Check, session: Session) -> Outcome:
    try:
        session.rest()
        missing = check.run(session)
    except (Broken, DeviceError) as error:
        return Outcome(check=check, verdict="failed", found=str(error))
    return Outcome(check=check, verdict="not offered" if missing else "passed", found=missing or "")
