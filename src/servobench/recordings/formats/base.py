"""The kind `formats`: files that hold recordings; and the two verbs `load` and `save`.

A member is a class that `FORMATS.member(name)` decorates, made without arguments. `metadata` converts everything in a recording
except its samples to JSON and back, `columns.recording_of` turns a foreign table into a recording.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import ClassVar, Protocol, runtime_checkable

from servobench.core.arguments import check_type
from servobench.core.errors import FormatError, StorageError, UsageError
from servobench.core.finding import info
from servobench.core.registry import Registry
from servobench.recordings.formats.bag_folder import METADATA, bag_files, is_metadata, metadata_in
from servobench.recordings.native.lease import is_held
from servobench.recordings.native.mcap_file import busy_text
from servobench.recordings.recording import Recording, Source

_HEAD = 4096  # bytes


@runtime_checkable
class Format(Protocol):
    """A file format. Reading tells what is wrong with a file as findings with row numbers; it repairs nothing silently."""

    suffixes: ClassVar[tuple[str, ...]]
    """The file endings it is known by, in lower case with the dot; the first is the usual one."""
    written: ClassVar[tuple[str, ...]]
    """Those of them under which it is written; none where it is only read. No two members have one in common."""
    by_library: ClassVar[bool]
    """Whether a library reads it, in a process with limits; our own code reads plain text in the calling process."""

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file with these first bytes (up to 4096) is of this format.

        The last line may be cut. Files of another member, an empty head and text that is nobody's (`{}`) aren't.
        """
        ...

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recordings in a file; raises `FormatError`, which names the file, where it can't be read.

        A damaged file raises nothing else, and takes little memory. What `source` they have is `load`'s business.
        """
        ...

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write recordings so that `read` gives them back equal.

        Equal means NaN, infinities and channels without times or samples, too. Raises `UsageError`, which begins with the file's
        name, where the format can't hold them or is only read, `StorageError` where they can't be written.
        """
        ...


FORMATS: Registry[type[Format]] = Registry(
    "file format", "servobench.recordings.formats", "servobench.formats"
)


def read_here(format: str, file: Path) -> tuple[Recording, ...]:
    """Return the recordings in a file of a format, read in this process.

    Raises what the format's `read` raises, and `FormatError` where the memory isn't enough.
    """
    try:
        return FORMATS[format]().read(file)
    except MemoryError as error:
        raise FormatError(
            f"{file.name} takes more memory than a file of its size may. If it is sound, save it without compression, or in parts"
        ) from error


def load(
    path: str | os.PathLike[str], read: Callable[[str, Path], tuple[Recording, ...]] = read_here
) -> tuple[Recording, ...]:
    """Return the recordings in a file, as `loading.load` does, with `read(format, file)` in place of its child process.

    Without it, libraries read the file in this process, which a hostile file can crash.
    Raises `UsageError` where there is no such file, `FormatError` where it can't be read.
    """
    check_type("path", path, (str, os.PathLike), "the path of a file")
    file = _file_of(Path(path))
    try:
        _check_is_there(file)
        with file.open("rb") as stream:
            head = stream.read(_HEAD)
            checksum = _checksum(file, head)
        if not head:
            raise FormatError(f"{file} is empty")
        name = _format_of(file, head)
        recordings = read(name, file)
    except OSError as error:
        raise FormatError(f"{file} can't be read: {error.strerror or error}") from error
    source = Source(name=os.fspath(path), sha256=checksum, format=name)
    recordings = tuple(replace(recording, source=source) for recording in recordings)
    if file.suffix.lower() in FORMATS[name].suffixes or file.name == METADATA:
        return recordings
    finding = info(
        "format-by-content",
        f"The file is read as {name}, going by its content; its name has another ending.",
    )
    return tuple(recording.with_findings(finding) for recording in recordings)


