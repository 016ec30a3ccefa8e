"""What can be had: the members of a kind, each with its settings, their units and defaults, as its own model tells them."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rich.console import Console
from rich.text import Text

from servobench.cli.layout import show_table, show_wrapped
from servobench.core.errors import UnknownName
from servobench.core.settings import unit_of


def show_members(
    console: Console,
    kind: str,
    members: Mapping[str, type],
    settings: Mapping[str, type[BaseModel]],
    name: str | None,
) -> None:
    """Print the member of that name, or all members: what it is in a sentence, and its settings.

    `settings` are the models of the members' settings. Raises `UnknownName`.
    """
    if name is not None and name not in members:
        raise UnknownName(kind, name, members)
    for each in [name] if name is not None else members:
        show_wrapped(console, Text(f"{each}  ", style="bold"), what_it_is(members[each]), hanging=0)
        fields = settings[each].model_fields.items()
        if fields:
            rows = [(field.alias or key, default_text(field), meaning(field)) for key, field in fields]
            show_table(console, ("setting", "default", "meaning"), rows)
        console.print()


def default_text(field: FieldInfo) -> str:
    """Return a setting's default as a file has it, with its unit."""
    if field.is_required():
        return "required"
    default, unit = field.get_default(call_default_factory=True), unit_of(field)
    if default is None:
        return f"not set [{unit}]" if unit else "not set"
    return f"{_as_written(default)} {unit}".rstrip()


def meaning(field: FieldInfo) -> str:
    """Return what a setting means, without its unit, and the values to choose from where the sentence doesn't tell them."""
    sentence = field.description or ""
    unit_at = sentence.rfind(" [")
    if unit_at > 0 and sentence.endswith(("].", "]")):
        sentence = f"{sentence[:unit_at]}."
    choices = [_as_written(choice) for choice in _choices(field.annotation)]
    if all(choice in sentence for choice in choices):
        return sentence
    return f"{sentence.rstrip('.')}: {', '.join(choices)}."


def what_it_is(member: type) -> str:
    """Return what a member is: the first line of its file, as a file is one of the kind."""
    said = sys.modules[member.__module__].__doc__ or member.__doc__ or ""
    return (said.strip().splitlines() or [""])[0]


def _choices(annotation: Any) -> tuple[object, ...]:
    """The values that a type allows where it names them one by one."""
    if get_origin(annotation) is Literal:
        return get_args(annotation)
    return tuple(choice for each in get_args(annotation) for choice in _choices(each))


def _as_written(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list | tuple):
        return ", ".join(map(_as_written, value))
    return str(value)
