"""Signals that Simulink logs to a MAT file of version 7.3: the Dataset describes them, their samples stand apart.

Each signal of the Dataset is a struct with the number of a stream; `#sigstream#/N/#data#` holds the bytes of its samples.
The layout isn't published; it was read off files that Simulink wrote. What differs from it is left out, never guessed.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from servobench.core.channels import Array, Channel
from servobench.recordings.recording import Series

SAMPLE_TYPES = {
    "double": "<f8", "single": "<f4", "logical": "u1",
    "int8": "i1", "int16": "<i2", "int32": "<i4", "int64": "<i8",
    "uint8": "u1", "uint16": "<u2", "uint32": "<u4", "uint64": "<u8",
}  # fmt: skip
"""The types of a sample by their names in MATLAB."""


@dataclass(frozen=True, kw_only=True)
class StreamedSignal:
    """A logged signal: its channel, the number of its stream, the type of a sample, and its even times."""

    channel: Channel
    """Its name and unit."""
    stream: int
    """The number of its stream."""
    sample_type: str
    """MATLAB's name of a sample's type, one of `SAMPLE_TYPES`."""
    start: float
    """The time of the first sample [s]."""
    step: float
    """The time between samples [s]."""
    count: int
    """The number of samples."""

    def series(self, samples: Array) -> Series:
        """Return the signal with its samples (N,) and their times."""
        t = self.start + self.step * np.arange(self.count, dtype=np.float64)
        return Series(channel=self.channel, values=samples, t=t)


@dataclass(frozen=True, kw_only=True)
class UnreadSignal:
    """The name of a logged signal that isn't a stream of single real numbers at even times."""

    name: str


def is_logged_signal(value: Any) -> bool:
    """Return whether a value is the struct that describes one logged signal."""
    names = getattr(getattr(value, "dtype", None), "names", None) or ()
    return value.size == 1 and {"ElementType", "BlockPath", "Values"} <= set(names) if names else False


def fields(struct: Any) -> Mapping[str, Any]:
    """Return the fields of a struct as mat-io gives it, or none where it isn't a single struct."""
    if isinstance(struct, np.ndarray) and struct.dtype.names and struct.size == 1:
        return dict(zip(struct.dtype.names, struct.ravel()[0], strict=True))
    return {}


def samples(path: Path, signals: Sequence[StreamedSignal]) -> Iterator[Series]:
    """Yield the logged signals of a file with their samples; raises `ValueError` where a stream isn't what its signal says."""
    import h5py

    if not signals:
        return
    with h5py.File(path, "r") as file:
        for signal in signals:
            group = file.get(f"#sigstream#/{signal.stream}")
            data = group.get("#data#") if isinstance(group, h5py.Group) else None
            size = signal.count * np.dtype(SAMPLE_TYPES[signal.sample_type]).itemsize
            if not isinstance(data, h5py.Dataset) or data.dtype != np.uint8 or data.size != size:
                raise ValueError(
                    f"the {signal.count} samples of `{signal.channel.name}` aren't in its stream"
                )
            raw = data[()].tobytes()
            yield signal.series(np.frombuffer(raw, SAMPLE_TYPES[signal.sample_type]).astype(np.float64))
