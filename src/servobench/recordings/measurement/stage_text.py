"""The words of a stage's text: how numbers with units are read and written."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from servobench.core.errors import UnitError, UsageError
from servobench.core.units import convert

_NUMBER_AND_UNIT = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)")


def number_and_unit(name: str, words: Sequence[str], examples: Sequence[str]) -> tuple[float, str]:
    """Return the number that the words after a stage's name begin with, and the rest, empty where there is no more.

    Raises `UsageError`, with examples of how to write it, where there is no finite number.
    """
    text = " ".join(words)
    match = _NUMBER_AND_UNIT.fullmatch(text)
    if match is None or not math.isfinite(float(match[1])):
        raise UsageError(f"`{' '.join([name, *words])}`: {expectation('a number', examples)}")
    return float(match[1]), match[2]


def quantity_in(si: str, name: str, words: Sequence[str], examples: Sequence[str]) -> float:
    """Return the quantity that the words after a stage's name give, in the unit `si`.

    The unit has to be there: of `lowpass 50` nobody can tell whether it means rad/s or Hz.
    Raises `UsageError`, with examples of how to write it.
    """
    number, symbol = number_and_unit(name, words, examples)
    text = f"`{name} {' '.join(words)}`"
    if not symbol:
        raise UsageError(f"{text}: {expectation('a number with its unit', examples)}")
    try:
        return convert(number, symbol, si)
    except UnitError as error:
        raise UsageError(f"{text}: {error}; {expectation('a number with its unit', examples)}") from None


def expectation(what: str, examples: Sequence[str]) -> str:
    """Return the part of a message that says what was expected, with examples."""
    return f"expected {what}, such as {' or '.join(f'`{example}`' for example in examples)}"
