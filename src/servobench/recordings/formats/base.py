"""The kind `formats`: files that hold recordings; and the two verbs `load` and `save`."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar, Protocol, runtime_checkable

from servobench.core.errors import FormatError, StorageError, UsageError
from servobench.core.finding import info
from servobench.core.registry import Registry
from servobench.recordings.native.lease import is_held
from servobench.recordings.native.mcap_file import being_written
from servobench.recordings.recording import Recording, Source

_HEAD = 4096  # bytes


@runtime_checkable
class Format(Protocol):
    """A file format. Reading tells what is wrong with a file as findings with row numbers; it repairs nothing silently."""

    suffixes: ClassVar[tuple[str, ...]]
    """The file endings it is known by, in lower case with the dot; the first is the usual one."""

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file with these first bytes (up to 4096) is of this format."""
        ...

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recordings in a file; raises `FormatError` where it can't be read.

        What `source` they have is `load`'s business.
        """
        ...

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write recordings so that `read` gives them back equal.

        Raises `UsageError` where the format can't hold them, `StorageError` where they can't be written.
        """
        ...


FORMATS: Registry[type[Format]] = Registry(
    "file format", "servobench.recordings.formats", "servobench.formats"
)


def load(path: str | os.PathLike[str]) -> tuple[Recording, ...]:
    """Return the recordings in a file of any format that is known.

    The format is the one that the ending of the name and the content agree on; where they don't, the content decides, and a
    finding says so. `source` of a recording is then the file: its name as given, its SHA-256 and the format.
    Raises `UsageError` where there is no such file, `FormatError` where it can't be read.
    """
    file = Path(path)
    try:
        _check_is_there(file)
        with file.open("rb") as stream:
            head = stream.read(_HEAD)
            stream.seek(0)
            checksum = hashlib.file_digest(stream, "sha256").hexdigest()
        if not head:
            raise FormatError(f"{file} is empty")
        name = _format_of(file, head)
        recordings = FORMATS[name]().read(file)
    except OSError as error:
        raise FormatError(f"{file} can't be read: {error.strerror or error}") from error
    source = Source(name=os.fspath(path), sha256=checksum, format=name)
    recordings = tuple(replace(recording, source=source) for recording in recordings)
    if file.suffix.lower() in FORMATS[name].suffixes:
        return recordings
    told = info(
        "format-by-content",
        f"The file is read as {name}, which its content looks like; its name ends otherwise.",
    )
    return tuple(recording.with_findings(told) for recording in recordings)


def save(recordings: Recording | Iterable[Recording], path: str | os.PathLike[str]) -> None:
    """Write one recording, or several where the format can hold them, in the format that the ending of the name says.

    A file of that name is replaced once the new one is whole. Raises `UsageError` where no format has that ending or the format
    can't hold the recordings, `StorageError` where they can't be written.
    """
    file = Path(path)
    several = (recordings,) if isinstance(recordings, Recording) else tuple(recordings)
    if not several:
        raise UsageError(f"{file}: there is no recording to write")
    names = [name for name in FORMATS.names() if file.suffix.lower() in FORMATS[name].suffixes]
    if not names:
        raise UsageError(f"{file}: no file format ends in {file.suffix!r}; known: {_known_formats()}")
    try:
        # Written apart and then moved, so that what is there stays until the new file is whole.
        with TemporaryDirectory(prefix=".", dir=file.parent) as folder:
            new = Path(folder) / file.name
            FORMATS[names[0]]().write(several, new)
            new.replace(file)
    except StorageError:
        raise
    except OSError as error:
        raise StorageError(f"{file} can't be written: {error.strerror or error}") from error


def _check_is_there(file: Path) -> None:
    part = file / "recording.mcap.part"
    if file.is_dir() and part.exists():
        if is_held(part):
            raise UsageError(being_written(part))
        raise UsageError(
            f"{file} is the folder of a run that was cut short; `servobench recover {file}` makes it whole"
        )
    if file.is_dir():
        raise UsageError(f"{file} is a folder; name a file in it")
    if not file.exists():
        folder = file.parent
        near = get_close_matches(file.name, os.listdir(folder), n=1) if folder.is_dir() else []
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise UsageError(f"there is no file {file}{hint}")
    if not file.is_file():
        raise UsageError(f"{file} is no ordinary file; copy what comes out of it to one")


def _format_of(file: Path, head: bytes) -> str:
    """The name of a file's format: its ending and its content agree on it, or else the content says it, or the ending."""
    suffix = file.suffix.lower()
    by_suffix = [name for name in FORMATS.names() if suffix in FORMATS[name].suffixes]
    by_content = [name for name in FORMATS.names() if FORMATS[name]().recognises(file, head)]
    agreed = [name for name in by_suffix if name in by_content]
    for name in (*agreed, *by_content, *by_suffix):
        return name
    raise FormatError(f"{file} is of no format that is known here; known: {_known_formats()}")


def _known_formats() -> str:
    return ", ".join(f"{name} ({' '.join(FORMATS[name].suffixes)})" for name in FORMATS.names())
