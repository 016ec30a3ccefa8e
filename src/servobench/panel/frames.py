"""Data for the scopes: rows of the loop through the measurement's stages, and their frame as bytes."""

from __future__ import annotations

import math
import struct
import time
from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.panel.kernels import BEFORE, display_block
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.block_processing import process_block
from servobench.recordings.measurement.derivative import Derivative
from servobench.recordings.measurement.scale import Scale
from servobench.recordings.measurement.unwrap import Unwrap
from servobench.recordings.recording import Recording

COLUMNS = (
    "t",
    "reference",
    "commanded",
    "applied",
    "counts",
    "position",
    "speed_raw",
    "speed",
    "current",
    "residual",
    "late",
    "saturated",
    "command",
)
_POSITION, _SPEED_RAW, _SPEED = (COLUMNS.index(name) for name in ("position", "speed_raw", "speed"))
MAGIC = 0x31425653  # "SVB1"
_HEADER = struct.Struct("<IIIId")
_TIMES, _OTHERS = np.dtype("<f8"), np.dtype("<f4")
KEPT = 10.0  # s; what a new viewer sees at once
_AS_RECORDED = ("reference", "commanded", "applied", "counts", "current", "late", "saturated", "command")
_SETTLING = (
    2.0  # s of positions through which another chain is run before it's shown, so that its start isn't seen
)
_FORGOTTEN = 0.01  # of a filter's start state; with less left of it what comes out counts as known


def encode(first: int, values: Array) -> bytes:
    """Return rows (N, 13), the first of them number `first`, as the bytes of a frame, little-endian.

    u32 magic, u32 N, u32 13, u32 0, f64 `first`; then the times as f64 (N,), and each other column of `COLUMNS` as f32 (N,).
    """
    header = _HEADER.pack(MAGIC, len(values), len(COLUMNS), 0, first)
    others = np.ascontiguousarray(values[:, 1:].T, _OTHERS)
    return header + values[:, 0].astype(_TIMES).tobytes() + others.tobytes()


def speed_chain(text: str) -> Chain:
    """Return the chain from the shaft's position [rad] to the speed that is shown [rad/s], of a chain's text.

    The counts are unwrapped and turned into rad before, so stages that do this in the text aren't done twice. One that leaves a
    position is followed by the derivative. Raises `UsageError` for a text that is no chain, or one that takes a speed.
    """
    stages = tuple(
        stage
        for stage in Chain.parse(text).stages
        if not isinstance(stage, Unwrap) and not (isinstance(stage, Scale) and stage.unit is not None)
    )
    chain = Chain(stages)
    return chain if chain.yields("position") == "speed" else chain + Chain((Derivative(),))


@dataclass
class _Through:
    """A chain that is being gone through; what comes out before it is known is NaN."""

    chain: Chain

    def __post_init__(self) -> None:
        self._state = self.chain.start()
        self._times: Array | None = np.empty(
            0
        )  # s since its first sample; None once all that comes out is known

    def __call__(self, x: Array, dt: Array) -> Array:
        self._state, y = process_block(self.chain, self._state, x, dt)
        y[: self._unknown(dt)] = math.nan
        return y

    def _unknown(self, dt: Array) -> int:
        """The number of next outputs that look back before the first sample, or still show the filter's start from zero."""
        if self._times is None or not len(dt):
            return 0
        before = len(self._times)
        last = self._times[-1] if before else 0.0
        t = np.concatenate([self._times, last + np.cumsum(dt)])
        start = np.abs(self.chain.start_responses(t)).max(axis=1, initial=0.0)
        known = self.chain.valid(t) & ((start < _FORGOTTEN) | (t - t[0] >= _SETTLING))
        self._times = None if known.any() else t
        return (int(known.argmax()) if known.any() else len(t)) - before


