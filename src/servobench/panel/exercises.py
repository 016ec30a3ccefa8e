"""The exercises next to the scopes: the answers of the routes `/api/exercises...`.

Requests are authorised before they get here; nothing here knows of sessions. The exercises are those that come along, or
those in the folder that the application's state names as `exercises`.
"""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

from pydantic import TypeAdapter
from starlette.requests import Request
from starlette.responses import JSONResponse

from servobench.core.errors import ServobenchError, UnknownName, UsageError
from servobench.lab.check import check
from servobench.lab.exercise import Exercise
from servobench.lab.exercise_file import FOLDER, exercise, names
from servobench.lab.expression import Expression, Fact
from servobench.lab.formula import line_text
from servobench.lab.markdown import to_html
from servobench.panel.work import Work, error_called
from servobench.rig.experiment.experiment import AnyController, Experiment
from servobench.systems.signals.base import AnySignal

_LARGEST_BODY = 64 * 1024  # bytes; answers are a few dozen short texts
_NOT_FOUND, _WRONG, _TOO_LARGE = 404, 400, 413
# By exercise: a file that was changed is another one.
_results: WeakKeyDictionary[Exercise, Mapping[str, Any]] = WeakKeyDictionary()
_facts: WeakKeyDictionary[Exercise, _Facts] = WeakKeyDictionary()


async def list_exercises(request: Request) -> JSONResponse:
    """Answer GET /api/exercises: name, title and sentence of each exercise, in their order; `error` for a file with a mistake."""
    return JSONResponse(await asyncio.to_thread(_list_exercises, _folder(request)))


async def show_exercise(request: Request) -> JSONResponse:
    """Answer GET /api/exercises/{name}: title, text, blanks without their answers, and the experiment.

    The text is in pieces: HTML of ours, or the name of a study that stands there.
    """
    exercise = await _find_exercise(request)
    return (
        exercise
        if isinstance(exercise, JSONResponse)
        else JSONResponse(await asyncio.to_thread(_page_data, exercise))
    )


async def show_results(request: Request, work: Work) -> JSONResponse:
    """Answer GET /api/exercises/{name}/results: what its studies find on the simulated motor, and what it corrects.

    They are carried out once, by `work`, as that takes seconds.
    """
    exercise = await _find_exercise(request)
    if isinstance(exercise, JSONResponse):
        return exercise
    if exercise not in _results:
        order = {"do": "exercise", "name": exercise.name, "folder": str(_folder(request))}
        try:
            _results[exercise] = await work(order)
        except ServobenchError as error:
            return _error(_error_text(error, _folder(request)), _WRONG)
    return JSONResponse(_results[exercise])


async def check_exercise(request: Request, work: Work) -> JSONResponse:
    """Answer POST /api/exercises/{name}/check, with {"answers": {id: text}}: whether each is right, and a sentence.

    Answers are compared with the exercise's experiment on the simulated motor. What has to be known for them is found once, by
    `work`, as that takes seconds.
    """
    exercise = await _find_exercise(request)
    if isinstance(exercise, JSONResponse):
        return exercise
    body = await _body(request)
    if body is None:
        return _error(f"the answers have more than {_LARGEST_BODY} bytes; send less", _TOO_LARGE)
    try:
        answers = _answers(body)
        facts = await _facts_for(exercise, answers, _folder(request), work)
        checked = await asyncio.to_thread(_check_answers, exercise, answers, facts)
    except ServobenchError as error:
        return _error(_error_text(error, _folder(request)), _WRONG)
    return JSONResponse({"answers": checked})


class _Facts(Mapping[str, Fact]):
    """The facts found so far for an exercise's answers; raises the error that keeps one from being found."""

    def __init__(self) -> None:
        self._found: dict[str, Fact] = {}
        self._untold: dict[str, tuple[str, str]] = {}
        self._known: tuple[str, ...] = ()
        self._asked: set[str] = set()

    def lacks(self, names: Iterable[str]) -> list[str] | None:
        """Return which of some names haven't been asked for yet; None if all have."""
        missing = sorted(set(names) - self._asked)
        return missing if missing or not self._known else None

    def add(self, names: Iterable[str], answer: Mapping[str, Any]) -> None:
        """Take what the piece of work `facts` has found of some names."""
        self._asked.update(names)
        self._found.update(
            {name: Fact(value=value, half=half) for name, (value, half) in answer["found"].items()}
        )
        self._untold.update({name: (kind, said) for name, (kind, said) in answer["untold"].items()})
        self._known = tuple(answer["known"])

    def __getitem__(self, name: str) -> Fact:
        if name in self._untold:
            raise error_called(*self._untold[name])
        return self._found[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)


