"""The kind `adapters`: each turns a kind of Python object into a recording."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import Any, ClassVar, Protocol, runtime_checkable

from servobench.core.arguments import text_of_value
from servobench.core.errors import UsageError
from servobench.core.registry import Registry
from servobench.recordings.recording import Recording


@runtime_checkable
class Adapter(Protocol):
    """Makes recordings of one kind of object. It changes no value, and says nothing that the object doesn't."""

    accepted: ClassVar[str]
    """The kind of data that it accepts, for an error message: `a DataFrame (pandas, polars, Arrow)`."""

    def accepts(self, data: object) -> bool:
        """Return whether this object is of the kind. Must not import the library that defines it."""
        ...

    def recordings(self, data: Any) -> tuple[Recording, ...]:
        """Return the recordings in the object; raises `UsageError` where it holds none."""
        ...


ADAPTERS: Registry[type[Adapter]] = Registry(
    "adapter", "servobench.recordings.adapters", "servobench.adapters"
)


def recordings_in(data: object, argument: str = "data") -> tuple[Recording, ...]:
    """Return the recordings in the given data: a path, a table, a recording, or a list of these.

    `argument` is what an error message calls it.
    Raises `UsageError` for an object of no kind that is known, and what reading it raises.
    """
    if isinstance(data, list | tuple):
        if not data:
            raise UsageError(f"{argument} is an empty list; expected {_list_of_kinds()}")
        return tuple(each for k, part in enumerate(data) for each in recordings_in(part, f"{argument}[{k}]"))
    for adapter in ADAPTERS:
        if adapter().accepts(data):
            return adapter().recordings(data)
    raise UsageError(
        f"{argument} is {text_of_value(data)}; expected {_list_of_kinds()}, or a list of these. {_ARRAYS}"
    )


_ARRAYS = "Pass arrays by name: t=, u=, y=, input_unit=, output_unit="


def _list_of_kinds() -> str:
    return ", ".join(adapter.accepted for adapter in ADAPTERS)


def unique_names(recordings: Sequence[Recording]) -> tuple[Recording, ...]:
    """Return the recordings with unique names: equal ones get the file's name, its folders if they differ, or a number."""
    names = [each.name for each in recordings]
    longer = [
        file if PurePath(file).name == name else f"{file} {name}".strip()
        for file, name in zip(_short_paths([each.source.name for each in recordings]), names, strict=True)
    ]
    own = [
        each if longer.count(each) == 1 else f"{name} {k + 1}"
        for k, (each, name) in enumerate(zip(longer, names, strict=True))
    ]
    return tuple(
        replace(each, name=name) if names.count(each.name) > 1 else each
        for each, name in zip(recordings, own, strict=True)
    )


def _short_paths(sources: Sequence[str]) -> list[str]:
    """The paths without suffixes, with as few of their folders as tell different files apart, however they were written."""
    whole = [PurePath(os.path.abspath(source) if source else "") for source in sources]
    paths = [path.parent / path.stem for path in whole]
    deepest = max((len(path.parts) for path in paths), default=0)
    for depth in range(1, deepest + 1):
        ends = [path.parts[-depth:] for path in paths]
        if len(set(ends)) == len(set(paths)):
            return ["/".join(end) for end in ends]
    return [str(path) for path in paths]
