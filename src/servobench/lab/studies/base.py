"""The kind `studies`: a calculation or a series of runs that an exercise shows as tables and figures, the paper's numbers beside.

An exercise asks for one in its front matter, as `[studies.sweep]` with `type = "cutoff_sweep"` and its settings, and says where
it stands in the text by a line `{{ sweep }}`. What comes out are facts for the rules of blanks, too: `sweep_lag_3` is the third
row of the column `lag`.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Protocol, TypeAlias, runtime_checkable

from servobench.core.errors import UnknownName, UsageError
from servobench.core.registry import Registry
from servobench.core.settings import MemberOf, Settings
from servobench.lab.expression import Fact

if TYPE_CHECKING:
    from servobench.recordings.recording import Recording
    from servobench.report.illustrations import Illustration
    from servobench.rig.experiment import Experiment

Cell: TypeAlias = float | str
"""A number in its column's unit, or a word; NaN where there is none."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column of a table: `name` is what facts and the paper's numbers are called by, `unit` what the numbers are in.

    `paper` has the paper's numbers beside ours, NaN where it gives none; empty where it says nothing of the column. `digits` is
    how many significant digits are shown.
    """

    name: str
    heading: str
    """Its heading."""
    values: tuple[Cell, ...]
    """Numbers or words, a cell for each row."""
    unit: str = ""
    digits: int = 4
    paper: tuple[Cell, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Table:
    """Numbers side by side: all columns are equally long. `note` is a sentence or two below it.

    Raises `UsageError` where the columns aren't.
    """

    title: str
    """Its heading."""
    columns: tuple[Column, ...]
    note: str = ""

    def __post_init__(self) -> None:
        if len({len(column.values) for column in self.columns}) > 1:
            lengths = {column.name: len(column.values) for column in self.columns}
            raise UsageError(f"the table {self.title!r} has columns of different lengths: {lengths}")


@dataclass(frozen=True, kw_only=True, eq=False)
class StudyResult:
    """A study's result: tables, figures, sentences of what it means, and facts that stand in no table."""

    tables: tuple[Table, ...] = ()
    figures: tuple[Illustration, ...] = ()
    sentences: tuple[str, ...] = ()
    facts: Mapping[str, Fact] = field(default_factory=dict)


class Stand(Protocol):
    """A study's means: the exercise's experiment, the facts on it, and the motor to run others on."""

    @property
    def experiment(self) -> Experiment:
        """The exercise's own experiment."""
        ...

    @property
    def facts(self) -> Mapping[str, Fact]:
        """The facts of data sheet, device, recording and studies, each computed on first use."""
        ...

    @property
    def recording(self) -> Recording:
        """The recording of the exercise's experiment; it is made on first use."""
        ...

    def run(self, experiment: Experiment) -> Recording:
        """Carry out another experiment on the same motor, and return what happened."""
        ...


@runtime_checkable
class Study(Protocol):
    """Something to compute or to run, with its settings; members are `StudySettings`."""

    @property
    def paper(self) -> Mapping[str, tuple[Cell, ...]]:
        """The paper's numbers by the names of columns."""
        ...

    def __call__(self, stand: Stand) -> StudyResult:
        """Return what is found; raises `UsageError` where the exercise's experiment or motor doesn't fit the study."""
        ...


class StudySettings(Settings):
    """The settings that all studies have."""

    paper: Mapping[str, tuple[float | str, ...]] = {}
    """The paper's numbers by the names of columns, in their units; "" where it gives none."""


STUDIES: Registry[type[Study]] = Registry("study", "servobench.lab.studies")

AnyStudy: TypeAlias = Annotated[Study, MemberOf(STUDIES)]
"""A field that holds a study: any member of the kind, or a table with its name as `type`."""


def carry_out(study: Study, stand: Stand) -> StudyResult:
    """Return what a study finds, with the paper's numbers in the columns that they belong to.

    Raises `UnknownName` for numbers of the paper whose column isn't there, and `UsageError` where they are too many or too few.
    """
    shown = study(stand)
    known = [column.name for table in shown.tables for column in table.columns]
    for name in study.paper:
        if name not in known:
            raise UnknownName("column", name, known)
    tables = tuple(
        replace(table, columns=tuple(_beside(column, study.paper) for column in table.columns))
        for table in shown.tables
    )
    return replace(shown, tables=tables)


def facts_in(name: str, shown: StudyResult) -> dict[str, Fact]:
    """Return the facts of a study: its own as `name_fact`, the numbers of its tables as `name_column_row`, counted from 1."""
    facts = {f"{name}_{key}": fact for key, fact in shown.facts.items()}
    for table in shown.tables:
        for column in table.columns:
            facts.update(_cells(f"{name}_{column.name}", column.values))
    return facts


def _cells(name: str, values: Iterable[Cell]) -> dict[str, Fact]:
    numbers = ((row, value) for row, value in enumerate(values, start=1) if not isinstance(value, str))
    return {f"{name}_{row}": Fact(value=float(value)) for row, value in numbers}


def _beside(column: Column, paper: Mapping[str, tuple[Cell, ...]]) -> Column:
    numbers = paper.get(column.name)
    if numbers is None:
        return column
    if len(numbers) != len(column.values):
        raise UsageError(
            f"the paper's numbers for {column.name!r} are {len(numbers)}, but the table has {len(column.values)} rows; "
            'give one for each, "" where the paper has none'
        )
    return replace(column, paper=tuple(numbers))
