"""Tables of studies as texts: our numbers, the paper's beside them, and how far the paper's are off."""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal
from typing import Literal, TypeAlias

from servobench.core.rounding import SPACE, plain
from servobench.lab.studies.base import Cell, Column, Table

Kind: TypeAlias = Literal["word", "number", "paper", "off"]

PAPER, OFF = "paper", "off by"
_WRITTEN = 9  # digits of a number of the paper: all that it gives


@dataclass(frozen=True, kw_only=True)
class TextColumn:
    """One column as texts: the heading above it, its unit, and its kind: words, our numbers, the paper's, or how far off."""

    heading: str
    unit: str
    kind: Kind
    texts: tuple[str, ...]

    @property
    def titled(self) -> str:
        """The heading with its unit."""
        return f"{self.heading} [{self.unit}]" if self.unit else self.heading


def text_columns(table: Table) -> tuple[TextColumn, ...]:
    """Return the columns of a table, the paper's numbers in columns of their own behind ours, with the difference in per cent."""
    return tuple(each for column in table.columns for each in _column_texts(column))


def off_by(ours: Cell, paper: Cell) -> str:
    """Return by how much of our number the paper's is off, such as `+30 %`; `0 %` where it is ours, rounded as the paper has it.

    Empty where one of them is no number, or ours is 0.
    """
    if isinstance(ours, str) or isinstance(paper, str):
        return ""
    if not (math.isfinite(ours) and math.isfinite(paper)) or ours == 0:
        return ""
    if round(ours, _decimals(paper)) == paper:
        return f"0{SPACE}%"
    percent = 100 * (paper / ours - 1)
    return f"{'+' if percent > 0 else ''}{plain(percent, 2)}{SPACE}%"


def _decimals(written: float) -> int:
    """The decimals of a number as it was written: 2 of 7.96, 0 of 50, 6 of 4e-6."""
    exponent = Decimal(repr(written)).normalize().as_tuple().exponent
    return max(-exponent, 0) if isinstance(exponent, int) else 0


def cell_text(cell: Cell, digits: int) -> str:
    """Return a cell as a text; empty for NaN, which is no number."""
    if isinstance(cell, str):
        return cell
    return "" if math.isnan(cell) else plain(cell, digits)


def _column_texts(column: Column) -> list[TextColumn]:
    words = all(isinstance(value, str) for value in column.values)
    ours = TextColumn(
        heading=column.heading,
        unit=column.unit,
        kind="word" if words else "number",
        texts=tuple(cell_text(value, column.digits) for value in column.values),
    )
    if not column.paper:
        return [ours]
    columns = [
        ours,
        TextColumn(
            heading=PAPER,
            unit="",
            kind="word" if words else "paper",
            texts=tuple(cell_text(value, _WRITTEN) for value in column.paper),
        ),
    ]
    if not words:
        texts = tuple(off_by(a, b) for a, b in zip(column.values, column.paper, strict=True))
        columns.append(TextColumn(heading=OFF, unit="", kind="off", texts=texts))
    return columns
