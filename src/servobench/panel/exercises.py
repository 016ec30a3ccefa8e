"""The exercises beside the scopes: what the routes `/api/exercises...` answer.

Whoever serves these has let the request in already; they know nothing of sessions. The exercises are those that come along, or
those in the folder that the application's state names as `exercises`.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from pydantic import TypeAdapter
from starlette.requests import Request
from starlette.responses import JSONResponse

from servobench.errors import ServobenchError, UnknownName, UsageError
from servobench.experiment.experiment import AnyController, Experiment
from servobench.lab.check import check
from servobench.lab.exercise import FOLDER, Exercise, exercise, names
from servobench.lab.facts import facts_of, facts_on_the_twin
from servobench.lab.markdown import to_html
from servobench.signals.base import AnySignal

if TYPE_CHECKING:
    from servobench.panel.work import Work
    from servobench.recording.recording import Recording

_LARGEST_BODY = 64 * 1024  # bytes; answers are a few dozen short texts
_NOT_FOUND, _WRONG, _TOO_LARGE = 404, 400, 413
_results: WeakKeyDictionary[Exercise, Mapping[str, Any]] = (
    WeakKeyDictionary()
)  # a file that was changed is another exercise


async def list_exercises(request: Request) -> JSONResponse:
    """Answer GET /api/exercises: name, title and sentence of each exercise, in their order; `error` for a file with a mistake."""
    return JSONResponse(await asyncio.to_thread(_listed, _folder(request)))


async def show_exercise(request: Request) -> JSONResponse:
    """Answer GET /api/exercises/{name}: title, text, blanks without their answers, and the experiment.

    The text is in pieces: HTML of ours, or the name of a study that stands there.
    """
    found = await _named(request)
    if isinstance(found, JSONResponse):
        return found
    return JSONResponse(
        {
            "name": found.name,
            "title": found.title,
            "pieces": [
                {"study": piece.study} if piece.study else {"html": to_html(piece.text)}
                for piece in found.pieces
            ],
            "blanks": [{"id": b.id, "label": b.label, "unit": b.unit} for b in found.blanks],
            "experiment": _settable(found.experiment),
        }
    )


async def show_results(request: Request, work: Work) -> JSONResponse:
    """Answer GET /api/exercises/{name}/results: what its studies find on the simulated motor, and what it corrects.

    They are carried out once, by `work`, as that takes seconds.
    """
    found = await _named(request)
    if isinstance(found, JSONResponse):
        return found
    if found not in _results:
        asked = {"do": "exercise", "name": found.name, "folder": str(_folder(request))}
        try:
            _results[found] = await work(asked)
        except ServobenchError as error:
            return _error(str(error), _WRONG)
    return JSONResponse(_results[found])


async def check_exercise(request: Request, recording: Recording | None = None) -> JSONResponse:
    """Answer POST /api/exercises/{name}/check, with {"answers": {id: text}}: whether each is right, and a sentence.

    `recording` is what the student measured, where they say it; otherwise answers are held against the exercise's experiment on
    the simulated motor. Checking may take seconds the first time, in a thread of its own.
    """
    found = await _named(request)
    if isinstance(found, JSONResponse):
        return found
    body = await _body(request)
    if body is None:
        return _error(f"the answers have more than {_LARGEST_BODY} bytes; send less", _TOO_LARGE)
    try:
        answers = _answers(body)
        checked = await asyncio.to_thread(_checked, found, answers, recording)
    except ServobenchError as error:
        return _error(str(error), _WRONG)
    return JSONResponse({"answers": checked})


async def _named(request: Request) -> Exercise | JSONResponse:
    """The exercise that a request names, or the answer that says why there is none."""
    try:
        return await asyncio.to_thread(exercise, request.path_params["name"], _folder(request))
    except UnknownName as error:
        return _error(str(error), _NOT_FOUND)
    except ServobenchError as error:
        return _error(str(error), _WRONG)


def _folder(request: Request) -> Path:
    """Where the exercises lie: in a lecturer's own folder, where the application's state has one as `exercises`."""
    return Path(getattr(request.app.state, "exercises", FOLDER))


def _listed(folder: Path) -> list[dict[str, str]]:
    found: list[Exercise] = []
    broken: list[dict[str, str]] = []
    for name in names(folder):
        try:
            found.append(exercise(name, folder))
        except ServobenchError as error:  # one file with a mistake doesn't take the others away
            broken.append({"name": name, "title": name, "sentence": "", "error": str(error)})
    found.sort(key=lambda each: (each.order, each.name))
    return [*({"name": e.name, "title": e.title, "sentence": e.sentence} for e in found), *broken]


def _checked(
    found: Exercise, answers: dict[str, str], recording: Recording | None
) -> dict[str, dict[str, Any]]:
    facts = facts_on_the_twin(found) if recording is None else facts_of(found, recording)
    said = check(found, answers, facts)
    return {name: {"right": each.right, "sentence": each.sentence} for name, each in said.items()}


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
        given = json.loads(body)
    except (ValueError, RecursionError):
        raise UsageError(f"the body is no JSON; {expected}") from None
    answers = given.get("answers") if isinstance(given, dict) else None
    if not isinstance(answers, dict) or not all(isinstance(text, str) for text in answers.values()):
        raise UsageError(f"the body has no answers; {expected}")
    return answers


def _settable(experiment: Experiment) -> dict[str, Any]:
    """What a page sets to have this experiment before it."""
    return {
        "signal": TypeAdapter(AnySignal).dump_python(experiment.signal, mode="json"),
        "controller": TypeAdapter(AnyController).dump_python(experiment.controller, mode="json"),
        "chain": experiment.chain,
        "duration": experiment.duration,
        "sample_time": experiment.sample_time,
    }


def _error(sentence: str, status: int) -> JSONResponse:
    return JSONResponse({"error": sentence}, status_code=status)
