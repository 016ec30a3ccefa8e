"""Translation of Python keywords in messages to the panel's fields: `sample_time=0.02` is the field “sample time”."""

from __future__ import annotations

import re

_KEYWORD = re.compile(r"`([a-z_]+)=([^`\n]+)`")
_FIELDS = {
    "chain": "chain",
    "counts_per_rev": "counts in a turn",
    "current": "current",
    "input": "input",
    "output": "output",
    "reference": "reference",
    "sample_time": "Time between two samples",
    "structure": "structure",
    "supply": "supply",
    "time": "time",
}
_EXAMPLE = re.compile(r"[-+0-9].*")


def with_fields(sentence: str) -> str:
    """Return a sentence with the names of fields in the place of keywords, with the value where it is a number."""

    def field(match: re.Match[str]) -> str:
        name, value = match.groups()
        if name not in _FIELDS:
            return match[0]
        example = f" ({value})" if _EXAMPLE.fullmatch(value) else ""
        return f"the field “{_FIELDS[name]}”{example}"

    return _KEYWORD.sub(field, sentence)
