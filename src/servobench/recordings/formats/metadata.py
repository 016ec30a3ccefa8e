"""All that a recording knows beside its samples, as JSON, for the formats that have a place for a text."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, get_type_hints

import numpy as np

from servobench.core.channels import Array, Channel
from servobench.core.errors import FormatError
from servobench.recordings.recording import Recording, Series

if TYPE_CHECKING:
    from pydantic import TypeAdapter

SCHEMA = "servobench.recording/1"


def described(recording: Recording) -> dict[str, Any]:
    """Return the fields of a recording, and its channels in place of their samples, as values that JSON has."""
    known = {
        field.name: getattr(recording, field.name) for field in fields(recording) if field.name != "series"
    }
    channels = [series.channel for series in recording.series]
    plain: dict[str, Any] = _plain({**known, "channels": channels})
    return plain


def restored(description: object, samples: Sequence[tuple[Array, Array | None]], name: str) -> Recording:
    """Return the recording of a description, with the values and the times of its channels in their order.

    `name` is the file's, for errors. Raises `FormatError` where the description isn't one.
    """
    from pydantic import ValidationError

    hints = get_type_hints(Recording)
    hints["channels"] = tuple[Channel, ...]
    try:
        if not isinstance(description, dict):
            raise ValueError("it is no object")
        known = {
            field: _adapter(hint).validate_python(description[field])
            for field, hint in hints.items()
            if field in description and field != "series"
        }
        channels = known.pop("channels")
        series = tuple(
            Series(channel=channel, values=values, t=t)
            for channel, (values, t) in zip(channels, samples, strict=True)
        )
        return Recording(series=series, **known)
    except (ValidationError, ValueError, TypeError, KeyError, RecursionError) as error:
        said = str(error).splitlines()[0]
        raise FormatError(
            f"{name}: what the file says of its recording can't be understood ({said})"
        ) from None


def as_text(value: object) -> str:
    """Return a value as one line of JSON in ASCII."""
    return json.dumps(value, separators=(", ", ": "))


def from_text(text: str, name: str) -> Any:
    """Return the value in a JSON text; raises `FormatError` where it is none. `name` is the file's."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{name}: what the file says of its recording is damaged ({error})") from None


@cache
def _adapter(hint: Any) -> TypeAdapter[Any]:
    from pydantic import TypeAdapter

    return TypeAdapter(hint)


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: _plain(content) for key, content in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(content) for content in value]
    return value.item() if isinstance(value, np.generic) else value
