"""Named shared memory of a ring: laid out here, made and removed by its owner, attached to by everybody else.

A segment is an array of 64-bit integers: a header, then the slots. What different processes write stands on cache lines of its
own (128 bytes: Apple's lines, and the pairs of lines that x86 fetches), so that no writer slows another one down.
"""

from __future__ import annotations

import os
import secrets
import shutil
import sys
from collections.abc import Sized
from contextlib import suppress
from multiprocessing import resource_tracker
from multiprocessing.shared_memory import SharedMemory
from threading import Lock
from typing import TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from servobench.errors import FormatError, StorageError, UsageError

Memory: TypeAlias = NDArray[np.int64]

LINE = 16  # integers, 128 bytes
# The header: a line that never changes, the number of records published, and a line for each word.
MAGIC, VERSION, KIND, SLOTS, WIDTH = 0, 1, 2, 3, 4
HEAD = LINE
FIRST_WORD = 2 * LINE
WORDS = 8
HEADER = FIRST_WORD + WORDS * LINE

SERVOBENCH = int.from_bytes(b"srvbench", "little")
LAYOUT = 1
KINDS = {"rows": 1, "texts": 2}

# Where Linux keeps shared memory. In a container it can be small, and to touch more than there is kills the process.
_LINUX_FOLDER = "/dev/shm"
_attaching = Lock()


class Segment(SharedMemory):
    """Shared memory that says nothing where somebody still holds an array in it: the mapping lives as long as that array."""

    def close(self) -> None:
        """Let go of the memory, or leave that to the last array in it."""
        with suppress(BufferError):
            super().close()


def created(kind: str, slots: int, width: int) -> Segment:
    """Return new shared memory for `slots` records of `width` 64-bit integers, all zero; `kind` is one of `KINDS`.

    It is called servobench-KIND-PROCESS-RANDOM, so that a leftover can be told by its name. Raises `StorageError` where there is
    too little memory for it.
    """
    size = 8 * (HEADER + slots * width)
    if os.path.isdir(_LINUX_FOLDER) and (free := shutil.disk_usage(_LINUX_FOLDER).free) < size:
        raise StorageError(
            f"{_LINUX_FOLDER}: {size} bytes of shared memory are needed, {free} are left; "
            "give it more (in a container: --shm-size), or ask for fewer slots"
        )
    while True:
        # macOS takes no longer names.
        name = f"servobench-{kind}-{os.getpid()}-{secrets.token_hex(2)}"
        with suppress(FileExistsError):
            segment = Segment(name, create=True, size=size)
            break
    memory = integers(segment)
    memory[:] = 0  # touched here, so that the loop isn't held up by pages that it is the first to use
    memory[VERSION], memory[KIND], memory[SLOTS], memory[WIDTH] = LAYOUT, KINDS[kind], slots, width
    memory[MAGIC] = SERVOBENCH
    return segment


def attached(kind: str, name: str) -> Segment:
    """Return the shared memory of that name, which another process made and will remove.

    Raises `UsageError` where there is none, and `FormatError` where it isn't a ring of that kind.
    """
    try:
        segment = _untracked(name)
    except FileNotFoundError:
        raise UsageError(
            f"there is no shared memory called {name!r}: the run that made it has ended, or the name is misspelt; "
            "take the name from a run that is still going on"
        ) from None
    except OSError as error:
        raise UsageError(f"shared memory {name!r} can't be attached to: {error.strerror}") from error
    except ValueError:  # nothing of size zero can be mapped
        raise FormatError(f"shared memory {name!r} is empty, so it is no ring of servobench's") from None
    try:
        _check(kind, name, segment)
    except FormatError:
        segment.close()
        raise
    return segment


def integers(segment: Segment) -> Memory:
    """Return all of a segment as integers."""
    # Unlike np.ndarray(buffer=...), this array keeps the memory mapped: without it, using the array after the end would crash.
    return np.frombuffer(cast(memoryview, segment.buf), np.int64, count=segment.size // 8)


def _untracked(name: str) -> Segment:
    """Attach without being held responsible for the memory.

    Before Python 3.13 who attaches is noted down as one who has to remove it, and the tracker of such a process does so at its
    end, under the feet of all others. To strike it out again isn't enough: processes that share a tracker, as those of
    multiprocessing do, would strike out the owner's own note. So none is made.
    """
    if sys.version_info >= (3, 13):
        return Segment(name, track=False)
    with _attaching:
        register = resource_tracker.register
        resource_tracker.register = _not_noted
        try:
            return Segment(name)
        finally:
            resource_tracker.register = register


def _not_noted(name: Sized, rtype: str) -> None:
    """Stand in for the tracker's `register`."""


def _check(kind: str, name: str, segment: Segment) -> None:
    """Raise `FormatError` where a segment isn't a ring of that kind, of this version, and whole."""
    memory = integers(segment)
    if len(memory) < HEADER or memory[MAGIC] != SERVOBENCH:
        raise FormatError(
            f"shared memory {name!r} is another program's: it doesn't begin as a ring of servobench's does"
        )
    if memory[VERSION] != LAYOUT:
        raise FormatError(
            f"shared memory {name!r} has layout {memory[VERSION]}, and this servobench knows layout {LAYOUT}; "
            "run both processes with the same version"
        )
    if memory[KIND] != KINDS[kind]:
        known = {number: word for word, number in KINDS.items()}
        found = known.get(int(memory[KIND]), f"records of an unknown kind ({memory[KIND]})")
        raise FormatError(
            f"shared memory {name!r} holds {found}, and {kind} are expected; take the other ring's name"
        )
    slots, width = int(memory[SLOTS]), int(memory[WIDTH])
    if slots < 2 or slots & (slots - 1) or width < 1 or HEADER + slots * width > len(memory):
        raise FormatError(
            f"shared memory {name!r} is damaged: {slots} slots of {8 * width} bytes don't fit into its {segment.size} bytes"
        )
