"""Damaged copies of a file; run as a program it reads each of them and reports what came of it.

A process of its own, so that a crash, a hang or an excess of memory is one of the reader and ends nothing else.
"""

from __future__ import annotations

import json
import os
import re
import struct
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from servobench.core.errors import ServobenchError
from servobench.recordings.loading import reader_process
from servobench.recordings.loading.load import load
from tests.files import refill
from tests.processes import most_memory

_LIES = (
    0, 1, 2, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 2**24,
    2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1, 2**63, 2**64 - 1,
)  # fmt: skip
_NUMBERS = re.compile(rb"[0-9]+")
_PATIENCE = (
    5  # s of a reading process; a library that takes for ever over a file would cost all that it usually gets
)


def mutations(data: bytes, seed: int, count: int) -> Iterator[bytes]:
    """Yield damaged copies of a file, of seven kinds in turn; the first kilobyte, where headers are, gets half of the damage."""
    random = np.random.default_rng(seed)
    kinds = (_flipped, _flipped, _cut, _inserted, _removed, _repeated, _lying)
    for k in range(count):
        yield bytes(kinds[k % len(kinds)](bytearray(data), random))


def _place(data: bytearray, random: np.random.Generator) -> int:
    last = len(data) if random.random() < 0.5 else min(len(data), 1024)
    return int(random.integers(0, last))


def _flipped(data: bytearray, random: np.random.Generator) -> bytearray:
    """One to eight bytes are others, or have one bit flipped."""
    for _ in range(int(random.integers(1, 9))):
        place = _place(data, random)
        data[place] = (
            int(random.integers(0, 256))
            if random.random() < 0.5
            else data[place] ^ 1 << int(random.integers(0, 8))
        )
    return data


def _cut(data: bytearray, random: np.random.Generator) -> bytearray:
    """The end is missing; now and then the beginning is."""
    place = int(random.integers(0, len(data)))
    return data[place:] if random.random() < 0.2 else data[:place]


def _inserted(data: bytearray, random: np.random.Generator) -> bytearray:
    """Noise stands in between."""
    place = _place(data, random)
    data[place:place] = random.bytes(int(random.integers(1, 40)))
    return data


def _removed(data: bytearray, random: np.random.Generator) -> bytearray:
    """A piece is missing."""
    place = _place(data, random)
    del data[place : place + int(random.integers(1, 200))]
    return data


def _repeated(data: bytearray, random: np.random.Generator) -> bytearray:
    """A piece of the file stands in another place of it, in addition or over what was there."""
    start, size, place = _place(data, random), int(random.integers(1, 400)), _place(data, random)
    piece = data[start : start + size]
    data[place : place if random.random() < 0.5 else place + len(piece)] = piece
    return data


def _lying(data: bytearray, random: np.random.Generator) -> bytearray:
    """A number that may be a length is another: a field of 1 to 8 bytes, or the digits of one in a text."""
    written = list(_NUMBERS.finditer(bytes(data)))
    if written and random.random() < 0.3:
        found = written[int(random.integers(0, len(written)))]
        data[found.start() : found.end()] = str(_LIES[int(random.integers(0, len(_LIES)))]).encode()
        return data
    size = int(random.choice([1, 2, 4, 8]))
    place = _place(data, random) if random.random() < 0.5 else _place(data, random) // size * size
    lie = _LIES[int(random.integers(0, len(_LIES)))] % 2 ** (8 * size)
    packed = struct.pack("<Q" if random.random() < 0.8 else ">Q", lie)
    data[place : place + size] = packed[:size] if packed[0] or not lie else packed[-size:]
    return data


def _outcome(path: Path) -> str:
    """The outcome of reading a file: the number of recordings, or the kind of error; a foreign error with its traceback."""
    try:
        recordings = load(path)
    except ServobenchError as error:
        if path.name not in str(error):
            return f"an error that doesn't name the file: {error}"
        return "refused"
    except BaseException:
        return traceback.format_exc()
    finite = all(series.values.dtype == np.float64 for each in recordings for series in each.series)
    return "read" if finite else "a channel that isn't float64"


def main(file: str, seed: str, first: str, last: str) -> None:
    """Read the damaged copies of a file with these numbers; print how often each thing came of it, and the most memory."""
    warnings.simplefilter("error")
    path = Path(file)
    data = path.read_bytes()
    load(path)  # libraries are loaded, which takes as long as it takes, and caches filled
    reader_process._SECONDS = _PATIENCE
    outcomes: Counter[str] = Counter()
    for damaged in islice(mutations(data, int(seed), int(last)), int(first), None):
        refill(path, damaged or b"\n")
        outcomes[_outcome(path)] += 1
    json.dump({"outcomes": outcomes, "most_memory": most_memory(os.getpid())}, sys.stdout)


if __name__ == "__main__":
    main(*sys.argv[1:])
