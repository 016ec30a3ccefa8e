"""Lists of the members of a kind, each with its settings, units and defaults, taken from its settings model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rich.text import Text

from servobench.cli.layout import show_table, show_wrapped
from servobench.cli.terminal import output, print_json
from servobench.core.errors import UnknownName
from servobench.core.registry import Registry
from servobench.core.settings import unit_of

_SHORT = 40  # characters; parts of a list that are longer have a line each
SCHEMA = "servobench.catalogue/1"


@dataclass(frozen=True, kw_only=True)
class Member:
    """The entry of the member `name` of a kind: a `sentence`, its `settings` or `parameters`, and other `facts`."""

    name: str
    sentence: str
    settings: tuple[Mapping[str, Any], ...] = ()
    parameters: tuple[Mapping[str, Any], ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)


def with_settings(
    registry: Registry[Any], settings: Callable[[Any], type[BaseModel]] = lambda member: member
) -> list[Member]:
    """Return the members of a kind with their settings; `settings` gives the model of a member's."""
    return [
        Member(
            name=name,
            sentence=registry.sentence(name),
            settings=tuple(
                {
                    "name": each.alias or key,
                    "default": default_text(each),
                    "required": each.is_required(),
                    "unit": unit_of(each),
                    "meaning": meaning(each),
                }
                for key, each in settings(registry[name]).model_fields.items()
            ),
        )
        for name in registry.names()
    ]


def list_members(kind: str, members: Sequence[Member], name: str | None, as_json: bool) -> None:
    """Print the member of that name, or all members, as words or as JSON; raises `UnknownName`."""
    known = {each.name: each for each in members}
    if name is not None and name not in known:
        raise UnknownName(kind, name, known)
    chosen = list(members) if name is None else [known[name]]
    if as_json:
        print_json({"schema": SCHEMA, "kind": kind, "members": [_plain(each) for each in chosen]})
        return
    console = output()
    for each in chosen:
        show_wrapped(console, Text(f"{each.name}  ", style="bold"), each.sentence, hanging=0)
        for fact, value in each.facts.items():
            parts = (value or ["none"]) if isinstance(value, list) else [value]
            lines = parts if any(len(part) > _SHORT for part in parts) else [", ".join(parts)]
            for line in lines:
                show_wrapped(console, Text("  "), f"{fact}: {line}", hanging=4)
        if each.settings:
            rows = [(row["name"], row["default"], row["meaning"]) for row in each.settings]
            show_table(console, ("setting", "default", "meaning"), rows)
        if each.parameters:
            rows = [(row["name"], row["unit"], row["meaning"]) for row in each.parameters]
            show_table(console, ("parameter", "unit", "meaning"), rows)
        console.print()


def _plain(member: Member) -> dict[str, Any]:
    return {
        "name": member.name,
        "sentence": member.sentence,
        "settings": [dict(each) for each in member.settings],
        "parameters": [dict(each) for each in member.parameters],
        "facts": dict(member.facts),
    }


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
