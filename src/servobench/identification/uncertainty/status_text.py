"""The text for a parameter that isn't known by itself, in a few words, for tables."""

from __future__ import annotations

from servobench.core.rounding import rounded_interval
from servobench.identification.uncertainty.identifiability import ParameterStatus, State


def in_words(answer: ParameterStatus | None) -> str:
    """Return what stands in place of a value that isn't known by itself; empty where it is, and without an answer."""
    if answer is None or answer.state is State.KNOWN:
        return ""
    if answer.state is State.COMBINATION:
        return "known together only"
    if answer.state is State.BOUNDED:
        estimate = answer.estimate
        bound = at_least if answer.mirrored else at_most
        return bound(estimate.value, estimate.interval, estimate.unit)
    return "not known"


def at_least(value: float, interval: tuple[float, float], unit: str) -> str:
    """Return the lower end of an interval in the same way as `at_most` its upper one."""
    low, high = interval
    rounded = rounded_interval(value, (low, 2.0 * value - low if low < value else high), unit)
    return f"at least {rounded.low} {rounded.unit}".rstrip()


def at_most(value: float, interval: tuple[float, float], unit: str) -> str:
    """Return the upper end of an interval, with the digits of its own distance from the value: a lower end far away has no say.

    Where the value is at that end, those of the whole interval.
    """
    low, high = interval
    rounded = rounded_interval(value, (2.0 * value - high if high > value else low, high), unit)
    return f"at most {rounded.high} {rounded.unit}".rstrip()
