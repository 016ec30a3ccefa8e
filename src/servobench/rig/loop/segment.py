"""Named shared memory of a ring: laid out here, made and removed by its owner, attached to by everybody else.

A segment is an array of 64-bit integers: a header, then the slots. What different processes write stands on cache lines of its
own (128 bytes: Apple's lines, and the pairs of lines that x86 fetches), so that no writer slows another one down.
"""

from __future__ import annotations

import atexit
import errno
import os
import secrets
import shutil
import sys
from collections.abc import Iterator, Sized
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory
from threading import RLock
from typing import TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from servobench.core.errors import FormatError, StorageError, UsageError
from servobench.recordings.native.lease import share
from servobench.rig.loop.leftovers import FOLDER, sweep

Memory: TypeAlias = NDArray[np.int64]

LINE = 16  # integers, 128 bytes
# The header: a line that never changes, the number of records published, and a line for each word.
MAGIC, VERSION, KIND, SLOTS, WIDTH = 0, 1, 2, 3, 4
HEAD = LINE
FIRST_WORD = 2 * LINE
WORDS = 16
HEADER = FIRST_WORD + WORDS * LINE

SERVOBENCH = int.from_bytes(b"srvbench", "little")
LAYOUT = 2
KINDS = {"rows": 1, "texts": 2}

# Reentrant: where a new segment can't grow to its size Python removes it while it is being made.
_attaching = RLock()
_ours: set[str] = set()
"""The names of what this process made and hasn't removed yet."""


class Segment(SharedMemory):
    """Shared memory that can be closed while an array in it is in use: the mapping lives as long as that array.

    Each process that has it open shares a lock on it, which shows whether any of them is alive (`leftovers`).
    """

    _fd: int

    def fileno(self) -> int:
        """Return the number of the open file that the memory is on POSIX, -1 elsewhere."""
        return self._fd

    def close(self) -> None:
        """Let go of the memory, or leave that to the last array in it."""
        with suppress(BufferError):
            super().close()

    def unlink(self) -> None:
        """Remove the memory; attached processes keep theirs."""
        _ours.discard(self.name)
        with suppress(FileNotFoundError), _no_tracker():  # it may have been removed already
            super().unlink()

    @property
    def is_orphan(self) -> bool:
        """Whether its owner, the process that created it, is dead; the owner's id is in its name."""
        return self.name.split("-")[2:3] != [str(os.getppid())]


def create(kind: str, slots: int, width: int) -> Segment:
    """Return new shared memory for `slots` records of `width` 64-bit integers, all zero; `kind` is one of `KINDS`.

    It is called servobench-KIND-PROCESS-RANDOM, so that a leftover can be recognised by its name. Raises `StorageError` where
    there is too little memory for it.
    """
    size = 8 * (HEADER + slots * width)
    if os.path.isdir(FOLDER) and (free := shutil.disk_usage(FOLDER).free) < size:
        raise StorageError(
            f"{FOLDER}: {size} bytes of shared memory are needed, {free} are left; "
            "give it more (in a container: --shm-size), or ask for fewer slots"
        )
    sweep()
    segment = _new(kind, size)
    if not _ours:
        atexit.register(_remove_ours)
    _ours.add(segment.name)
    memory = integers(segment)
    memory[:] = 0  # touched here, so that the loop isn't held up by pages that it is the first to use
    memory[VERSION], memory[KIND], memory[SLOTS], memory[WIDTH] = LAYOUT, KINDS[kind], slots, width
    memory[MAGIC] = SERVOBENCH
    return segment


def attach(kind: str, name: str) -> Segment:
    """Return the shared memory of that name, which another process made and will remove.

    Raises `UsageError` where there is none, and `FormatError` where it isn't a ring of that kind.
    """
    try:
        segment = _open_untracked(name, create=False, size=0)
    except FileNotFoundError:
        raise UsageError(
            f"there is no shared memory called {name!r}: the run that made it has ended, or the name is misspelt; "
            "use the name of a run in progress"
        ) from None
    except OSError as error:
        raise UsageError(f"shared memory {name!r} can't be attached to: {error.strerror}") from error
    except ValueError:  # nothing of size zero can be mapped
        raise FormatError(f"shared memory {name!r} is empty, so it isn't a servobench ring") from None
    try:
        _check(kind, name, segment)
    except FormatError:
        segment.close()
        raise
    return segment