class Scope:
    """Turns the rows of one run into what scopes show, block after block.

    `opened` says what is in a row; `chain` is the text of the measurement chain that the speed goes through. What the device
    hasn't got is NaN.
    """

    def __init__(self, opened: Recording, chain: str) -> None:
        names = ["t", *(series.channel.name for series in opened.series)]
        self._counts = names.index("counts")
        recorded = [name for name in ("t", *_AS_RECORDED) if name in names]
        self._columns = np.array([[of.index(name) for name in recorded] for of in (names, COLUMNS)])
        counter = opened["counts"].channel
        self._radians = 2 * math.pi / counter.counts_per_rev if counter.counts_per_rev else math.nan
        self._modulus = 0.0 if counter.counter_bits is None else 2.0**counter.counter_bits
        self._before = np.full(BEFORE, math.nan)
        self._speed = _Through(speed_chain(chain))
        self._seen: deque[tuple[Array, Array]] = deque()

    def take(self, rows: Array) -> Array:
        """Return what rows (N, C) of the ring show, (N, 13) in the order of `COLUMNS`."""
        columns = np.empty((len(COLUMNS) + 3, len(rows)))
        shown = columns[: len(COLUMNS)].T
        if not len(rows):
            return shown
        display_block(rows, self._columns, self._counts, self._modulus, self._radians, self._before, columns)
        if math.isnan(self._radians):
            return shown
        position, dt = columns[-3], columns[-1]
        columns[_POSITION : _SPEED_RAW + 1] = columns[-3:-1]
        columns[_SPEED] = self._speed_of(position, dt)
        self._remember(columns[0], position)
        return shown

    def change_chain(self, chain: str) -> None:
        """Show the speed through another chain from now on, as if it had been used for two seconds already."""
        self._speed = _Through(speed_chain(chain))
        if self._seen:
            t = np.concatenate([each for each, _ in self._seen])
            self._speed_of(np.concatenate([each for _, each in self._seen]), np.diff(t, prepend=t[0]))

    def _speed_of(self, position: Array, dt: Array) -> Array:
        """The speed; none where a filter by forward Euler diverges over a gap, after which it starts again."""
        try:
            return self._speed(position, dt)
        except UsageError:
            self._speed = _Through(self._speed.chain)
            return np.full(len(position), math.nan)

    def _remember(self, t: Array, position: Array) -> None:
        self._seen.append((t, position))
        while self._seen[0][0][-1] < t[-1] - _SETTLING:
            self._seen.popleft()


class History:
    """The last ten seconds of what was shown, so that each viewer gets everything since the row it has seen last.

    A block is encoded once, and viewers that are as far get the same bytes.
    """

    def __init__(self) -> None:
        self._blocks: deque[tuple[int, Array, bytes]] = deque()
        self._came: deque[tuple[int, float]] = deque()  # a block's first row, and when it came

    def add(self, first: int, values: Array) -> None:
        """Take a block of rows (N, 13), N at least 1, the first of them number `first`."""
        self._blocks.append((first, values, encode(first, values)))
        self._came.append((first, time.monotonic()))
        while self._blocks[0][1][-1, 0] < values[-1, 0] - KEPT:
            self._blocks.popleft()
            self._came.popleft()

    @property
    def next(self) -> int:
        """The number of the row that comes next."""
        return self._blocks[-1][0] + len(self._blocks[-1][1]) if self._blocks else 0

    @property
    def time(self) -> float:
        """The time of the last row [s]."""
        return float(self._blocks[-1][1][-1, 0]) if self._blocks else 0.0

    def came(self, number: int) -> float | None:
        """Return when the row of that number came [s, monotonic], None where it hasn't come yet.

        Of a row that is no longer kept, or a number beyond the next, which is another run's, it is when the oldest one came.
        """
        if not self._came or number == self.next:
            return None
        newest_first = reversed(self._came)
        return next((when for first, when in newest_first if first <= number < self.next), self._came[0][1])

    def since(self, number: int) -> list[bytes]:
        """Return the frames with all rows from that number on that are still there; rows that the loop lost divide frames."""
        if self._blocks and number > self._blocks[-1][0]:
            return []
        if (
            len(self._blocks) > 1 and number > self._blocks[-2][0]
        ):  # as for nearly everybody, thirty times a second
            return [self._blocks[-1][2]]
        wanted = [block for block in self._blocks if block[0] >= number]
        if len(wanted) < 2:
            return [block[2] for block in wanted]
        frames = []
        together = [wanted[0]]
        for before, block in pairwise(wanted):
            if block[0] != before[0] + len(before[1]):
                frames.append(_join(together))
                together = []
            together.append(block)
        return [*frames, _join(together)]


def _join(blocks: list[tuple[int, Array, bytes]]) -> bytes:
    if len(blocks) == 1:
        return blocks[0][2]
    return encode(blocks[0][0], np.concatenate([values for _, values, _ in blocks]))
