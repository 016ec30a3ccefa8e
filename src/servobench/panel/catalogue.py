"""The choices on the page: signals, controllers and devices, each with the settings of its model."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import PurePath
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, TypeAdapter
from pydantic.fields import FieldInfo

from servobench.core.parameter_names import plain_words
from servobench.core.settings import MemberOf, unit_of

_UNITS = {"encoder": ["counts", "deg", "rad"]}
_ON_DATA_SHEETS = {
    *("resistance", "inductance", "motor_constant", "rotor_inertia", "hub_inertia", "disc_inertia"),
    *("amplifier_limit", "dead_band", "counts_per_rev", "counter_bits"),
}
_INITIALS = ("pid", "prbs")


def catalogue() -> dict[str, Any]:
    """Return all that can be chosen, as JSON can hold it."""
    from servobench.rig.devices.base import DEVICES
    from servobench.systems.control.base import CONTROLLERS
    from servobench.systems.signals.base import SIGNALS

    return {
        "signals": [member(name, SIGNALS[name], SIGNALS[name]) for name in SIGNALS.names()],
        "controllers": [member(name, CONTROLLERS[name], CONTROLLERS[name]) for name in CONTROLLERS.names()],
        "devices": [_device(member(name, DEVICES[name], DEVICES[name].Settings)) for name in DEVICES.names()],
        "units": _UNITS,
    }


def _device(known: dict[str, Any]) -> dict[str, Any]:
    """A device, with the motors and solvers that there are to choose from, and what its data sheet says where nothing is set."""
    from servobench.rig.motor.parameters import DATA_SHEETS
    from servobench.rig.motor.solvers.base import SOLVERS

    choices = {"motor": list(DATA_SHEETS), "solver": list(SOLVERS.names())}
    fields = {field["name"]: field for field in known["fields"]}
    for name in choices.keys() & fields.keys():
        fields[name]["choices"] = choices[name]
    for name in _ON_DATA_SHEETS & fields.keys():
        if "motor" in fields and fields[name]["default"] is None:
            fields[name]["unset"] = "data sheet"
    return known


def member(name: str, kind: type, settings: Any) -> dict[str, Any]:
    """Return one member of a kind: its name, its title, a sentence, and its settings."""
    lines = (sys.modules[kind.__module__].__doc__ or kind.__doc__ or name).strip().splitlines()
    fields: dict[str, FieldInfo] = settings.model_fields if issubclass(settings, BaseModel) else {}
    return {
        "name": name,
        "title": name.upper() if name in _INITIALS else plain_words(name).capitalize(),
        "sentence": lines[0],
        "fields": [field_of(key, field) for key, field in fields.items()],
    }


def field_of(key: str, field: FieldInfo) -> dict[str, Any]:
    """Return one setting: what it is called, its type, unit, default and bounds, the values to choose from, and what it means."""
    return {
        "name": field.alias or key,
        "type": _type(field.annotation),
        "unit": unit_of(field),
        "default": _default(field),
        "required": field.is_required(),
        "minimum": _bound(field.metadata, ("ge", Ge), ("gt", Gt), max),
        "maximum": _bound(field.metadata, ("le", Le), ("lt", Lt), min),
        "choices": [_plain(choice) for choice in _choices(field.annotation)],
        "parts": _parts(key, field.annotation),
        "sentence": field.description or "",
    }


def _type(annotation: Any) -> str:
    """The type of a setting: `number`, `text` (a path, too), `number or text`, `truth`, `numbers`; `table` is all else."""
    if isinstance(annotation, type):
        if issubclass(annotation, bool):
            return "truth"
        if issubclass(annotation, int | float):
            return "number"
        return "text" if issubclass(annotation, str | PurePath) else "table"
    inner = [each for each in get_args(annotation) if each not in (None, type(None), Ellipsis)]
    if get_origin(annotation) is Annotated:
        return _type(inner[0])
    if get_origin(annotation) is Literal:
        return _type(type(inner[0]))
    kinds = {_type(each) for each in inner}
    if get_origin(annotation) is tuple:
        return "numbers" if kinds == {"number"} else "table"
    if get_origin(annotation) not in (Union, UnionType):
        return "table"
    if kinds == {"number", "text"}:
        return "number or text"
    return kinds.pop() if len(kinds) == 1 else "table"


def _parts(key: str, annotation: Any) -> dict[str, Any] | None:
    """The fields that each of several signals in a setting has, None for a setting without signals.

    `each` is what one is called. `signal` is the name by which a part has its signal, beside settings of its own (`fields`); None
    where it is the signal itself.
    """
    of = get_args(annotation)
    if get_origin(annotation) is not tuple or len(of) != 2 or of[1] is not Ellipsis:
        return None
    each = key.removesuffix("s")
    if _is_signal(get_args(of[0])):
        return {"each": each, "signal": None, "fields": []}
    if not (isinstance(of[0], type) and issubclass(of[0], BaseModel)):
        return None
    signals = [name for name, field in of[0].model_fields.items() if _is_signal(field.metadata)]
    if len(signals) != 1:
        return None
    own = [field_of(name, field) for name, field in of[0].model_fields.items() if name not in signals]
    return {"each": each, "signal": signals[0], "fields": own}


def _is_signal(metadata: Iterable[Any]) -> bool:
    """Whether a type's metadata mark it as a signal."""
    return any(isinstance(mark, MemberOf) and mark.registry.kind == "signal" for mark in metadata)


def _default(field: FieldInfo) -> Any:
    """The default; of a setting that has none, its example."""
    if field.is_required():
        return _plain(field.examples[0]) if field.examples else None
    return _plain(field.get_default(call_default_factory=True))


def _plain(value: Any) -> Any:
    """A value as JSON can hold it."""
    return TypeAdapter(type(value)).dump_python(value, mode="json", fallback=str)


def _bound(metadata: Iterable[Any], closed: tuple[str, type], opened: tuple[str, type], of: Any) -> Any:
    """The narrowest of the bounds on one side; None where there is none."""
    bounds = [
        getattr(mark, name) for mark in metadata for name, kind in (closed, opened) if isinstance(mark, kind)
    ]
    return of(bounds) if bounds else None


def _choices(annotation: Any) -> tuple[object, ...]:
    """The values that a type allows where it names them one by one."""
    if get_origin(annotation) is Literal:
        return get_args(annotation)
    return tuple(choice for each in get_args(annotation) for choice in _choices(each))
