"""The limit for the unpacked size of a compressed file, so that a small file can't fill the memory."""

from __future__ import annotations

from pathlib import Path

from servobench.recordings.formats.bag_folder import size_of

MOST_BYTES = 2**30
"""The most bytes that the content of a file may come to, as the floats of a recording."""

_ALWAYS = 2**28  # bytes, 33 million numbers: read from a file of any size
_RATIO = 20  # beyond that; a voltage in steps and counted angles compress to about a tenth, only constants to a thousandth


def most_bytes(file: Path) -> int:
    """Return how many bytes the content of a file may come to as floats: what its own size accounts for."""
    return min(MOST_BYTES, _ALWAYS + _RATIO * size_of(file))
