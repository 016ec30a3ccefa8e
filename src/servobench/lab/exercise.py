"""An exercise: one Markdown file with what to do, the experiment to do it with, and blanks to fill in.

The file begins with TOML between two lines of `+++`: `title`, `sentence`, an experiment as in its own file (`[experiment]`,
`[signal]`, `[controller]`, `[device]`, `[limits]`), `[[blanks]]`, `[studies.NAME]` and `[[corrections]]`. The text follows, in
Markdown; a line `{{ NAME }}` in it is where the study of that name stands.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import AfterValidator, Field, StringConstraints, ValidationError, model_validator

from servobench.errors import FormatError, UnknownName, UsageError
from servobench.experiment import Experiment
from servobench.experiment.lines import Path as KeyPath
from servobench.experiment.lines import line_of, lines_of_keys
from servobench.experiment.reading import TABLES, experiment_of, explain, parsed
from servobench.lab.expression import Expression
from servobench.lab.markdown import check_formulas
from servobench.lab.paper_items import PaperItem
from servobench.lab.rules import check_blanks, check_rules
from servobench.lab.studies.base import AnyStudy, Study
from servobench.lab.tolerance import Tolerance
from servobench.measurement.base import Chain
from servobench.motor.parameters import data_sheet
from servobench.settings import Settings
from servobench.units import in_symbols
from servobench.units import unit as unit_named

_FENCE = "+++"
_LONGEST = 600.0  # seconds of an experiment that is run to check an answer
_STANDS = re.compile(r"\{\{ *([^{}]*?) *\}\}")
_WORDS_OF_FACTS = (
    "chain", "coulomb", "counter", "counts", "dead", "drag", "electrical", "gravity", "load", "loop", "offset", "read",
    "sample", "sheet", "stribeck", "time", "viscous", "voltage",
)  # fmt: skip
"""What names of facts begin with, such as `time_constant`: a study called that would hide them."""
_OWN = ("title", "sentence", "order", "blanks", "studies", "corrections", "paper")
_NEEDED = {
    "title": 'expected title = "..." before the first table',
    "blanks": "expected a table [[blanks]] for each thing to fill in",
}
"""What no exercise does without, and how it is written."""
FOLDER = Path(__file__).parent / "exercises"


def _id_of_a_blank(text: str) -> str:
    if not re.fullmatch("[a-z][a-z0-9_]*", text):
        raise ValueError(
            f"{text!r} is no name of a blank; expected a small letter, then small letters, digits and underscores"
        )
    return text


def _name_of_a_study(text: str) -> str:
    if not re.fullmatch("[a-z][a-z0-9]*", text):
        raise ValueError(
            f"{text!r} is no name of a study; expected a small letter, then small letters and digits"
        )
    return text


class Mistake(Settings):
    """A wrong answer that many give, and what is told to who gives it."""

    answer: str
    """What comes out of it: an expression over facts, as the right answer has one."""
    sentence: str
    """What went wrong, in a sentence or two."""


class Blank(Settings):
    """One thing to enter, and the rule that it is checked by."""

    id: Annotated[str, AfterValidator(_id_of_a_blank)]
    """Name of the blank: small letters, digits and underscores."""
    label: str
    """What is asked for."""
    unit: str = ""
    """Unit of the answer; an answer without one is taken to be in it."""
    answer: str
    """The right answer in that unit: an expression over facts, such as `2 * pi / counts_per_rev`; facts are in SI units."""
    tolerance: str
    """How far an answer may be off: `exact`, `interval`, `5 %`, `0.5 ms`, or a sum of the latter three."""
    hint: str = ""
    """What helps somebody whose answer is wrong."""
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
    """Where the paper errs or is silent: its figure, ours as an expression over facts and studies, and why, in two sentences."""

    where: Annotated[str, Field(min_length=1)]
    """The place in the paper, such as `eq. 7` or `II.E`."""
    paper: Annotated[str, Field(min_length=1)]
    """What the paper says."""
    ours: Annotated[str, Field(min_length=1)]
    """What is right, in words; `{}` in it stands for the value of `answer` with its unit."""
    answer: str = ""
    """The expression that gives our figure in `unit`; empty where none belongs to it."""
    unit: str = ""
    """Unit of our figure."""
    digits: Annotated[int, Field(ge=1, le=12)] = 3
    """How many significant digits are shown."""
    why: Annotated[str, Field(min_length=1)]
    """Why, in two sentences."""

    @model_validator(mode="after")
    def _shows_its_figure(self) -> Self:
        if self.answer:
            Expression(self.answer)
        if bool(self.answer) != ("{}" in self.ours):
            raise ValueError("`answer` and a `{}` in `ours` belong together; give both or none")
        return self


class _Front(Settings):
    """What an exercise's file says before its text, without the experiment."""

    title: Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
    sentence: str = ""
    order: int = 0
    blanks: Annotated[tuple[Blank, ...], Field(min_length=1)]
    studies: Mapping[Annotated[str, AfterValidator(_name_of_a_study)], AnyStudy] = {}
    corrections: tuple[Correction, ...] = ()
    paper: tuple[PaperItem, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A piece of an exercise's text: Markdown, or the name of the study that stands there."""

    text: str = ""
    study: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Exercise:
    """What to do (`text`, Markdown), the experiment to do it with, the blanks, studies and corrections.

    `lines` says in which line of the file each blank stands, `study_lines` each study and `correction_lines` each correction.
    """

    name: str
    """Name of the file, without its ending."""
    title: str
    """What stands above it."""
    sentence: str
    """What it is about, for a list."""
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
    """What of the paper it does again."""

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """The text cut where studies stand in it."""
        return tuple(_pieces(self.text))

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


def names(folder: Path = FOLDER) -> tuple[str, ...]:
    """Return the names of the exercises in a folder, sorted; their files need not be right."""
    return tuple(sorted(path.stem for path in folder.glob("*.md")))


def exercises(folder: Path = FOLDER) -> tuple[Exercise, ...]:
    """Return the exercises in a folder, in their order; raises `UsageError`s as `load_exercise` does."""
    found = [exercise(name, folder) for name in names(folder)]
    return tuple(sorted(found, key=lambda exercise: (exercise.order, exercise.name)))


def exercise(name: str, folder: Path = FOLDER) -> Exercise:
    """Return the exercise of that name in a folder; raises `UnknownName`, which lists those that are there."""
    known = names(folder)
    if name not in known:  # a name is never made into a path, so that none leads out of the folder
        raise UnknownName("exercise", name, known)
    path = folder / f"{name}.md"
    return _loaded(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=64)
def _loaded(path: Path, changed: int) -> Exercise:
    """The exercise in a file as it was when it was last changed: the same object, so that what was found for it is kept."""
    return load_exercise(path)


def load_exercise(path: Path) -> Exercise:
    """Return the exercise in a Markdown file; raises `UsageError`s with file and line for each mistake."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FormatError(f"{path}: can't be read: {error.strerror or error}") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise FormatError(f"{path}:{line}: this is no UTF-8; save the file as UTF-8") from None
    return read_exercise(text, path.stem, str(path))


def read_exercise(text: str, name: str, source: str) -> Exercise:
    """Return the exercise that a text describes; `source` stands for the file in messages.

    Raises `FormatError` where it doesn't begin with TOML between two lines of `+++`, and `ExperimentError` with a line for each
    mistake in it.
    """
    front, body, first = _divided(text, source)
    tables = parsed(front, source)
    lines = lines_of_keys(front)
    _check_keys(tables, lines, source)
    own = {key: tables.pop(key) for key in _OWN if key in tables}
    told = _front(own, front, source)
    _check_studies(told.studies, body, first, lines, source)
    check_formulas(body, first, source)
    _check_paper(told.paper, body, lines, source)
    experiment = experiment_of(tables, front, source)
    _check_named(experiment, lines, source)
    if experiment.duration is None or experiment.duration > _LONGEST:
        raise FormatError(
            f"{source}:{line_of(('experiment', 'duration'), lines) or 1}: the experiment has to end within {_LONGEST:g} s, as "
            'answers are checked by running it; expected a duration such as "10 s"'
        )
    found = Exercise(
        name=name,
        title=told.title,
        sentence=told.sentence,
        order=told.order,
        text=body,
        experiment=experiment,
        blanks=told.blanks,
        studies=told.studies,
        corrections=told.corrections,
        paper=told.paper,
        source=source,
        lines=tuple(line_of(("blanks", number), lines) or 1 for number in range(len(told.blanks))),
        study_lines={study: line_of(("studies", study), lines) or 1 for study in told.studies},
        correction_lines=tuple(
            line_of(("corrections", number), lines) or 1 for number in range(len(told.corrections))
        ),
    )
    check_blanks(found)
    check_rules(found)
    return found


def _check_keys(tables: Mapping[str, Any], lines: Mapping[KeyPath, int], source: str) -> None:
    """Raise `FormatError` for keys that an exercise hasn't, and for those that it can't do without; each on a line of its own."""
    known = (*_OWN, *TABLES)
    mistakes = []
    for key in tables:
        if key not in known:
            near = get_close_matches(key, known, n=1)
            hint = f" (did you mean {near[0]!r}?)" if near else ""
            place = f"{source}:{line_of((key,), lines) or 1}"
            mistakes.append(f"{place}: {key}: not known here{hint}; known: {', '.join(known)}")
    mistakes += [
        f"{source}:1: {key}: is missing; {expected}" for key, expected in _NEEDED.items() if key not in tables
    ]
    if mistakes:
        raise FormatError("\n".join(mistakes))


def _check_named(experiment: Experiment, lines: Mapping[KeyPath, int], source: str) -> None:
    """Raise `UsageError`, with file and line, for a chain or a data sheet that isn't known.

    A device may be one that another computer has.
    """

    def chain() -> None:
        Chain.parse(experiment.chain)

    def nominal() -> None:
        if experiment.nominal:
            data_sheet(experiment.nominal)

    checks: tuple[tuple[KeyPath, Callable[[], None]], ...] = (
        (("experiment", "chain"), chain),
        (("experiment", "nominal"), nominal),
    )
    for path, check in checks:
        try:
            check()
        except UsageError as error:
            raise UsageError(
                f"{source}:{line_of(path, lines) or 1}: {'.'.join(map(str, path))}: {error}"
            ) from None


def _pieces(text: str) -> Iterator[Piece]:
    written: list[str] = []
    for line in text.splitlines(keepends=True):
        stands = _STANDS.fullmatch(line.strip())
        if stands is None:
            written.append(line)
            continue
        if "".join(written).strip():
            yield Piece(text="".join(written))
        written = []
        yield Piece(study=stands[1])
    if "".join(written).strip():
        yield Piece(text="".join(written))


def _check_studies(
    studies: Mapping[str, Study], body: str, first: int, lines: Mapping[KeyPath, int], source: str
) -> None:
    """Raise errors with file and line for studies with a name that hides facts, and for places of studies that can't be."""
    for name in studies:
        if name in _WORDS_OF_FACTS:
            raise FormatError(
                f"{source}:{line_of(('studies', name), lines) or 1}: a study can't be called {name!r}, as names of facts begin "
                "like this; expected another name"
            )
    seen: dict[str, int] = {}
    for number, line in enumerate(body.splitlines(), start=first):
        for stands in _STANDS.finditer(line):
            name, place = stands[1], f"{source}:{number}"
            if stands[0] != line.strip():
                raise FormatError(
                    f"{place}: `{stands[0]}` is where a study stands; expected it in a line of its own"
                )
            if name not in studies:
                known = f"{UnknownName('study', name, studies)}" if studies else "there are no studies"
                raise FormatError(f"{place}: {known}; add a table [studies.{name or 'NAME'}]")
            if name in seen:
                raise FormatError(
                    f"{place}: the study {name!r} stands in line {seen[name]} already; leave one of them out"
                )
            seen[name] = number
        if "{{" in _STANDS.sub("", line):
            raise FormatError(
                f"{source}:{number}: `{line.strip()[:40]}` begins with {{{{ and doesn't end; expected {{{{ NAME }}}} with the "
                "name of a study"
            )


def _check_paper(items: Sequence[PaperItem], body: str, lines: Mapping[KeyPath, int], source: str) -> None:
    """Raise `FormatError` with file and line for what is said to be shown by a study that stands nowhere."""
    stand = [piece.study for piece in _pieces(body) if piece.study]
    for number, each in enumerate(items):
        if each.study and each.study not in stand:
            place = f"{source}:{line_of(('paper', number, 'study'), lines) or 1}"
            raise FormatError(f"{place}: {UnknownName('study in the text', each.study, stand)}")


def _divided(text: str, source: str) -> tuple[str, str, int]:
    """The TOML, with an empty line for each before it so that lines count as in the file, the Markdown, and its first line."""
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if lines[0].strip() != _FENCE:
        raise FormatError(
            f"{source}:1: expected a line `{_FENCE}`, then title, experiment and blanks as TOML, another `{_FENCE}`, and then "
            "the text"
        )
    end = _first(lines[1:])
    if end is None:
        raise FormatError(f"{source}:{len(lines)}: the TOML isn't ended; expected a second line `{_FENCE}`")
    body = "\n".join(lines[end + 2 :]).strip()
    if not body:
        raise FormatError(f"{source}:{end + 2}: there is no text; expected what to do, in Markdown")
    first = next(number for number in range(end + 2, len(lines)) if lines[number].strip())
    return "\n".join(["", *lines[1 : end + 1]]), f"{body}\n", first + 1


def _first(lines: Iterable[str]) -> int | None:
    return next((number for number, line in enumerate(lines) if line.strip() == _FENCE), None)


def _front(own: dict[str, Any], text: str, source: str) -> _Front:
    try:
        return _Front.model_validate(own)
    except (ValidationError, UsageError) as error:
        raise explain(error, text, source) from None
