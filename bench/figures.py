"""The output of a bench: figures, each with its limit."""

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One thing that was measured: its typical value and the range in which half of all measurements lie, in `unit`.

    `at_most` and `at_least` are limits that are promised, None where nothing is. `goal` is what is aimed at beyond a promise.
    """

    what: str
    value: float
    half: tuple[float, float] | None = None
    unit: str = ""
    at_most: float | None = None
    at_least: float | None = None
    goal: str = ""

    @property
    def is_kept(self) -> bool:
        """Whether the value is within its limits; NaN never is."""
        above = self.at_least is None or self.value >= self.at_least
        below = self.at_most is None or self.value <= self.at_most
        return above and below

    @property
    def limit(self) -> str:
        """The limits in words."""
        limits = [
            f"{word} {limit:g}"
            for word, limit in (("at least", self.at_least), ("at most", self.at_most))
            if limit is not None
        ]
        return ", ".join([*limits, *([f"goal {self.goal}"] if self.goal else [])])


HEADINGS = ("what", "value", "half of all", "unit", "limit", "")


def table(figures: Iterable[Figure]) -> str:
    """Return figures as a table of plain text."""
    rows = [HEADINGS, *(_row(figure) for figure in figures)]
    widths = [max(len(row[k]) for row in rows) for k in range(len(HEADINGS))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in rows]
    return "\n".join(line.rstrip() for line in lines)


def shown(figures: Iterable[Figure]) -> int:
    """Print figures as a table, and return the exit status: 1 where a limit isn't kept."""
    figures = list(figures)
    print(table(figures))
    return 0 if all(figure.is_kept for figure in figures) else 1


def _row(figure: Figure) -> tuple[str, ...]:
    half = "" if figure.half is None else f"{figure.half[0]:.4g} to {figure.half[1]:.4g}"
    kept = "" if figure.is_kept else "NOT KEPT"
    return (figure.what, f"{figure.value:.4g}", half, figure.unit, figure.limit, kept)
