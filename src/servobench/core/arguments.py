"""Checks of the arguments of public functions: a wrong type gives a sentence instead of a traceback."""

from __future__ import annotations

from collections.abc import Mapping
from numbers import Real

from servobench.core.errors import UsageError


def text_of_value(value: object) -> str:
    """Return a value in a few words: what it is, and its beginning or its shape where that tells more."""
    if value is None:
        return "None"
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple):
        return f"an object of type {type(value).__name__} and shape {shape}"
    text = repr(value)
    return f"{text if len(text) <= 40 else text[:37] + '...'} ({type(value).__name__})"


def check_mapping(argument: str, value: object, example: str) -> None:
    """Raise `UsageError` where an argument is no mapping from texts; `example` is one that would do.

    >>> check_mapping("known", [8.4], '{"resistance": 8.4}')
    Traceback (most recent call last):
    ...
    servobench.core.errors.UsageError: known is [8.4] (list); expected a dict such as {"resistance": 8.4}
    """
    if not (isinstance(value, Mapping) and all(isinstance(name, str) for name in value)):
        raise UsageError(f"{argument} is {text_of_value(value)}; expected a dict such as {example}")


def to_number(argument: str, value: object) -> float:
    """Return an argument as a number; raises `UsageError` where it is none.

    >>> to_number("start['start_speed']", "fast")
    Traceback (most recent call last):
    ...
    servobench.core.errors.UsageError: start['start_speed'] is 'fast' (str); expected a number
    """
    if not isinstance(value, Real):
        raise UsageError(f"{argument} is {text_of_value(value)}; expected a number")
    return float(value)


def check_type(argument: str, value: object, kinds: type | tuple[type, ...], expected: str) -> None:
    """Raise `UsageError` where an argument is none of some types; `expected` says which it has to be, and where it comes from.

    >>> check_type("data", [1.0], dict, "a dict")
    Traceback (most recent call last):
    ...
    servobench.core.errors.UsageError: data is [1.0] (list); expected a dict
    """
    if not isinstance(value, kinds):
        raise UsageError(f"{argument} is {text_of_value(value)}; expected {expected}")
