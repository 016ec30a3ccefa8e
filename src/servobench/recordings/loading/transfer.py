"""Recordings on their way out of the child process: one line of JSON, then the samples as they lie in memory."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import IO, Any

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import FormatError
from servobench.recordings.formats import metadata
from servobench.recordings.recording import Recording

_NUMBER = 8  # bytes of a float


def send(recordings: Iterable[Recording], to: IO[bytes]) -> None:
    """Write recordings to a pipe; times that several channels share are written once."""
    arrays: list[Array] = []
    places: dict[int, int] = {}

    def place(array: Array | None) -> int | None:
        if array is None:
            return None
        if id(array) not in places:
            places[id(array)] = len(arrays)
            arrays.append(array)
        return places[id(array)]

    described = [
        {
            "recording": metadata.describe(each),
            "samples": [[place(series.values), place(series.t)] for series in each.series],
        }
        for each in recordings
    ]
    send_line({"recordings": described, "lengths": [len(array) for array in arrays]}, to)
    for array in arrays:
        to.write(np.ascontiguousarray(array, dtype=np.float64).data)
    to.flush()


def send_line(value: dict[str, Any], to: IO[bytes]) -> None:
    """Write a value as one line of JSON."""
    to.write(json.dumps(value).encode("ascii") + b"\n")
    to.flush()


def recordings_from_pipe(
    reply: dict[str, Any], rest: IO[bytes], most: int, name: str
) -> tuple[Recording, ...]:
    """Return the recordings that a line describes, with their samples from the pipe behind it.

    `most` is how many bytes the samples may come to, `name` the file's. Raises `FormatError` where they are more,
    and `EOFError` where the pipe ends before they do.
    """
    total = _NUMBER * sum(reply["lengths"])
    if total > most:
        raise FormatError(
            f"{name} expands to {total} bytes of numbers; at most {most} are read from a file of its size. "
            "If it is sound, save it without compression"
        )
    arrays = [_array(rest, length) for length in reply["lengths"]]
    return tuple(
        metadata.restore(
            each["recording"],
            [(arrays[values], None if times is None else arrays[times]) for values, times in each["samples"]],
            name,
        )
        for each in reply["recordings"]
    )


def _array(pipe: IO[bytes], length: int) -> Array:
    data = pipe.read(_NUMBER * length)
    if len(data) < _NUMBER * length:
        raise EOFError
    return np.frombuffer(data, dtype=np.float64)
