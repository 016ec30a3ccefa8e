"""The processes of this machine, by Linux, and what only one of them does at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def children(parent: int, named: str) -> list[int]:
    """The processes that a process has started, by a part of their command line."""
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdecimal():
            continue
        try:
            stat = (entry / "stat").read_text()
            line = (entry / "cmdline").read_bytes().decode()
        except OSError:  # it has ended meanwhile
            continue
        if int(stat.rpartition(")")[2].split()[1]) == parent and named in line:
            found.append(int(entry.name))
    return found


def most_memory(pid: int) -> int:
    """The most memory that a process has had so far [bytes].

    Of the program that it runs: `getrusage` counts what the process was before, too, which is a copy of the one that started it.
    """
    status = Path(f"/proc/{pid}/status").read_text()
    return 1024 * int(status.split("VmHWM:")[1].split()[0])


@contextmanager
def alone(lock: Path) -> Iterator[None]:
    """Keep other processes waiting that want to do the same, until this one has done it or has ended."""
    import fcntl

    with lock.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
