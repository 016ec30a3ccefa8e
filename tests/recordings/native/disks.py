"""Disks that fail."""

import errno
from pathlib import Path
from typing import Any


class FullDisk:
    """A file on a disk that takes so many bytes and no more."""

    def __init__(self, path: Path, mode: str, room: int) -> None:
        self._file = open(path, mode)  # noqa: SIM115 - whoever writes closes it
        self._room = room

    def write(self, data: bytes) -> int:
        self._file.write(data[: self._room])
        if len(data) > self._room:
            raise OSError(errno.ENOSPC, "No space left on device")
        self._room -= len(data)
        return len(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)
