"""TOML: read with limits, which Python's own reader doesn't have, as files may come from strangers; and written."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

MOST_CHARACTERS = 2**20
"""The most characters of a TOML text; a mapping or an experiment, with a thousand breakpoints, has a twentieth."""

DEEPEST = 16
"""The most parts of a dotted key; Python's reader takes memory by the square of them."""

_PART = r"""(?:(?<![\w-])[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_TOO_DEEP = re.compile(rf"{_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{DEEPEST}}}", re.ASCII)


def loads(text: str) -> dict[str, Any]:
    """Return the tables in a TOML text.

    Raises `tomllib.TOMLDecodeError`, a `ValueError`, where it is none, is longer than `MOST_CHARACTERS` or has a key of more than
    `DEEPEST` parts; plain `ValueError` for a number of thousands of digits; `RecursionError` where it is nested too deeply.
    """
    if len(text) > MOST_CHARACTERS:
        raise tomllib.TOMLDecodeError(f"it has {len(text)} characters; expected at most {MOST_CHARACTERS}")
    if deep := _TOO_DEEP.search(text):
        line = text.count("\n", 0, deep.start()) + 1
        column = deep.start() - text.rfind("\n", 0, deep.start())
        raise tomllib.TOMLDecodeError(f"a key of more than {DEEPEST} parts (at line {line}, column {column})")
    return tomllib.loads(text)


_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def table_lines(path: tuple[str, ...], table: Mapping[str, Any], brackets: str = "[]") -> list[str]:
    """Return the lines of a table: its header, its own keys, and then the tables in it, as TOML wants it."""
    header = ".".join(_key(part) for part in path)
    lines = ["", f"{brackets[: len(brackets) // 2]}{header}{brackets[len(brackets) // 2 :]}"]
    inner: list[str] = []
    for key, value in table.items():
        if isinstance(value, Mapping):
            inner += table_lines((*path, key), value)
        elif _is_array_of_tables(value):
            for element in value:
                inner += table_lines((*path, key), element, "[[]]")
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
