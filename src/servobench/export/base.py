"""The kind `export`: a target is a format of an identified motor for another program; and the verb `export`."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar, Protocol, runtime_checkable

from servobench.core.errors import StorageError, UsageError
from servobench.core.registry import Registry
from servobench.export.summary import ResultSummary


@dataclass(frozen=True, kw_only=True)
class Wishes:
    """The user's options for an export; None where not given.

    `unit` is the unit of position to export in (`rev`, `deg`); `sample_time` [s] that of the controller that will run;
    `inertia` [kg·m²] of everything that turns, which a speed and a voltage alone don't tell; `closed_loop` [s] the time
    constant wished for the closed loop; `counts_per_rev` those of the encoder; `voltage_limit` [V] what the controller may
    put out; `wheel_diameter` [m] of what a turn of the encoder rolls on, for a unit of length; `measurement_delay` [s] how late
    a controller gets what it controls.
    """

    unit: str | None = None
    sample_time: float | None = None
    inertia: float | None = None
    closed_loop: float | None = None
    counts_per_rev: float | None = None
    voltage_limit: float | None = None
    wheel_diameter: float | None = None
    measurement_delay: float | None = None


@runtime_checkable
class Target(Protocol):
    """A form in which another program takes an identified motor."""

    suffix: ClassVar[str]
    """The ending of its file, with the dot; of the first one where it has several."""

    wishes: ClassVar[frozenset[str]]
    """The fields of `Wishes` that it can follow."""

    def render(self, answer: ResultSummary, wishes: Wishes, stem: str) -> Mapping[str, bytes]:
        """Return the files, content by name, each name beginning with the stem.

        Raises `UsageError` where the target can't hold the motor, or needs a wish that isn't said.
        """
        ...


TARGETS: Registry[type[Target]] = Registry("export target", "servobench.export")


def export(
    answer: ResultSummary,
    target: str,
    path: str | os.PathLike[str],
    wishes: Wishes | None = None,
    *,
    check: Callable[[Path], None] | None = None,
) -> tuple[Path, ...]:
    """Write an identified motor in the form that a target's program takes, and return the files that were written.

    `path` is the name of the (first) file; where it has no ending, the target's own is added. Files of these names are replaced
    once the new ones are whole; `check` gets each name before, and raises an error for one that mustn't be. Raises `UsageError`
    for a wish that the target can't follow or a motor that it can't hold, `StorageError` where the files can't be written.
    """
    wishes = wishes or Wishes()
    check_wishes(target, wishes)
    made = TARGETS[target]()
    file = Path(path)
    if file.suffix and file.suffix != made.suffix:
        raise UsageError(
            f"{file}: {target} writes a file that ends in {made.suffix}; use that ending, or none"
        )
    content = made.render(answer, wishes, file.stem if file.suffix else file.name)
    if check is not None:
        for name in content:
            check(file.parent / name)
    return write_files(content, file)


def write_files(content: Mapping[str, bytes], file: Path) -> tuple[Path, ...]:
    """Write files, content by name, into the folder of one of them once all are whole, and return them.

    Files of these names are replaced. Raises `StorageError` where they can't be written.
    """
    try:
        with TemporaryDirectory(prefix=".", dir=file.parent) as folder:
            for name, data in content.items():
                (Path(folder) / name).write_bytes(data)
            for name in content:
                (Path(folder) / name).replace(file.parent / name)
    except OSError as error:
        raise StorageError(f"{file} can't be written: {error.strerror or error}") from error
    return tuple(file.parent / name for name in content)


def check_wishes(name: str, wishes: Wishes) -> None:
    """Raise `UsageError` where the target of that name can't follow one of the wishes."""
    target = TARGETS[name]
    wished = {field.name for field in fields(wishes) if getattr(wishes, field.name) is not None}
    if extra := sorted(wished - target.wishes):
        can = ", ".join(sorted(keyword(each) for each in target.wishes)) or "none"
        raise UsageError(f"{name} doesn't use {', '.join(keyword(each) for each in extra)}; it uses: {can}")
    for each in wished - {"unit"}:
        value = getattr(wishes, each)
        if not 0.0 < value < float("inf"):
            raise UsageError(f"{keyword(each)} is {value!r}; expected a positive number")


def keyword(wish: str) -> str:
    """Return a wish as messages name it: by its field of `Wishes`."""
    return f"`{wish}=...`"
