"""Writes a WPILib data log of entries that are doubles."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.formats.datalog import MAGIC

_VERSION = 0x0100
# The first byte of a record says how long its parts are: 4 bytes of entry, 1 of size (4 in a control record), 8 of stamp.
_VALUE, _CONTROL = 0b0_111_00_11, 0b0_111_11_11
_RECORD = np.dtype(
    [("bits", "u1"), ("entry", "<u4"), ("size", "u1"), ("stamp", "<i8"), ("value", "<f8")]
)  # packed, as a log has no padding
_LATEST = 2**62  # µs; what no stamp can hold becomes the nearest that can


@dataclass(frozen=True, kw_only=True, eq=False)
class Written:
    """An entry to write: its `name`, values (N,) in its `unit`, and their times t (N,) [s], kept in whole microseconds."""

    name: str
    unit: str | None
    values: Array
    t: Array


def write(path: Path, extra: str, entries: Sequence[Written]) -> None:
    """Write a log with that text in its header and those entries, numbered from 1."""
    text = extra.encode()
    with path.open("wb") as file:
        file.write(struct.pack("<6sHI", MAGIC, _VERSION, len(text)) + text)
        for number, entry in enumerate(entries, 1):
            file.write(_start(number, entry))
        for number, entry in enumerate(entries, 1):
            records = np.empty(len(entry.values), _RECORD)
            records["bits"], records["entry"], records["size"] = _VALUE, number, 8
            with np.errstate(over="ignore", invalid="ignore"):
                stamps = np.nan_to_num(np.rint(1e6 * entry.t), nan=0.0)
            records["stamp"] = np.clip(stamps, -_LATEST, _LATEST).astype(np.int64)
            records["value"] = entry.values
            file.write(records.tobytes())


def _start(number: int, entry: Written) -> bytes:
    """The record that starts an entry, at stamp 0."""
    about = "" if entry.unit is None else json.dumps({"unit": entry.unit})
    texts = [text.encode("utf-8", "backslashreplace") for text in (entry.name, "double", about)]
    payload = struct.pack("<BI", 0, number) + b"".join(struct.pack("<I", len(text)) + text for text in texts)
    return struct.pack("<BIIq", _CONTROL, 0, len(payload), 0) + payload
