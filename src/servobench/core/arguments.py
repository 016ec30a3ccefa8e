"""What a function was given, checked where a user calls it: a wrong kind of thing is a sentence and no traceback."""

from __future__ import annotations

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


def check_type(argument: str, value: object, kinds: type | tuple[type, ...], expected: str) -> None:
    """Raise `UsageError` where an argument is none of some types; `expected` says which it has to be, and where it comes from.

    >>> check_type("data", [1.0], dict, "a dict")
    Traceback (most recent call last):
    ...
    servobench.core.errors.UsageError: data is [1.0] (list); expected a dict
    """
    if not isinstance(value, kinds):
        raise UsageError(f"{argument} is {text_of_value(value)}; expected {expected}")
