"""Rows that come in blocks, kept by column: where one array for each channel is wanted in the end, none is copied twice."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array

MOST_EXPECTED = 1 << 22  # rows: 32 MB a column; what is requested beyond may never come


class RowStore:
    """Keeps rows of so many columns. There is room for `expected` rows, which take no memory yet; for more it is made anew."""

    def __init__(self, columns: int, expected: int = 0) -> None:
        self._columns = [np.empty(min(expected, MOST_EXPECTED)) for _ in range(columns)]
        self._filled = 0

    def __len__(self) -> int:
        return self._filled

    def append(self, rows: Array) -> None:
        """Keep rows (N, C)."""
        end = self._filled + len(rows)
        if end > len(self._columns[0]):
            self._columns = [self._larger(column, max(end, 2 * self._filled)) for column in self._columns]
        for k, column in enumerate(self._columns):
            column[self._filled : end] = rows[:, k]
        self._filled = end

    @property
    def columns(self) -> tuple[Array, ...]:
        """The rows so far, an array (N,) for each column; later rows don't change it."""
        return tuple(column[: self._filled] for column in self._columns)

    def _larger(self, column: Array, size: int) -> Array:
        larger = np.empty(size)
        larger[: self._filled] = column[: self._filled]
        return larger
