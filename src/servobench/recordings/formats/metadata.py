"""Everything in a recording except its samples, as JSON, for formats that can store a text."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, get_type_hints

import numpy as np

from servobench.core.channels import Array, Channel
from servobench.core.errors import FormatError
from servobench.recordings.recording import Recording, Series

if TYPE_CHECKING:
    from pydantic import TypeAdapter

SCHEMA = "servobench.recording/1"


def describe(recording: Recording) -> dict[str, Any]:
    """Return the fields of a recording, and its channels in place of their samples, as values that JSON has."""
    known = {
        field.name: getattr(recording, field.name) for field in fields(recording) if field.name != "series"
    }
    channels = [series.channel for series in recording.series]
    plain: dict[str, Any] = _plain({**known, "channels": channels})
    return plain


def restore(description: object, samples: Sequence[tuple[Array, Array | None]], name: str) -> Recording:
    """Return the recording of a description, with the values and the times of its channels in their order.

    `name` is the file's, for errors. Raises `FormatError` where the description isn't one.
    """
    from pydantic import ValidationError

    hints = get_type_hints(Recording)
    hints["channels"] = tuple[Channel, ...]
    try:
        if not isinstance(description, dict):
            raise ValueError("it isn't an object")
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
        message = str(error).splitlines()[0]
        raise FormatError(
            f"{name}: the file's description of its recording can't be understood ({message})"
        ) from None


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """A recording as columns: each channel is one, and so are times, once for all channels that share them."""

    columns: dict[str, Array]
    """The columns by their names, those of times first."""
    units: dict[str, str | None]
    """Their units by the same names."""
    description: dict[str, Any]
    """All that the recording knows beside them, and of each channel the names of its values and its times."""


def table_of(recording: Recording, rename: Callable[[Sequence[str]], Sequence[str]]) -> Table:
    """Return a recording as columns; `rename` makes names of theirs that differ and that the format can hold."""
    times = {each.t.tobytes(): each.t for each in recording.series if each.t is not None}
    labels = [f"t_{k + 1}" if k else "t" for k in range(len(times))]
    names = rename([*labels, *(each.channel.name for each in recording.series)])
    of_times = dict(zip(times, names, strict=False))
    of_values = names[len(times) :]
    samples = [
        [name, None if each.t is None else of_times[each.t.tobytes()]]
        for name, each in zip(of_values, recording.series, strict=True)
    ]
    content = [*times.values(), *(each.values for each in recording.series)]
    units = [*("s" for _ in times), *(each.channel.unit for each in recording.series)]
    return Table(
        columns=dict(zip(names, content, strict=True)),
        units=dict(zip(names, units, strict=True)),
        description={"recording": describe(recording), "samples": samples},
    )


def recording_of_table(description: Any, column: Callable[[str], Array], name: str) -> Recording:
    """Return the recording of a description that `table_of` made; `column` gives the values of the column of a name.

    `name` is the file's. Raises `FormatError` where the columns aren't those that it describes.
    """
    try:
        samples = [
            (column(values), None if times is None else column(times))
            for values, times, *_ in description["samples"]
        ]
        recording = description["recording"]
    except FormatError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(
            f"{name}: its columns aren't those that servobench described in it ({error!r})"
        ) from None
    return restore(recording, samples, name)


def as_utf_8(text: str) -> str:
    """Return a text without what UTF-8 doesn't have: lone surrogates, as in the names of files."""
    return text.encode("utf-8", "replace").decode("utf-8")


def as_text(value: object) -> str:
    """Return a value as one line of JSON in ASCII."""
    return json.dumps(value, separators=(", ", ": "))


def from_text(text: str, name: str) -> Any:
    """Return the value in a JSON text; raises `FormatError` where it is none. `name` is the file's."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{name}: the file's description of its recording is damaged ({error})") from None


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
