"""The study `routh_table`: the Routh table of a loop at several gains, the limits of the gain, and the root locus."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from servobench.core.errors import UsageError
from servobench.core.rounding import plain
from servobench.lab.expression import Expression, Fact
from servobench.lab.studies.base import STUDIES, Column, Stand, StudyResult, StudySettings, Table
from servobench.report import stability_figures
from servobench.report.illustrations import Illustration
from servobench.systems.stability.locus import RootLocus, root_locus
from servobench.systems.stability.routh import RouthTable, routh
from servobench.systems.transfer_function import TransferFunction

Coefficient = Annotated[str, Field(min_length=1)]


@STUDIES.member("routh_table")
class RouthTables(StudySettings):
    """The Routh table of D(s) + k N(s) for gains k, the range of stable gains, and where the poles go as k grows."""

    numerator: Annotated[tuple[Coefficient, ...], Field(min_length=1)]
    """N, highest power first, each an expression over facts."""
    denominator: Annotated[tuple[Coefficient, ...], Field(min_length=2)]
    """D, highest power first, each an expression over facts."""
    gains: Annotated[tuple[float, ...], Field(min_length=1)]
    """The gains to make a table for."""

    @model_validator(mode="after")
    def _can_be_computed(self) -> Self:
        for text in (*self.numerator, *self.denominator):
            Expression(text)
        return self

    def __call__(self, stand: Stand) -> StudyResult:
        """Return a table for each gain, one of all gains, and the root locus; raises `UsageError` for a loop without one."""
        n, d = (
            tuple(Expression(text).evaluate(stand.facts).value for text in texts)
            for texts in (self.numerator, self.denominator)
        )
        loop = TransferFunction(numerator=n, denominator=d, output="position", unit="1")
        locus = root_locus(loop)
        closed = [tuple(map(float, np.polyadd(d, k * np.asarray(n)))) for k in self.gains]
        tables = [routh(polynomial) for polynomial in closed]
        marks = [np.roots(polynomial) for polynomial in closed]
        rightmost = tuple(float(roots.real.max()) for roots in marks)
        summary = (
            Column(name="gain", heading="gain k", values=self.gains),
            Column(name="right", heading="roots to the right", values=tuple(float(t.right) for t in tables)),
            Column(name="axis", heading="on the axis", values=tuple(float(t.on_axis) for t in tables)),
            Column(
                name="rightmost", heading="rightmost root, by computing them", unit="1/s", values=rightmost
            ),
            Column(name="verdict", heading="closed loop", values=tuple(map(_verdict, tables))),
        )
        limit = _limit(locus)
        return StudyResult(
            tables=(
                *(_table(k, table) for k, table in zip(self.gains, tables, strict=True)),
                Table(title="Gains and roots", columns=summary),
            ),
            figures=(_figure(locus, loop, np.concatenate(marks)),),
            sentences=(_locus_text(locus),),
            facts={"limit": Fact(value=limit)} if math.isfinite(limit) else {},
        )


def _limit(locus: RootLocus) -> float:
    """The gain at which the lowest range of stable gains ends; NaN where there is none."""
    return locus.stable[0][1] if locus.stable else math.nan


def _verdict(table: RouthTable) -> str:
    if table.right:
        return "unstable"
    return "marginally stable" if table.on_axis else "stable"


def _locus_text(locus: RootLocus) -> str:
    if not locus.stable:
        return "The loop is stable for no gain above zero."
    ranges = " and ".join(
        f"between {plain(low)} and {plain(high)}" if math.isfinite(high) else f"above {plain(low)}"
        for low, high in locus.stable
    )
    return f"The loop is stable for gains {ranges}."


def _table(k: float, table: RouthTable) -> Table:
    """The rows as columns of a table: the power of s, then the elements."""
    width = max(len(row.elements) for row in table.rows)
    name = f"k{plain(k)}".replace(".", "").replace("−", "m")
    columns = [
        Column(name=f"{name}_row", heading="row", values=tuple(f"s^{row.power}" for row in table.rows))
    ]
    for n in range(width):
        values = tuple(row.elements[n] if n < len(row.elements) else "" for row in table.rows)
        columns.append(
            Column(
                name=f"{name}_{chr(ord('a') + n)}", heading="first column" if n == 0 else "", values=values
            )
        )
    notes = [f"Row s^{row.power}: {row.note}." for row in table.rows if row.note]
    if table.factor:
        a, power = table.factor
        by = f"(s + {a})" + (f"^{power}" if power > 1 else "")
        notes.append(
            f"A row would start with a zero; the polynomial was multiplied by {by}, which adds only roots on the "
            "left."
        )
    return Table(title=f"Routh table for k = {plain(k)}", columns=tuple(columns), note=" ".join(notes))  # fmt: skip


def _figure(locus: RootLocus, loop: TransferFunction, marks: np.ndarray) -> Illustration:
    if not len(locus.poles):
        raise UsageError("routh_table: the loop has no poles")
    places = [complex(mark) for mark in marks]
    return Illustration(
        name="locus",
        title="Root locus",
        caption="Crosses are the open loop's poles, squares the closed loop's at the gains of the tables; shaded is unstable.",
        description=f"Root locus of {loop}. {_locus_text(locus)}",
        draw=partial(stability_figures.root_locus, locus.poles, [complex(z) for z in loop.zeros], places),
    )
