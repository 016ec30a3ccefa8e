"""`servobench lab list`: the exercises in their order."""

from __future__ import annotations

from typing import TYPE_CHECKING

from servobench.cli.lab.options import Folder
from servobench.cli.options import AsJson

if TYPE_CHECKING:
    from servobench.lab.exercise import Exercise


def list_exercises(folder: Folder = None, as_json: AsJson = False) -> None:
    """List the exercises in their order.

    An exercise is a Markdown file: docs/how-to/exercise.md says how to write one.
    """
    from servobench.cli.catalogue import Member, list_members
    from servobench.cli.lab.exercises import exercise_folder
    from servobench.cli.layout import show_table
    from servobench.cli.terminal import output
    from servobench.core.errors import ServobenchError, UsageError
    from servobench.lab.exercise_file import exercise, names

    where = exercise_folder(folder)
    exercises: list[Exercise] = []
    mistakes: list[str] = []
    for name in names(where):
        try:
            exercises.append(exercise(name, where))
        except ServobenchError as error:  # one file with a mistake doesn't hide the others
            mistakes.append(str(error))
    if not exercises and not mistakes:
        raise UsageError(f"there are no exercises in {where}; expected files NAME.md")
    exercises.sort(key=lambda each: (each.order, each.name))
    if as_json:
        members = [Member(name=each.name, sentence=_subject(each)) for each in exercises]
        list_members("exercise", members, None, as_json)
    else:
        show_table(
            output(), ("name", "what it is about"), [(each.name, _subject(each)) for each in exercises]
        )
    if mistakes:
        raise UsageError("\n".join(mistakes))


def _subject(exercise: Exercise) -> str:
    """Its title, and what it is about, as two sentences."""
    from servobench.lab.formula import line_text

    title = line_text(exercise.title)
    return f"{title}{'' if title.endswith(('.', '?', '!')) else '.'} {line_text(exercise.sentence)}".rstrip()
