"""Files that a test fills again and again."""

from __future__ import annotations

from pathlib import Path


def refill(path: Path, data: bytes) -> None:
    """Let a file hold these bytes, and no others.

    `Path.write_bytes` empties it first, and on ext4 a file that was emptied and filled waits for the disk: some milliseconds,
    of which thousands of damaged copies of a file take minutes.
    """
    with open(path, "r+b" if path.exists() else "wb") as file:
        file.write(data)
        file.truncate()
