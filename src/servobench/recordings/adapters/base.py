"""The kind `adapters`: what somebody has at hand in Python, made a recording."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar, Protocol, runtime_checkable

from servobench.core.arguments import text_of_value
from servobench.core.errors import UsageError
from servobench.core.registry import Registry
from servobench.recordings.recording import Recording


@runtime_checkable
class Adapter(Protocol):
    """Makes recordings of one kind of object. It changes no value, and says nothing that the object doesn't."""

    accepted: ClassVar[str]
    """What it takes, for an error message: `a DataFrame (pandas, polars, Arrow)`."""

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
    """Return the recordings in what somebody has at hand: a path, a table, a recording, or a list of such.

    Recordings of one name are numbered, so that each can be told from the others. `argument` is what an error message calls it.
    Raises `UsageError` for an object of no kind that is known, and what reading it raises.
    """
    if isinstance(data, list | tuple):
        if not data:
            raise UsageError(f"{argument} is an empty list; expected {_list_of_kinds()}")
        found = [each for k, part in enumerate(data) for each in recordings_in(part, f"{argument}[{k}]")]
        return name_apart(found)
    for adapter in ADAPTERS:
        if adapter().accepts(data):
            return adapter().recordings(data)
    raise UsageError(
        f"{argument} is {text_of_value(data)}; expected {_list_of_kinds()}, or a list of such. {_ARRAYS}"
    )


_ARRAYS = "Arrays are given by name: t=, u=, y=, input_unit=, output_unit="


def _list_of_kinds() -> str:
    return ", ".join(adapter.accepted for adapter in ADAPTERS)


def name_apart(recordings: list[Recording]) -> tuple[Recording, ...]:
    """Return the recordings, those of one name numbered."""
    names = [each.name for each in recordings]
    return tuple(
        replace(each, name=f"{each.name} {k + 1}") if names.count(each.name) > 1 else each
        for k, each in enumerate(recordings)
    )
