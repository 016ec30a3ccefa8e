"""Writing an experiment as TOML."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from servobench.settings import with_units

if TYPE_CHECKING:
    from servobench.experiment.experiment import Experiment

_TABLES = ("signal", "controller", "device", "limits", "when_late")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def to_toml(experiment: Experiment) -> str:
    """Return an experiment as the text of a TOML file: everything spelled out, each quantity with its unit."""
    given = with_units(experiment)
    # A signal's levels are volts where it is the voltage; otherwise they are what the controller follows.
    given["signal"] = with_units(experiment, {"V": experiment.controller.reference_unit})["signal"]
    fields = {name: value for name, value in given.items() if name not in _TABLES and value != ""}
    fields.setdefault("duration", "endless")
    fields.setdefault("seed", "random")
    for monitor in ("stall", "plausibility"):
        given["limits"].setdefault(monitor, "off")
    for name in ("settings", "faults"):
        if not given["device"][name]:
            del given["device"][name]
    tables = {"experiment": fields, **{name: given[name] for name in _TABLES}}
    lines = ["# An experiment for servobench. A number without a unit is in SI units."]
    for name, table in tables.items():
        lines += _table((name,), table)
    return "\n".join(lines) + "\n"


def _table(path: tuple[str, ...], table: Mapping[str, Any], brackets: str = "[]") -> list[str]:
    """The lines of a table: its header, its own keys, and then the tables in it, as TOML wants it."""
    header = ".".join(_key(part) for part in path)
    lines = ["", f"{brackets[: len(brackets) // 2]}{header}{brackets[len(brackets) // 2 :]}"]
    inner: list[str] = []
    for key, value in table.items():
        if isinstance(value, Mapping):
            inner += _table((*path, key), value)
        elif _is_array_of_tables(value):
            for element in value:
                inner += _table((*path, key), element, "[[]]")
        else:
            lines.append(f"{_key(key)} = {_value(value)}")
    return lines + inner


def _is_array_of_tables(value: object) -> bool:
    return (
        isinstance(value, list | tuple) and bool(value) and all(isinstance(item, Mapping) for item in value)
    )


def _key(key: str) -> str:
    return key if _BARE_KEY.fullmatch(key) else _text(key)


def _value(value: Any) -> str:
    """One value on one line, but for a text of several lines."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _text_of_lines(value) if "\n" in value else _text(value)
    if isinstance(value, Mapping):
        pairs = ", ".join(f"{_key(key)} = {_inline(item)}" for key, item in value.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    if isinstance(value, Sequence):
        return f"[{', '.join(_inline(item) for item in value)}]"
    return repr(value)


def _inline(value: Any) -> str:
    return _text(value) if isinstance(value, str) else _value(value)


def _text(text: str) -> str:
    """A text in quotes; JSON's escapes are TOML's, but for the delete character."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _text_of_lines(text: str) -> str:
    """A text in three quotes, line by line; the newline after the opening quotes is no part of it."""
    return '"""\n' + "\n".join(_text(line)[1:-1] for line in text.split("\n")) + '"""'