def save(recordings: Recording | Iterable[Recording], path: str | os.PathLike[str]) -> None:
    """Write one recording, or several if the format allows it, in the format given by the ending of the name.

    An existing file is replaced once the new one is complete. Raises `UsageError` if no format has that
    ending or the format can't hold the recordings, `StorageError` if they can't be written.

    >>> import servobench as sb
    >>> from tempfile import TemporaryDirectory
    >>> with sb.connect("twin") as motor, TemporaryDirectory() as folder:
    ...     sb.save(sb.run(sb.Experiment(duration="1 s"), motor), f"{folder}/run.mcap")
    ...     (again,) = sb.load(f"{folder}/run.mcap")
    >>> len(again["counts"].values)
    500
    """
    check_type("path", path, (str, os.PathLike), "the path of a file")
    check_type("recordings", recordings, (Recording, Iterable), "a Recording, or a list of them")
    file = Path(path)
    several = (recordings,) if isinstance(recordings, Recording) else tuple(recordings)
    for each in several:
        check_type("recordings", each, Recording, "a Recording, or a list of them")
    if not several:
        raise UsageError(f"{file}: there is no recording to write")
    form = _format_with(file.suffix.lower())
    if form is None or (form.written and file.suffix.lower() not in form.written):
        raise UsageError(
            f"{file}: no format that can be written ends in {file.suffix!r}; known: {_formats_to_write()}"
        )
    try:
        # Written apart and then moved, so that what is there stays until the new file is whole.
        with TemporaryDirectory(prefix=".", dir=file.parent) as folder:
            new = Path(folder) / file.name
            form().write(several, new)
            new.replace(file)
    except StorageError:
        raise
    except OSError as error:
        raise StorageError(f"{file} can't be written: {error.strerror or error}") from error


def _file_of(path: Path) -> Path:
    """The file that is read: of a folder that is a bag of ROS 2 its metadata, of that of a run its recording."""
    # Of a name that no file can have, `Path.is_dir` raises an error.
    if not os.path.isdir(path):
        return path
    recorded = path / "recording.mcap"
    return metadata_in(path) or (recorded if recorded.is_file() else path)


def _checksum(file: Path, head: bytes) -> str:
    """The SHA-256 of a file; of a bag's metadata with the files that they name behind them."""
    digest = hashlib.sha256()
    for each in (file, *(bag_files(file) if is_metadata(file, head) else ())):
        with each.open("rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def _in_folder(folder: Path) -> str:
    """An example of a file in a folder that was named in place of one, and what to do with several."""
    suffixes = {suffix for name in FORMATS.names() for suffix in FORMATS[name].suffixes}
    files = sorted(each for each in folder.iterdir() if each.is_file() and not each.name.startswith("."))
    inside = [each for each in files if each.suffix.lower() in suffixes] or files
    if len(inside) < 2:
        return f", such as {inside[0]}" if inside else ""
    return (
        f", such as {inside[0]}; several files of one motor are fitted jointly, and `servobench fleet identify {folder} "
        "--out RESULTS` identifies each file"
    )


def _check_is_there(file: Path) -> None:
    part = file / "recording.mcap.part"
    if file.is_dir() and part.exists():
        if is_held(part):
            raise UsageError(busy_text(part))
        raise UsageError(
            f"{file} is the folder of a run that was cut short; `servobench recover {file}` repairs it"
        )
    if file.is_dir():
        raise UsageError(
            f"{file} is a folder, but not a ROS 2 bag (it lacks metadata.yaml); name a file in it{_in_folder(file)}"
        )
    if file.is_symlink() and not file.exists():
        raise UsageError(f"{file} is a link to {os.readlink(file)}, which isn't there; name the file itself")
    if not file.exists():
        folder = file.parent
        near = get_close_matches(file.name, os.listdir(folder), n=1) if folder.is_dir() else []
        hint = f"; did you mean {str(folder / near[0])!r}?" if near else ""
        raise UsageError(f"there is no file {file}{hint}")
    if not file.is_file():
        raise UsageError(f"{file} isn't a regular file; copy its content to one")


def _format_of(file: Path, head: bytes) -> str:
    """The name of a file's format: its ending and its content agree on it, or else the content says it, or the ending."""
    suffix = file.suffix.lower()
    by_suffix = [name for name in FORMATS.names() if suffix in FORMATS[name].suffixes]
    by_content = [name for name in FORMATS.names() if FORMATS[name]().recognises(file, head)]
    agreed = [name for name in by_suffix if name in by_content]
    for name in (*agreed, *by_content, *by_suffix):
        return name
    raise FormatError(f"{file} is in an unknown format; known: {_format_names()}")


def _format_with(suffix: str) -> type[Format] | None:
    """The format whose files end so; most are called like the suffix, and then the others aren't imported."""
    own = suffix[1:]
    names = (own,) if own in FORMATS and suffix in FORMATS[own].suffixes else FORMATS.names()
    return next((FORMATS[name] for name in names if suffix in FORMATS[name].suffixes), None)


def _format_names() -> str:
    return ", ".join(f"{name} ({' '.join(FORMATS[name].suffixes)})" for name in FORMATS.names())


def _formats_to_write() -> str:
    members = [(name, FORMATS[name].written) for name in FORMATS.names()]
    return ", ".join(f"{name} ({' '.join(endings)})" for name, endings in members if endings)
