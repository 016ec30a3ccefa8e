"""The folder that a command writes to: an empty one, or a new one of its own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from itertools import chain, count
from pathlib import Path

from servobench.core.errors import StorageError, UsageError


def make_folder(prefix: str, now: datetime) -> Path:
    """Make a folder in the current one, called after the time, and return its name.

    The system makes a folder once: of two commands in the same second the second takes the next name, PREFIX-TIME-2.
    Raises `StorageError` where no folder can be made.
    """
    name = f"{prefix}-{now:%Y%m%d-%H%M%S}"
    for path in chain([Path(name)], (Path(f"{name}-{number}") for number in count(2))):
        with suppress(FileExistsError):
            make(path)
            return path
    raise AssertionError("there is always a next number")


def make(path: Path, *, exist_ok: bool = False) -> None:
    """Make a folder, and those above it; raises `FileExistsError`, and `StorageError` where it can't be made."""
    try:
        path.mkdir(parents=True, exist_ok=exist_ok)
    except FileExistsError:
        if exist_ok:
            raise StorageError(f"{path} can't be written: it isn't a folder") from None
        raise
    except OSError as error:
        raise StorageError(f"{path} can't be written: {error.strerror or error}") from error


@contextmanager
def empty_folder(out: Path | None, prefix: str, now: datetime) -> Iterator[Path]:
    """Make the folder `out`, or one that is called after the time, and remove it in the end if it's still empty.

    So nothing from an earlier command is mistaken for something from this one. Raises `UsageError` where `out` holds something,
    and `StorageError` where it can't be made.
    """
    if out is not None and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise UsageError(f"--out {out} isn't an empty folder; give a new one")
    if out is not None:
        make(out, exist_ok=True)
    folder = out or make_folder(prefix, now)
    try:
        yield folder
    finally:
        remove_if_empty(folder)


def remove_if_empty(folder: Path) -> None:
    """Remove a folder with nothing in it."""
    with suppress(OSError):
        folder.rmdir()