async def _facts_for(exercise: Exercise, answers: Mapping[str, str], folder: Path, work: Work) -> _Facts:
    """The facts that some answers are checked against; those not yet asked for are found elsewhere."""
    facts = _facts.setdefault(exercise, _Facts())
    rules = [
        rule
        for blank in map(exercise.blank, answers)
        for rule in (blank.answer, *(mistake.answer for mistake in blank.mistakes))
    ]
    names = {name for rule in rules for name in Expression(rule).names}
    missing = facts.lacks(names)
    if missing is not None:
        order = {"do": "facts", "name": exercise.name, "folder": str(folder), "names": missing}
        facts.add(missing, await work(order))
    return facts


async def _find_exercise(request: Request) -> Exercise | JSONResponse:
    """The exercise that a request names, or the answer that says why there is none."""
    try:
        return await asyncio.to_thread(exercise, request.path_params["name"], _folder(request))
    except UnknownName as error:
        return _error(str(error), _NOT_FOUND)
    except ServobenchError as error:
        return _error(_error_text(error, _folder(request)), _WRONG)


def _folder(request: Request) -> Path:
    """The folder of the exercises: a lecturer's own, where the application's state has one as `exercises`."""
    return Path(getattr(request.app.state, "exercises", FOLDER))


def _error_text(error: ServobenchError, folder: Path) -> str:
    """The error message with names of files only, as their folders don't belong in a browser."""
    return str(error).replace(f"{folder}{os.sep}", "")


def _list_exercises(folder: Path) -> list[dict[str, str]]:
    exercises: list[Exercise] = []
    broken: list[dict[str, str]] = []
    for name in names(folder):
        try:
            exercises.append(exercise(name, folder))
        except ServobenchError as error:  # one file with a mistake doesn't take the others away
            broken.append({"name": name, "title": name, "sentence": "", "error": _error_text(error, folder)})
    exercises.sort(key=lambda each: (each.order, each.name))
    entries = (
        {"name": e.name, "title": line_text(e.title), "sentence": line_text(e.sentence)} for e in exercises
    )
    return [*entries, *broken]


def _page_data(exercise: Exercise) -> dict[str, Any]:
    return {
        "name": exercise.name,
        "title": line_text(exercise.title),
        "pieces": [
            {"study": piece.study} if piece.study else {"html": to_html(piece.text)}
            for piece in exercise.pieces
        ],
        "blanks": [{"id": b.id, "label": line_text(b.label), "unit": b.unit} for b in exercise.blanks],
        "experiment": _settable(exercise.experiment),
    }


def _check_answers(
    exercise: Exercise, answers: dict[str, str], facts: Mapping[str, Fact]
) -> dict[str, dict[str, Any]]:
    checked = check(exercise, answers, facts)
    return {
        name: {"right": each.right, "sentence": line_text(each.sentence)} for name, each in checked.items()
    }


async def _body(request: Request) -> bytes | None:
    """The body, None where it is too large: what is more isn't read."""
    body = bytearray()
    async for piece in request.stream():
        body += piece
        if len(body) > _LARGEST_BODY:
            return None
    return bytes(body)


def _answers(body: bytes) -> dict[str, str]:
    """The answers in a body; raises `UsageError` for anything else."""
    expected = 'expected {"answers": {"id of a blank": "text"}}'
    try:
        content = json.loads(body)
    except (ValueError, RecursionError):
        raise UsageError(f"the body isn't JSON; {expected}") from None
    answers = content.get("answers") if isinstance(content, dict) else None
    if not isinstance(answers, dict) or not all(isinstance(text, str) for text in answers.values()):
        raise UsageError(f"the body has no answers; {expected}")
    return answers


def _settable(experiment: Experiment) -> dict[str, Any]:
    """The settings with which a page shows this experiment."""
    return {
        "signal": TypeAdapter(AnySignal).dump_python(experiment.signal, mode="json"),
        "controller": TypeAdapter(AnyController).dump_python(experiment.controller, mode="json"),
        "chain": experiment.chain,
        "duration": experiment.duration,
        "sample_time": experiment.sample_time,
    }


def _error(sentence: str, status: int) -> JSONResponse:
    return JSONResponse({"error": sentence}, status_code=status)
