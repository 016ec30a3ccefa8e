"""Single numbers: a check that one is above zero, and its shortest text."""

from __future__ import annotations

import math

from servobench.core.errors import UsageError


def check_positive(what: str, value: float, unit: str) -> None:
    """Raise `UsageError` unless the value is a positive finite number."""
    if not 0.0 < value < math.inf:
        raise UsageError(f"{what} is {value:g} {unit}; expected a positive finite number")


def number_text(value: float) -> str:
    """Return the shortest text that reads back as the same number."""
    return repr(float(value)).removesuffix(".0")
