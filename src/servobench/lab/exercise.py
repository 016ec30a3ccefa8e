"""An exercise: one Markdown file with what to do, the experiment to do it with, and blanks to fill in.

The file begins with TOML between two lines of `+++`: `title`, `sentence`, an experiment as in its own file (`[experiment]`,
`[signal]`, `[controller]`, `[device]`, `[limits]`), `[[blanks]]`, `[studies.NAME]` and `[[corrections]]`. The text follows, in
Markdown; a line `{{ NAME }}` in it is where the study of that name stands.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from servobench.core.errors import UnknownName
from servobench.core.settings import Settings
from servobench.core.units import in_symbols
from servobench.core.units import unit as unit_named
from servobench.lab.expression import Expression
from servobench.lab.paper_items import PaperItem
from servobench.lab.studies.base import Study
from servobench.lab.tolerance import Tolerance
from servobench.rig.experiment import Experiment

STANDS = re.compile(r"\{\{ *([^{}]*?) *\}\}")


def _id_of_a_blank(text: str) -> str:
    if not re.fullmatch("[a-z][a-z0-9_]*", text):
        raise ValueError(
            f"{text!r} isn't the name of a blank; expected a small letter, then small letters, digits and underscores"
        )
    return text


class Mistake(Settings):
    """A common wrong answer, and its explanation for the student."""

    answer: str
    """The value that it gives: an expression over facts, like a right answer's."""
    sentence: str
    """The student's mistake, in a sentence or two."""


class Blank(Settings):
    """One thing to enter, and the rule that it is checked by."""

    id: Annotated[str, AfterValidator(_id_of_a_blank)]
    """Name of the blank: small letters, digits and underscores."""
    label: str
    """The question."""
    unit: str = ""
    """Unit of the answer; an answer without one is taken to be in it."""
    answer: str
    """The right answer in that unit: an expression over facts, such as `2 * pi / counts_per_rev`; facts are in SI units."""
    tolerance: str
    """The tolerance of an answer: `exact`, `interval`, `5 %`, `0.5 ms`, or a sum of the latter three."""
    hint: str = ""
    """Help after a wrong answer."""
    mistakes: tuple[Mistake, ...] = ()
    """Wrong answers that are known."""
    by_table: bool = False
    """Whether it can only be read off a study's table. Students who are assessed get no studies, and aren't asked it."""

    @model_validator(mode="after")
    def _can_be_checked(self) -> Self:
        if self.unit:
            unit_named(self.unit)
            if (symbols := in_symbols(self.unit)) != self.unit:
                raise ValueError(f"the unit {self.unit!r} is written as a symbol; expected {symbols!r}")
        for text in (self.answer, *(mistake.answer for mistake in self.mistakes)):
            Expression(text)
        Tolerance(self.tolerance, self.unit)
        return self


class Correction(Settings):
    """A correction of the paper: its figure, ours as an expression over facts and studies, and why, in two sentences."""

    where: Annotated[str, Field(min_length=1)]
    """The place in the paper, such as `eq. 7` or `II.E`."""
    paper: Annotated[str, Field(min_length=1)]
    """The paper's figure."""
    ours: Annotated[str, Field(min_length=1)]
    """The correct statement; `{}` in it stands for the value of `answer` with its unit."""
    answer: str = ""
    """The expression that gives our figure in `unit`; empty where none belongs to it."""
    unit: str = ""
    """Unit of our figure."""
    digits: Annotated[int, Field(ge=1, le=12)] = 3
    """The number of significant digits that are shown."""
    why: Annotated[str, Field(min_length=1)]
    """The reason, in two sentences."""

    @model_validator(mode="after")
    def _shows_its_figure(self) -> Self:
        if self.answer:
            Expression(self.answer)
        if bool(self.answer) != ("{}" in self.ours):
            raise ValueError("`answer` and a `{}` in `ours` go together; give both or none")
        return self


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A piece of an exercise's text: Markdown, or the name of the study shown there."""

    text: str = ""
    study: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Exercise:
    """An exercise: what to do (`text`, Markdown), the experiment for it, the blanks, studies and corrections.

    `lines` says in which line of the file each blank stands, `study_lines` each study and `correction_lines` each correction.
    """

    name: str
    """Name of the file, without its ending."""
    title: str
    """Its heading."""
    sentence: str
    """Its subject, for a list."""
    order: int
    """Its place in the list."""
    text: str
    experiment: Experiment
    blanks: tuple[Blank, ...]
    studies: Mapping[str, Study]
    corrections: tuple[Correction, ...]
    source: str
    """The file, for messages."""
    lines: tuple[int, ...]
    study_lines: Mapping[str, int]
    correction_lines: tuple[int, ...]
    paper: tuple[PaperItem, ...] = ()
    """The items of the paper that it repeats."""

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The text cut where studies stand in it."""
        return tuple(pieces_of(self.text))

    def blank(self, name: str) -> Blank:
        """Return the blank of that id; raises `UnknownName`."""
        for blank in self.blanks:
            if blank.id == name:
                return blank
        raise UnknownName("blank", name, [blank.id for blank in self.blanks])

    def shows(self, study: str) -> tuple[PaperItem, ...]:
        """Return what of the paper a study does again; with an empty name, the exercise's run or its text."""
        return tuple(each for each in self.paper if each.study == study)

    def place(self, blank: Blank) -> str:
        """Return where a blank stands, as messages say it: file and line."""
        return f"{self.source}:{self.lines[self.blanks.index(blank)]}"

    def place_of_study(self, name: str) -> str:
        """Return where the study of that name stands: file and line."""
        return f"{self.source}:{self.study_lines[name]}"

    def place_of_correction(self, correction: Correction) -> str:
        """Return where a correction stands: file and line."""
        return f"{self.source}:{self.correction_lines[self.corrections.index(correction)]}"


def pieces_of(text: str) -> Iterator[Piece]:
    """Cut a text where studies stand in it."""
    written: list[str] = []
    for line in text.splitlines(keepends=True):
        stands = STANDS.fullmatch(line.strip())
        if stands is None:
            written.append(line)
            continue
        if "".join(written).strip():
            yield Piece(text="".join(written))
        written = []
        yield Piece(study=stands[1])
    if "".join(written).strip():
        yield Piece(text="".join(written))
