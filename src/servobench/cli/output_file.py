"""The files that a command writes: an existing file is replaced only if the user asks for it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from servobench.core.errors import UsageError


def check_free(path: Path | None, option: str, inputs: Sequence[Path | None], overwrite: bool) -> None:
    """Raise `UsageError` where a file can't be written, or something would be lost by it, before any work is done.

    `inputs` are the files that the command reads; they are never replaced. Another file is where `overwrite` says so.
    """
    if path is None:
        return
    if path.is_dir():
        raise UsageError(f"{option} {path} is a folder; name a file in it")
    if path.exists() and not path.is_file():
        raise UsageError(f"{option} {path} isn't a regular file and won't be replaced; give another name")
    if not path.parent.is_dir():
        raise UsageError(f"{option} {path}: there is no folder {path.parent}")
    if any(path.resolve() == each.resolve() for each in inputs if each is not None):
        raise UsageError(
            f"{option} {path} is one of the files to read and would be overwritten; give another name"
        )
    if path.exists() and not overwrite:
        raise UsageError(f"{option} {path} exists already; give another name, or --overwrite to replace it")
