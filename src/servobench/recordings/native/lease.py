"""A lock that marks a file as being written; the system releases it when the process ends, however it ends."""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path
from typing import BinaryIO, Protocol

_TAKEN = {errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES, errno.EDEADLK}
# On Windows a locked byte can't be read by anybody else, so it is one that a recording of hours doesn't have; its runtime takes
# no place behind 2 GiB.
_BEYOND = (1 << 31) - 2


class HasNumber(Protocol):
    """An open file, by its number in this process."""

    def fileno(self) -> int:
        """Return the number."""
        ...


def hold(file: BinaryIO) -> bool:
    """Lock a file that is open for writing until it is closed; return whether that is possible where it is."""
    return _lock(file, shared=False) is not False


def share(file: HasNumber) -> bool:
    """Lock an open file together with others, so that no process can `hold` it; return whether its file system allows that."""
    return _lock(file, shared=True) is not False


def is_held(path: str | os.PathLike[str]) -> bool:
    """Return whether a process that lives holds the file; False where there is none, or locks aren't known where it is."""
    try:
        # Windows and network drives lock only what may be written.
        with Path(path).open("r+b") as file:
            return _lock(file, shared=True) is False
    except OSError:
        return False


def _lock(file: BinaryIO | HasNumber, *, shared: bool) -> bool | None:
    """Take the lock without waiting: True, False if another process has it, None if there are no locks."""
    try:
        if sys.platform == "win32":
            _lock_on_windows(file)
        else:
            _lock_on_posix(file, shared=shared)
    except ImportError:
        return None
    except OSError as error:
        return False if error.errno in _TAKEN else None
    return True


if sys.platform == "win32":

    def _lock_on_windows(file: BinaryIO) -> None:
        import msvcrt

        place = file.tell()
        try:
            file.seek(_BEYOND)
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        finally:
            file.seek(place)

else:

    def _lock_on_posix(file: HasNumber, *, shared: bool) -> None:
        import fcntl

        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
