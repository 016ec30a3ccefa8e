"""Reading an exercise: its Markdown file is checked whole, and every mistake is named with its line."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from difflib import get_close_matches
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, StringConstraints, ValidationError

from servobench.core.errors import FormatError, UnknownName, UsageError
from servobench.core.settings import Settings
from servobench.lab.exercise import STANDS, Blank, Correction, Exercise, pieces_of
from servobench.lab.markdown import check_formulas
from servobench.lab.paper_items import PaperItem
from servobench.lab.rules import check_blanks, check_rules
from servobench.lab.studies.base import AnyStudy, Study
from servobench.recordings.measurement.base import Chain
from servobench.rig.experiment import Experiment
from servobench.rig.experiment.lines import Path as KeyPath
from servobench.rig.experiment.lines import line_of, lines_of_keys
from servobench.rig.experiment.reading import TABLES, experiment_of, explain, parse
from servobench.rig.motor.parameters import data_sheet

_FENCE = "+++"


_LONGEST = 600.0  # seconds of an experiment that is run to check an answer


_WORDS_OF_FACTS = (
    "chain", "coulomb", "counter", "counts", "dead", "drag", "electrical", "gravity", "load", "loop", "offset", "read",
    "sample", "sheet", "stribeck", "time", "viscous", "voltage",
)  # fmt: skip
"""First parts of the names of facts, such as `time_constant`; a study with such a name would hide them."""


_OWN = ("title", "sentence", "order", "blanks", "studies", "corrections", "paper")


_NEEDED = {
    "title": 'expected title = "..." before the first table',
    "blanks": "expected a table [[blanks]] for each thing to fill in",
}
"""The keys that every exercise needs, and how they are written."""


FOLDER = Path(__file__).parent / "exercises"


def _name_of_a_study(text: str) -> str:
    if not re.fullmatch("[a-z][a-z0-9]*", text):
        raise ValueError(
            f"{text!r} isn't the name of a study; expected a small letter, then small letters and digits"
        )
    return text


class _Front(Settings):
    """The head of an exercise's file, without the experiment."""

    title: Annotated[str, StringConstraints(strip_whitespace=True, min_length=1)]
    sentence: str = ""
    order: int = 0
    blanks: Annotated[tuple[Blank, ...], Field(min_length=1)]
    studies: Mapping[Annotated[str, AfterValidator(_name_of_a_study)], AnyStudy] = {}
    corrections: tuple[Correction, ...] = ()
    paper: tuple[PaperItem, ...] = ()


def names(folder: Path = FOLDER) -> tuple[str, ...]:
    """Return the names of the exercises in a folder, sorted; their files need not be right."""
    return tuple(sorted(path.stem for path in folder.glob("*.md")))


def exercises(folder: Path = FOLDER) -> tuple[Exercise, ...]:
    """Return the exercises in a folder, in their order; raises `UsageError`s as `load_exercise` does."""
    exercise_list = [exercise(name, folder) for name in names(folder)]
    return tuple(sorted(exercise_list, key=lambda exercise: (exercise.order, exercise.name)))


def exercise(name: str, folder: Path = FOLDER) -> Exercise:
    """Return the exercise of that name in a folder; raises `UnknownName`, which lists those that are there."""
    known = names(folder)
    if name not in known:  # a name is never made into a path, so that none leads out of the folder
        raise UnknownName("exercise", name, known)
    path = folder / f"{name}.md"
    return _load(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=64)
def _load(path: Path, changed: int) -> Exercise:
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
        raise FormatError(f"{path}:{line}: this isn't UTF-8; save the file as UTF-8") from None
    return read_exercise(text, path.stem, str(path))


def read_exercise(text: str, name: str, source: str) -> Exercise:
    """Return the exercise that a text describes; `source` stands for the file in messages.

    Raises `FormatError` where it doesn't begin with TOML between two lines of `+++`, and `ExperimentError` with a line for each
    mistake in it.
    """
    front, body, first = _divide(text, source)
    tables = parse(front, source)
    lines = lines_of_keys(front)
    _check_keys(tables, lines, source)
    own = {key: tables.pop(key) for key in _OWN if key in tables}
    matter = _front(own, front, source)
    _check_studies(matter.studies, body, first, lines, source)
    check_formulas(body, first, source)
    _check_paper(matter.paper, body, lines, source)
    experiment = experiment_of(tables, front, source)
    _check_named(experiment, lines, source)
    if experiment.duration is None or experiment.duration > _LONGEST:
        raise FormatError(
            f"{source}:{line_of(('experiment', 'duration'), lines) or 1}: the experiment must end within {_LONGEST:g} s, as "
            'answers are checked by running it; expected a duration such as "10 s"'
        )
    exercise = Exercise(
        name=name,
        title=matter.title,
        sentence=matter.sentence,
        order=matter.order,
        text=body,
        experiment=experiment,
        blanks=matter.blanks,
        studies=matter.studies,
        corrections=matter.corrections,
        paper=matter.paper,
        source=source,
        lines=tuple(line_of(("blanks", number), lines) or 1 for number in range(len(matter.blanks))),
        study_lines={study: line_of(("studies", study), lines) or 1 for study in matter.studies},
        correction_lines=tuple(
            line_of(("corrections", number), lines) or 1 for number in range(len(matter.corrections))
        ),
    )
    check_blanks(exercise)
    check_rules(exercise)
    return exercise


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


def _check_studies(
    studies: Mapping[str, Study], body: str, first: int, lines: Mapping[KeyPath, int], source: str
) -> None:
    """Raise errors with file and line for studies with a name that hides facts, and for places of studies that can't be."""
    for name in studies:
        if name in _WORDS_OF_FACTS:
            raise FormatError(
                f"{source}:{line_of(('studies', name), lines) or 1}: a study can't be called {name!r}, as fact names "
                "start like that; expected another name"
            )
    lines_by_study: dict[str, int] = {}
    for number, line in enumerate(body.splitlines(), start=first):
        for stands in STANDS.finditer(line):
            name, place = stands[1], f"{source}:{number}"
            if stands[0] != line.strip():
                raise FormatError(
                    f"{place}: `{stands[0]}` marks the place of a study; expected it on a line of its own"
                )
            if name not in studies:
                known = f"{UnknownName('study', name, studies)}" if studies else "there are no studies"
                raise FormatError(f"{place}: {known}; add a table [studies.{name or 'NAME'}]")
            if name in lines_by_study:
                raise FormatError(
                    f"{place}: the study {name!r} stands in line {lines_by_study[name]} already; leave one of them out"
                )
            lines_by_study[name] = number
        if "{{" in STANDS.sub("", line):
            raise FormatError(
                f"{source}:{number}: `{line.strip()[:40]}` starts with {{{{ and doesn't end; expected {{{{ NAME }}}} "
                "with the name of a study"
            )


def _check_paper(items: Sequence[PaperItem], body: str, lines: Mapping[KeyPath, int], source: str) -> None:
    """Raise `FormatError` with file and line for what is said to be shown by a study that stands nowhere."""
    stand = [piece.study for piece in pieces_of(body) if piece.study]
    for number, each in enumerate(items):
        if each.study and each.study not in stand:
            place = f"{source}:{line_of(('paper', number, 'study'), lines) or 1}"
            raise FormatError(f"{place}: {UnknownName('study in the text', each.study, stand)}")


def _divide(text: str, source: str) -> tuple[str, str, int]:
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
