"""The kind `formats`: files that hold recordings."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Protocol, runtime_checkable

from servobench.recording.recording import Recording
from servobench.registry import Registry


@runtime_checkable
class Format(Protocol):
    """A file format. Reading tells what is wrong with a file as findings with row numbers; it repairs nothing silently."""

    suffixes: ClassVar[tuple[str, ...]]
    """The file endings it is known by, in lower case with the dot; the first is the usual one."""

    def recognises(self, path: Path, head: bytes) -> bool:
        """Return whether a file with these first bytes (up to 4096) is of this format."""
        ...

    def read(self, path: Path) -> tuple[Recording, ...]:
        """Return the recordings in a file; raises `FormatError` where it can't be read."""
        ...

    def write(self, recordings: tuple[Recording, ...], path: Path) -> None:
        """Write recordings so that `read` gives them back equal.

        Raises `UsageError` where the format can't hold them, `StorageError` where they can't be written.
        """
        ...


FORMATS: Registry[type[Format]] = Registry("file format", "servobench.formats")
