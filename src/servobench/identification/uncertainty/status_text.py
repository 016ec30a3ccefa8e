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
        value, high = answer.estimate.value, answer.estimate.interval[1]
        # The upper end alone is shown, with the digits of its own distance.
        told = rounded_interval(value, (2.0 * value - high, high), answer.estimate.unit)
        return f"at most {told.high} {told.unit}".rstrip()
    return "not known"
