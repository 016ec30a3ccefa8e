"""The catalogue that the stand-in for the panel's server gives: the library's own signals and controllers."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from servobench.control.base import CONTROLLERS
from servobench.settings import In
from servobench.signals.base import SIGNALS


def _within(annotation: Any) -> Iterator[Any]:
    """A type, what marks it, and all that it is made of."""
    yield annotation
    yield from getattr(annotation, "__metadata__", ())
    if get_origin(annotation) is not Literal:
        for each in get_args(annotation):
            yield from _within(each)


def _unit(field: Any) -> str:
    marks = (mark for mark in [*field.metadata, *_within(field.annotation)] if isinstance(mark, In))
    return next((mark.si for mark in marks), "")


def _choices(annotation: Any) -> list[Any]:
    literals = (each for each in _within(annotation) if get_origin(each) is Literal)
    return [choice for each in literals for choice in get_args(each)]


def _field(name: str, field: Any) -> dict[str, Any]:
    default = None if field.is_required() else field.get_default(call_default_factory=True)
    if field.is_required() and field.examples:
        default = field.examples[0]
    bounds = {type(mark).__name__: mark for mark in field.metadata}
    low = bounds.get("Ge") or bounds.get("Gt")
    high = bounds.get("Le") or bounds.get("Lt")
    return {
        "name": name,
        "unit": _unit(field),
        "default": list(default) if isinstance(default, tuple) else default,
        "minimum": getattr(low, "ge", getattr(low, "gt", None)),
        "maximum": getattr(high, "le", getattr(high, "lt", None)),
        "choices": _choices(field.annotation),
        "sentence": field.description or "",
    }


def _member(name: str, member: Any) -> dict[str, Any]:
    sentence = (sys.modules[member.__module__].__doc__ or "").strip().splitlines()[0]
    fields = [_field(field.alias or key, field) for key, field in member.model_fields.items()]
    return {
        "name": name,
        "title": name.replace("_", " ").capitalize(),
        "sentence": sentence,
        "fields": fields,
    }


def catalogue() -> dict[str, Any]:
    """What GET /api/catalogue answers."""
    amplitude = {
        "name": "noise",
        "unit": "rad",
        "default": 0.0,
        "minimum": 0,
        "maximum": None,
        "choices": None,
        "sentence": "Noise of the encoder [rad].",
    }
    return {
        "signals": [_member(name, SIGNALS[name]) for name in SIGNALS.names()],
        "controllers": [_member(name, CONTROLLERS[name]) for name in CONTROLLERS.names()],
        "devices": [
            {
                "name": "twin",
                "title": "QUBE-Servo, simulated",
                "sentence": "The simulated motor.",
                "fields": [amplitude],
            },
            {
                "name": "replay",
                "title": "Replay",
                "sentence": "A recording played as a device.",
                "fields": [],
            },
        ],
        "units": {"encoder": ["counts", "deg", "rad"]},
    }
