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
        return bound_text(estimate.value, estimate.interval, estimate.unit, answer.mirrored)
    return "not known"


def bound_text(value: float, interval: tuple[float, float], unit: str, mirrored: bool = False) -> str:
    """Return the upper end of an interval, or `mirrored` the lower one, as `at most 0.33 V`.

    It has the digits of its own distance from the value: the other end, which may be far away, has no say. Where the value is at
    the end, those of the whole interval.
    """
    low, high = interval
    if mirrored:
        rounded = rounded_interval(value, (low, 2.0 * value - low if low < value else high), unit)
        return f"at least {rounded.low} {rounded.unit}".rstrip()
    rounded = rounded_interval(value, (2.0 * value - high if high > value else low, high), unit)
    return f"at most {rounded.high} {rounded.unit}".rstrip()
