"""Stability of a transfer function, from its poles, with the reason in words and an input that shows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from servobench.core.arguments import check_type
from servobench.core.rounding import plain
from servobench.systems.stability.drive import Drive, drive_off
from servobench.systems.stability.poles import Pole, multiplicity_at, poles_of
from servobench.systems.transfer_function import TransferFunction

StabilityVerdict: TypeAlias = Literal["stable", "marginally stable", "unstable"]


@dataclass(frozen=True, kw_only=True)
class StabilityReport:
    """The poles [1/s] and their `multiplicities`; the verdict and its reasons.

    `reasons` has a sentence for each pole, one for a complex pair. The verdict is that of the poles: what the system does by
    itself. `bibo` says whether every bounded input gives a bounded output; `drive` is a bounded input for which it doesn't, and
    how the output grows then: None where there is none.
    """

    poles: tuple[complex, ...]
    multiplicities: tuple[int, ...]
    verdict: StabilityVerdict
    bibo: bool
    reasons: tuple[str, ...]
    drive: Drive | None = None


def stability(system: TransferFunction) -> StabilityReport:
    """Return whether a system is stable.

    Asymptotically stable if every pole has a negative real part. Marginally stable if the rightmost poles are simple and on the
    imaginary axis: some bounded input, a constant for an integrator, then drives the output without bound. Unstable otherwise.
    BIBO stable if the numerator cancels every pole outside the left half-plane, and its order isn't above the
    denominator's. A delay doesn't change any of this. (Franklin, Powell and Emami-Naeini 2015, chapter 3.)

    >>> from servobench import TransferFunction
    >>> motor = TransferFunction(numerator=(20.0,), denominator=(0.1, 1.0))
    >>> print(stability(motor).verdict)
    stable
    """
    check_type("system", system, TransferFunction, "a TransferFunction, such as result.transfer_function")
    poles = poles_of(system.denominator)
    # A system that is zero shows nothing of its poles.
    left_over = [
        pole.multiplicity - multiplicity_at(system.numerator, pole.at) if any(system.numerator) else 0
        for pole in poles
    ]
    visible_poles = [
        Pole(at=pole.at, multiplicity=left, uncertainty=pole.uncertainty)
        for pole, left in zip(poles, left_over, strict=True)
        if left > 0 and pole.side >= 0
    ]
    reasons = [_reason(pole, left) for pole, left in zip(poles, left_over, strict=True) if pole.at.imag >= 0]
    proper = _order(system.numerator) <= _order(system.denominator)
    if not proper:
        reasons.append(
            "The numerator's order is above the denominator's: the system differentiates, and a bounded input with "
            "jumps gives an unbounded output."
        )
    return StabilityReport(
        poles=tuple(pole.at for pole in poles),
        multiplicities=tuple(pole.multiplicity for pole in poles),
        verdict=verdict_of(poles),
        bibo=proper and not visible_poles,
        reasons=tuple(reasons),
        drive=drive_off(system, visible_poles),
    )


def verdict_of(poles: Sequence[Pole]) -> StabilityVerdict:
    """Return what a set of poles means."""
    if any(pole.side > 0 or (pole.side == 0 and pole.multiplicity > 1) for pole in poles):
        return "unstable"
    return "marginally stable" if any(pole.side == 0 for pole in poles) else "stable"


def _order(polynomial: Sequence[float]) -> int:
    leading = next((n for n, value in enumerate(polynomial) if value), len(polynomial) - 1)
    return len(polynomial) - 1 - leading


def _reason(pole: Pole, left: int) -> str:
    at, count = pole.at, pole.multiplicity
    side = (
        "in the left half-plane"
        if pole.side < 0
        else "in the right half-plane"
        if pole.side
        else "on the imaginary axis"
    )
    real = "" if pole.side == 0 and at.imag else plain(at.real)
    where = real if at.imag == 0 else f"{real} ±{plain(at.imag)}j".strip()
    times = {1: "", 2: ", twice,"}.get(count, f", {count} times,")
    if pole.side < 0:
        return f"The pole at {where} 1/s{times} is {side}: its response dies out with a time constant of {plain(1 / -at.real)} s."
    hidden = _cancellation_text(count, left)
    if pole.side > 0:
        return f"The pole at {where} 1/s{times} is {side}: its response grows without bound.{hidden}"
    if count > 1:
        return f"The pole at {where} 1/s{times} is {side}: its response grows without any input.{hidden}"
    verb = "oscillates without decay after" if at.imag else "keeps"
    bounded = "a sinusoid of that frequency" if at.imag else "a constant"
    sentence = f"The simple pole at {where} 1/s is {side}: the output {verb} its value"
    return (
        f"{sentence}.{hidden}" if hidden else f"{sentence}, and {bounded} as input drives it without bound."
    )


def _cancellation_text(count: int, left: int) -> str:
    """A sentence on a pole that zeros cancel, wholly or in part; empty where they don't."""
    if left >= count:
        return ""
    if left > 0:
        shown = {1: "once", 2: "twice"}.get(left, f"{left} times")
        return f" Zeros cancel part of it: the output shows it {shown} only, but the internal state shows all of it."
    cancel = "A zero cancels it" if count == 1 else "Zeros cancel it"
    return f" {cancel}: the output doesn't show it, but the internal state does."
