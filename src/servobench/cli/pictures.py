"""Plots made of characters: a line over time, and a one-line histogram."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len
from rich.console import Console

from servobench.core.channels import Array, measurable
from servobench.core.rounding import plain

# Where the dots of a cell are in the Braille block, by row and column.
_BRAILLE = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]])
_FIRST_BRAILLE = 0x2800
_BARS = "▁▂▃▄▅▆▇█"
_ASCII_BARS = ".:-=+*#@"
_WIDEST = 72  # characters for the line itself; a longer one shows no more


@dataclass(frozen=True, kw_only=True)
class Pen:
    """The characters of a picture: Braille dots, eight in a character, or in ASCII one mark a character."""

    braille: bool

    @property
    def dots(self) -> tuple[int, int]:
        """The dots of a character, down and across."""
        return (4, 2) if self.braille else (1, 1)

    @property
    def bars(self) -> str:
        """The characters of a bar, from the lowest to the highest."""
        return _BARS if self.braille else _ASCII_BARS

    def rows(self, dots: NDArray[np.bool_]) -> list[str]:
        """Return dots (4 R, 2 C) or (R, C), the first row on top, as R lines of C characters."""
        if not self.braille:
            return ["".join("*" if dot else " " for dot in row) for row in dots]
        down, across = self.dots
        cells = dots.reshape(dots.shape[0] // down, down, dots.shape[1] // across, across)
        codes = np.einsum("rdca,da->rc", cells.astype(np.int64), _BRAILLE)
        return ["".join(chr(_FIRST_BRAILLE + int(code)) if code else " " for code in row) for row in codes]


def pen_for(console: Console) -> Pen:
    """Return the pen whose marks the console's output can hold."""
    try:
        "⣿█│".encode(console.encoding)
    except (UnicodeEncodeError, LookupError):
        return Pen(braille=False)
    return Pen(braille=True)


def line_over_time(
    t: Array, y: Array, pen: Pen, *, width: int, height: int = 4, unit: str = "", held: bool = False
) -> list[str]:
    """Return a picture of y (N,) at times t (N,) [s] as `height` lines of at most `width` characters, and one with the times.

    `held` draws a value until the next one, otherwise straight lines connect them. Values or times that no channel can
    have are left out; without two of them there is no picture.
    """
    t, y = measurable(t), measurable(y)
    usable = np.isfinite(t) & np.isfinite(y)
    t, y = t[usable], y[usable]
    if len(t) < 2 or not t[-1] > t[0] or (np.diff(t) < 0).any():
        return []
    low, high = float(y.min()), float(y.max())
    labels = [plain(high, 4), *[""] * (height - 2), plain(low, 4)]
    labels[0] += f" {unit}" if unit else ""
    margin = max(map(cell_len, labels))
    columns = min(width - margin - 2, _WIDEST)
    if columns < 8:
        return []
    dots = _dots(t, y, pen, columns, height, held)
    bar = "│" if pen.braille else "|"
    lines = [
        f"{label:>{margin}} {bar}{row}".rstrip() for label, row in zip(labels, pen.rows(dots), strict=True)
    ]
    start, end = f"{plain(float(t[0]), 4)} s", f"{plain(float(t[-1]), 4)} s"
    lines.append(f"{'':{margin + 2}}{start}{end:>{max(columns - len(start), len(end) + 1)}}")
    return lines


def histogram(counts: NDArray[np.int64], pen: Pen) -> str:
    """Return counts (B,) as bars in a line; what is there at all has a bar, what isn't a blank."""
    most = max(int(counts.max()), 1)
    bars = pen.bars
    return "".join(bars[int((len(bars) - 1) * count / most)] if count else " " for count in counts.tolist())


def _dots(t: Array, y: Array, pen: Pen, columns: int, height: int, held: bool) -> NDArray[np.bool_]:
    """The dots that a line covers: in each column from the lowest to the highest value there."""
    down, across = pen.dots
    rows, wide = height * down, columns * across
    edges = np.linspace(t[0], t[-1], wide + 1)
    at = np.maximum(np.searchsorted(t, edges, side="right") - 1, 0)
    on_edge = y[at] if held else np.interp(edges, t, y)
    low, size = float(y.min()), float(np.ptp(y)) or 1.0
    dots = np.zeros((rows, wide), dtype=np.bool_)
    inside = np.searchsorted(t, edges)
    for k in range(wide):
        values: Sequence[float] = [on_edge[k], *y[inside[k] : inside[k + 1]]]
        if not held:
            values = [*values, on_edge[k + 1]]
        bottom, top = (
            round((rows - 1) * (float(value) - low) / size) for value in (min(values), max(values))
        )
        dots[rows - 1 - top : rows - bottom, k] = True
    return dots