def _new(kind: str, size: int) -> Segment:
    """New shared memory under an unused name."""
    while True:
        # macOS takes no longer names.
        name = f"servobench-{kind}-{os.getpid()}-{secrets.token_hex(2)}"
        try:
            return _open_untracked(name, create=True, size=size)
        except FileExistsError:
            continue
        except OSError as error:
            # To the system shared memory is a file.
            advice = "allow larger files (ulimit -f)" if error.errno == errno.EFBIG else "free some memory"
            raise StorageError(
                f"{size} bytes of shared memory aren't available: {error.strerror or error}; {advice}, then try again"
            ) from error


def integers(segment: Segment) -> Memory:
    """Return all of a segment as integers."""
    # Unlike np.ndarray(buffer=...), this array keeps the memory mapped: without it, using the array after the end would crash.
    return np.frombuffer(cast(memoryview, segment.buf), np.int64, count=segment.size // 8)


def _remove_ours() -> None:
    """Remove leftover memory at the end of the process, for example after a Ctrl-C between two steps."""
    for name in tuple(_ours):
        with suppress(OSError):
            _open_untracked(name, create=False, size=0).unlink()


def _open_untracked(name: str, *, create: bool, size: int) -> Segment:
    """Make or attach without Python's tracker, a process that removes at the end of another one what that has left.

    Before Python 3.13 who attaches is noted down as one who has to remove it, and the tracker of such a process does so at its
    end, under the feet of all others. To strike it out again isn't enough: processes that share a tracker, as those of
    multiprocessing do, would strike out the owner's own note. And where the owner is killed its tracker complains, although the
    loop and the recorder clear up (`is_orphan`). So no note is made.
    """
    if sys.version_info >= (3, 13):
        segment = Segment(name, create=create, size=size, track=False)
    else:
        with _no_tracker():
            segment = Segment(name, create=create, size=size)
    if sys.platform == "linux":
        share(segment)
    return segment


@contextmanager
def _no_tracker() -> Iterator[None]:
    """Keep the memory out of Python's tracker of shared memory; from 3.13 on there is an option for it."""
    if sys.version_info >= (3, 13):
        yield
        return
    with _attaching:
        original = resource_tracker.register, resource_tracker.unregister
        resource_tracker.register = resource_tracker.unregister = _not_noted
        try:
            yield
        finally:
            resource_tracker.register, resource_tracker.unregister = original


def _not_noted(name: Sized, rtype: str) -> None:
    """Stand in for the tracker's `register` and `unregister`."""


def _check(kind: str, name: str, segment: Segment) -> None:
    """Raise `FormatError` where a segment isn't a ring of that kind, of this version, and whole."""
    memory = integers(segment)
    if len(memory) < HEADER or memory[MAGIC] != SERVOBENCH:
        raise FormatError(
            f"shared memory {name!r} belongs to another program: it doesn't begin like a servobench ring"
        )
    if memory[VERSION] != LAYOUT:
        raise FormatError(
            f"shared memory {name!r} has layout {memory[VERSION]}, and this servobench uses layout {LAYOUT}; run "
            "both processes with the same version"
        )
    if memory[KIND] != KINDS[kind]:
        known = {number: word for word, number in KINDS.items()}
        contents = known.get(int(memory[KIND]), f"records of an unknown kind ({memory[KIND]})")
        raise FormatError(
            f"shared memory {name!r} holds {contents}; expected {kind}: use the other ring's name"
        )
    slots, width = int(memory[SLOTS]), int(memory[WIDTH])
    if slots < 2 or slots & (slots - 1) or width < 1 or HEADER + slots * width > len(memory):
        raise FormatError(
            f"shared memory {name!r} is damaged: {slots} slots of {8 * width} bytes don't fit into its {segment.size} bytes"
        )
