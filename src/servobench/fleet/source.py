"""The source of a fleet's recordings: a folder, or an address of an object store."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from servobench.core.errors import UsageError
from servobench.fleet.name_pattern import NamePattern

_TAGS = ("ETag", "etag", "mtime", "LastModified", "last_modified", "updated", "created", "checksum", "CRC")
"""The keys under which the file systems of fsspec give a file's tag or time."""

SETTINGS_SCHEMA = "servobench.fleet-settings/1"
"""The schema of `settings.json` in a folder of results, which is no source of recordings."""


@dataclass(frozen=True, order=True)
class Item:
    """A recording of a fleet: its path below the source with `/` between folders, and what changes when the file does."""

    name: str
    """The path."""
    stamp: str
    """Size and time, or what a store tells in their place."""

    @property
    def text(self) -> str:
        """The name as it stands in tables, where bytes that are no text are written as `\\xff`."""
        return os.fsencode(self.name).decode("utf-8", "backslashreplace")


class Source(Protocol):
    """A place with recordings, which can be handed to another process."""

    @property
    def address(self) -> str:
        """The place, as text."""
        ...

    def files(self) -> Iterator[Item]:
        """Return all files below it; raises `UsageError` where there is no such place."""
        ...

    def local(self, item: Item) -> Any:
        """Return a context with the path of the file on this machine."""
        ...


@dataclass(frozen=True)
class Folder:
    """A folder of this machine; hidden files, and what lies below `without`, are no part of it."""

    root: Path
    """The folder."""
    without: Path | None = None

    @property
    def address(self) -> str:
        """The folder, from the root of the file system."""
        return str(self.root.resolve())

    def files(self) -> Iterator[Item]:
        """Return all files below the folder; raises `UsageError` where there is no such folder, or it can't be read."""
        if not self.root.is_dir():
            what = "is no folder" if self.root.exists() else "there is no such folder"
            raise UsageError(f"{self.root}: {what}; expected the one with the recordings")
        for folder, below, names in os.walk(self.root, onerror=_complain):
            here = Path(folder)
            below[:] = sorted(
                each for each in below if not each.startswith(".") and not self._holds_results(here / each)
            )
            for name in sorted(names):
                if not name.startswith("."):
                    item = _item(here / name, (here / name).relative_to(self.root).as_posix())
                    if item is not None:
                        yield item

    @contextmanager
    def local(self, item: Item) -> Iterator[Path]:
        """Return the path of the file."""
        yield self.root / item.name

    def _holds_results(self, folder: Path) -> bool:
        """Whether the results go to a folder, or an earlier fleet's are in it: their tables are no recordings."""
        ours = self.without is not None and folder.resolve() == self.without.resolve()
        settings = folder / "settings.json"
        return ours or (settings.is_file() and SETTINGS_SCHEMA.encode() in settings.read_bytes())


def stamp_of(path: Path) -> str:
    """Return what changes when a file does: its size [bytes] and the time of its last change [ns]."""
    status = path.stat()
    return f"{status.st_size}-{status.st_mtime_ns}"


def _item(path: Path, name: str) -> Item | None:
    """A file, None where it is gone again or is no file."""
    try:
        return Item(name, stamp_of(path)) if path.is_file() else None
    except OSError:
        return None


def _complain(error: OSError) -> None:
    raise UsageError(f"{error.filename} can't be read: {error.strerror}") from error


@dataclass(frozen=True)
class Store:
    """A place that fsspec knows, such as `s3://bucket/line-3`; each file is fetched for as long as it is read."""

    url: str
    """The address."""

    @property
    def address(self) -> str:
        """The address as it was given."""
        return self.url

    def files(self) -> Iterator[Item]:
        """Return all files below the address; raises `UsageError` where it can't be listed."""
        system, root = self._open()
        try:
            listing = system.find(root, detail=True)
        except Exception as error:  # each file system has errors of its own
            raise UsageError(f"{self.url} can't be listed: {_in_a_line(error)}") from error
        for path in sorted(listing):
            facts = listing[path]
            name = path.removeprefix(root).lstrip("/")
            if name and not any(part.startswith(".") for part in name.split("/")):
                tags = [str(facts[tag]) for tag in _TAGS if facts.get(tag) is not None]
                yield Item(name, "-".join([str(facts.get("size")), *tags]))

    @contextmanager
    def local(self, item: Item) -> Iterator[Path]:
        """Return the path of a copy that is removed afterwards; raises `UsageError` where the file can't be fetched."""
        system, root = self._open()
        with TemporaryDirectory(prefix="servobench-") as folder:
            # A file's name may tell its input (`{level}`), so it keeps its own.
            path = Path(folder) / item.name.rpartition("/")[2]
            try:
                system.get_file(f"{root.rstrip('/')}/{item.name}" if root else item.name, str(path))
            except Exception as error:  # each file system has errors of its own
                raise UsageError(
                    f"{item.name} can't be fetched from {self.url}: {_in_a_line(error)}"
                ) from error
            yield path

    def _open(self) -> tuple[Any, str]:
        try:
            from fsspec.core import url_to_fs
        except ImportError:
            raise UsageError(
                f"{self.url}: an address needs fsspec; python -m pip install 'servobench[fleet]', and what fsspec needs for this "
                "kind of address, such as s3fs"
            ) from None
        try:
            system, root = url_to_fs(self.url)
        except (ImportError, ValueError, OSError) as error:
            raise UsageError(f"{self.url} can't be opened: {_in_a_line(error)}") from error
        return system, str(root)


def source_at(place: str | os.PathLike[str], without: Path | None = None) -> Source:
    """Return the source at an address such as `s3://bucket/line-3`, or in a folder; what is below `without` isn't part of it."""
    text = os.fspath(place)
    return Store(text) if "://" in text else Folder(Path(text), without)


@dataclass(frozen=True, kw_only=True)
class Listing:
    """The recordings of a source, in the order of their names, and the names of the files that are none."""

    items: tuple[Item, ...]
    """The recordings."""
    others: tuple[str, ...]
    """Files whose names don't match."""


def list_items(source: Source, pattern: NamePattern | None) -> Listing:
    """Return the recordings of a source: files that match the pattern or, without one, have the ending of a format.

    Raises `UsageError` where there are none.
    """
    endings = recording_endings()
    items, others = [], []
    for item in source.files():
        meant = (
            item.name.lower().endswith(endings) if pattern is None else pattern.columns(item.name) is not None
        )
        items.append(item) if meant else others.append(item.name)
    if not items:
        raise UsageError(_why_none(source, pattern, others))
    return Listing(items=tuple(sorted(items)), others=tuple(others))


def recording_endings() -> tuple[str, ...]:
    """Return the endings of the files that can be recordings; a file that is still being written has none of them."""
    from servobench.recordings.formats.base import FORMATS

    return tuple(
        sorted({ending for name in FORMATS.names() for ending in FORMATS[name].suffixes} - {".part"})
    )


def _why_none(source: Source, pattern: NamePattern | None, others: Iterable[str]) -> str:
    first = next(iter(others), None)
    if first is None:
        return f"{source.address} holds no files; expected recordings"
    if pattern is not None:
        return f"{source.address}: no file matches `pattern={pattern.text}`; the first file there is {first}"
    return (
        f"{source.address} holds no recordings; files such as {first} have none of the endings {' '.join(recording_endings())}. "
        "If they are recordings, say what they are called: `pattern={serial}.log`"
    )


def _in_a_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
