"""The study `values`: numbers worked out from facts, in a table."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from servobench.core.settings import Settings
from servobench.lab.expression import Expression
from servobench.lab.studies.base import STUDIES, Cell, Column, Stand, StudyResult, StudySettings, Table


class Row(Settings):
    """One number: what it is, the expression over facts that gives it in `unit`, and the paper's number where it has one."""

    label: Annotated[str, Field(min_length=1)]
    """The number's meaning."""
    answer: str
    """The expression over facts that gives it, as a blank's answer."""
    unit: str = ""
    """The unit that the expression is in, for the reader; it isn't converted."""
    paper: float | str = ""
    """The paper's value, in the same unit."""

    @model_validator(mode="after")
    def _can_be_computed(self) -> Self:
        Expression(self.answer)
        return self


@STUDIES.member("values")
class Values(StudySettings):
    """Numbers worked out from facts: what each is, its value and its unit, with the paper's beside where it gives one."""

    title: str = "Worked out"
    """Heading of the table."""
    rows: Annotated[tuple[Row, ...], Field(min_length=1)]
    """The numbers, in their order."""
    digits: Annotated[int, Field(ge=1, le=12)] = 4
    """The number of significant digits that are shown."""

    def __call__(self, stand: Stand) -> StudyResult:
        """Return the table; raises `UnknownName` for a fact that isn't there."""
        values = tuple(Expression(row.answer).evaluate(stand.facts).value for row in self.rows)
        paper: tuple[Cell, ...] = tuple(row.paper for row in self.rows)
        columns = (
            Column(name="label", heading="", values=tuple(row.label for row in self.rows)),
            Column(
                name="value",
                heading="value",
                values=values,
                digits=self.digits,
                paper=paper if any(p != "" for p in paper) else (),
            ),
            Column(name="unit", heading="unit", values=tuple(row.unit for row in self.rows)),
        )
        return StudyResult(tables=(Table(title=self.title, columns=columns),))
