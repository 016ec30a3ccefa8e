"""The Routh table: how many roots of a polynomial are in the right half-plane, without computing one.

From the rows of every other coefficient each further row is  c = (b₁ a₂ - a₁ b₂)/b₁  of the two above it. The sign changes down
the first column are the roots to the right (Routh 1877). Two rows end that arithmetic early:

- zeros all along: the row above is an *auxiliary polynomial*, whose roots lie symmetrically about zero, as those on the imaginary
  axis do; its derivative takes the row's place.
- a zero in front of something else: the polynomial is multiplied by s + a, or a power of it, which adds roots on the left and no
  other. (Textbooks put a small ε there instead; with roots on the axis that may count wrongly.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

from servobench.core.errors import UsageError

_ROUNDING = Fraction(
    1, 2**50
)  # relative; the difference of coefficients that are equal except for their last digits
_FACTORS = tuple((a, power) for power in range(1, 5) for a in range(1, 6))  # (s + a)^power, tried in turn


@dataclass(frozen=True, kw_only=True)
class RouthRow:
    """One row: the power of s that it begins with, its elements, and a `note` of what was done to it (empty for most)."""

    power: int
    elements: tuple[float, ...]
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class RouthTable:
    """The rows from the highest power down, the number of roots to the `right` of the imaginary axis and `on_axis`.

    `factor` is (a, p) where the polynomial was multiplied by (s + a)^p, None where that wasn't needed.
    """

    rows: tuple[RouthRow, ...]
    right: int
    on_axis: int
    factor: tuple[int, int] | None = None

    @property
    def stable(self) -> bool:
        """Whether all roots are in the left half-plane."""
        return self.right == 0 and self.on_axis == 0


class _ZeroInFront(Exception):
    """A row begins with a zero and goes on with something else."""


def routh(polynomial: Sequence[float]) -> RouthTable:
    """Return the Routh table of a polynomial, highest power first.

    The arithmetic is exact, in fractions of the coefficients as they are written; what remains within their rounding is zero.
    Raises `UsageError` for a polynomial without a leading coefficient or that isn't finite, and for a constant.
    """
    try:
        exact = [Fraction(repr(float(value))) for value in polynomial]
    except (ValueError, OverflowError):
        raise UsageError(f"no Routh table: {tuple(polynomial)}; expected finite coefficients") from None
    if len(exact) < 2 or exact[0] == 0:
        raise UsageError(
            f"no Routh table: {tuple(polynomial)}; expected two coefficients at least, highest power first, the first not zero"
        )
    try:
        return _table(exact, None)
    except _ZeroInFront:
        pass
    for a, power in _FACTORS:
        multiplied = exact
        for _ in range(power):
            multiplied = [
                x + a * y for x, y in zip([*multiplied, Fraction(0)], [Fraction(0), *multiplied], strict=True)
            ]
        try:
            return _table(multiplied, (a, power))
        except _ZeroInFront:
            continue
    raise UsageError(
        f"no Routh table: {tuple(polynomial)} has a zero in front of a row whichever (s + a)^p it is multiplied by; count the "
        "poles with stability() instead"
    )


def _table(coefficients: list[Fraction], factor: tuple[int, int] | None) -> RouthTable:
    order = len(coefficients) - 1
    rows = [coefficients[::2], [*coefficients[1::2]]]
    notes = ["", ""]
    auxiliary: int | None = None  # the row that the first auxiliary polynomial stands in
    for n in range(1, order + 1):
        if n > 1:
            rows.append(_next(rows[n - 2], rows[n - 1]))
            notes.append("")
        rows[n] = [*rows[n], *[Fraction(0)] * (len(rows[n - 1]) - len(rows[n]))]
        if not any(rows[n]):
            auxiliary = n - 1 if auxiliary is None else auxiliary
            power = order - n + 1
            rows[n] = [(power - 2 * k) * value for k, value in enumerate(rows[n - 1])]
            notes[n] = f"all zero; replaced by the derivative of the row of s^{power}"
        elif rows[n][0] == 0:
            raise _ZeroInFront
    signs = [row[0] > 0 for row in rows]
    right = sum(one != two for one, two in pairwise(signs))
    on_axis = 0
    if auxiliary is not None:
        # Its roots are symmetric about zero: as many to the left as to the right, and the rest is on the axis.
        below = sum(one != two for one, two in pairwise(signs[auxiliary:]))
        on_axis = order - auxiliary - 2 * below
    width = [(order - n) // 2 + 1 for n in range(order + 1)]
    return RouthTable(
        rows=tuple(
            RouthRow(power=order - n, elements=tuple(float(x) for x in row[: width[n]]), note=note)
            for n, (row, note) in enumerate(zip(rows, notes, strict=True))
        ),
        right=right,
        on_axis=on_axis,
        factor=factor,
    )


def _next(above: list[Fraction], row: list[Fraction]) -> list[Fraction]:
    """The row below two others; a difference that is nothing but rounding is zero."""
    entries = []
    for k in range(len(above) - 1):
        right = row[k + 1] if k + 1 < len(row) else Fraction(0)
        one, two = row[0] * above[k + 1], above[0] * right
        left = one - two
        entries.append(Fraction(0) if abs(left) <= _ROUNDING * (abs(one) + abs(two)) else left / row[0])
    return entries
