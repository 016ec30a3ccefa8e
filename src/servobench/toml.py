"""Reading TOML that somebody else wrote: within limits, as Python's reader has none."""

from __future__ import annotations

import re
import tomllib
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
