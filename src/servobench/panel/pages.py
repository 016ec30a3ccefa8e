"""The routes of the page itself: everything but recordings and exercises."""

from __future__ import annotations

import asyncio
import json
from dataclasses import dataclass, field
from functools import cache
from html import escape
from importlib.metadata import PackageNotFoundError, files
from importlib.resources import files as resources
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import RedirectResponse, Response

from servobench._version import __version__
from servobench.core.channels import DeviceInfo
from servobench.core.errors import UsageError
from servobench.lab.exercise_file import FOLDER
from servobench.panel.bodies import LARGEST_UPLOAD, form_field, json_object
from servobench.panel.catalogue import catalogue as all_that_can_be_chosen
from servobench.panel.commands import ASSIGNED
from servobench.panel.exercises import check_exercise, list_exercises, show_exercise, show_results
from servobench.panel.gate import NO_ORIGIN, Asks, Door, Refused, page_policy
from servobench.panel.jobs import Jobs
from servobench.panel.keys import Carrier, Session
from servobench.panel.library import Library
from servobench.panel.preview import preview_signal
from servobench.panel.session import MotorSession
from servobench.panel.work import Work, do_elsewhere
from servobench.recordings.measurement.base import Chain
from servobench.rig.experiment import Experiment

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".png": "image/png",
}
UPLOT = ("uPlot.iife.js", "uPlot.min.css")


@dataclass(frozen=True, kw_only=True)
class Panel:
    """The parts that routes use: the motor, the library of recordings, the door (access control), the jobs."""

    motor: MotorSession
    library: Library
    door: Door
    work: Work = field(default=do_elsewhere, repr=False)
    """Has a piece of work done in another process."""
    exercises: Path = FOLDER
    """The folder of the exercises."""
    jobs: Jobs = field(default_factory=Jobs, repr=False)


async def front(request: Request, panel: Panel) -> Response:
    """The page; with a link's token in the address, the way in. Who isn't let in reads why: a person as a page.

    Raises `Refused` where a program asks.
    """
    try:
        return await _let_in(request, panel)
    except Refused as refused:
        return await _why_not(refused, request, panel)


async def open_with_key(request: Request, panel: Panel) -> Response:
    """The way in for a key that no address has: one that a local page sends, or a code that was typed. As `front`.

    The answer is a page that goes on to the panel by itself: a redirection would still be the other page's doing, and the browser
    would leave out the session's cookie.
    """
    key = await form_field(request, "token")
    carrier: Carrier = "local page" if request.headers["origin"] == NO_ORIGIN else "code"
    session = panel.door.keys.open(key, carrier)
    if session is None:
        used = "the token of this local page was used or has expired: open the link in the panel's terminal"
        what = used if carrier == "local page" else "this code is wrong or has expired"
        return await _why_not(Refused(401, what), request, panel)
    return _with_cookie(await asyncio.to_thread(page_file, "opened.html"), session, panel.door)


async def _why_not(refused: Refused, request: Request, panel: Panel) -> Response:
    """The page that tells a person why they weren't let in, and takes a code if there is one; raises `refused` for a program."""
    if "text/html" not in request.headers.get("accept", ""):
        raise refused
    page = bytes((await asyncio.to_thread(page_file, "refused.html")).body)
    page = page.replace(b"REASON", escape(_as_sentence(refused.sentence)).encode())
    if panel.door.keys.has_code:
        page = page.replace(b"<form hidden", b"<form")
    headers = {
        "content-security-policy": page_policy(panel.door, "'self'"),
        "referrer-policy": "same-origin",  # without one, browsers say of a form that its page has no origin
    }
    return Response(page, status_code=refused.status, media_type=_TYPES[".html"], headers=headers)


def _as_sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


async def _let_in(request: Request, panel: Panel) -> Response:
    """The page, or the way in. Raises `Refused` for a token that is wrong, used or over, and as `Door.admit`."""
    key = request.query_params.get("token")
    if key is None:
        panel.door.admit(request.headers, Asks())
        return await asyncio.to_thread(page_file, "index.html")
    if _looks_ahead(request):
        raise Refused(403, "this link opens the panel once and can't be preloaded")
    session = panel.door.keys.open(key)
    if session is not None:
        return _with_cookie(RedirectResponse("/", status_code=303), session, panel.door)
    if not panel.door.keys.is_spent(key):
        raise Refused(401, "no link of this panel has this token; open the last one printed in its terminal")
    own = panel.door.session(request.headers)
    if own is not None and own.role == "operator":  # the browser that the link let in, once more
        return RedirectResponse("/", status_code=303)
    raise Refused(
        401,
        "this link was used or is older than twelve hours, and each works once; there is a new one in the panel's "
        "terminal",
    )


def _looks_ahead(request: Request) -> bool:
    """Whether a browser prefetches a page, or a program checks whether it exists."""
    purposes = (request.headers.get(name, "") for name in ("sec-purpose", "purpose"))
    return request.method == "HEAD" or any("prefetch" in purpose for purpose in purposes)


def _with_cookie(response: Response, session: Session, door: Door) -> Response:
    response.set_cookie(
        door.cookie,
        session.cookie,
        httponly=True,
        samesite="strict",
        secure=door.scheme == "https",
        path="/",
    )
    return response


async def static(request: Request, panel: Panel) -> Response:
    """A file of the page."""
    return await asyncio.to_thread(page_file, request.path_params["name"])


async def uplot(request: Request, panel: Panel) -> Response:
    """A file of uPlot, as its package has it; raises `Refused` for one that isn't requested by the page."""
    name = request.path_params["name"]
    if name not in UPLOT:
        raise Refused(404, f"there is no such uPlot file here; there are {', '.join(UPLOT)}")
    return Response(await asyncio.to_thread(_of_uplot, name), media_type=_TYPES[name[name.rindex(".") :]])


async def session(request: Request, panel: Panel) -> Response:
    """The page's own settings, above all the token that it has to send."""
    own = request.state.session
    return as_json(
        {
            "token": own.token,
            "operator": own.role == "operator",
            "device": panel.motor.device(),
            "version": __version__,
            "largest_upload": LARGEST_UPLOAD,
        }
    )


async def catalogue(request: Request, panel: Panel) -> Response:
    """The choices."""
    return as_json(await asyncio.to_thread(_catalogue))


async def preview(request: Request, panel: Panel) -> Response:
    """A signal as it would be."""
    body = await json_object(request)
    return as_json(await asyncio.to_thread(preview_signal, body, panel.motor.experiment))


async def stop(request: Request, panel: Panel) -> Response:
    """STOP, for everybody who is let in at all."""
    await json_object(request)
    panel.motor.stop("STOP was pressed; the voltage is zero")
    return as_json({"stopped": True})


async def block_diagram(request: Request, panel: Panel) -> Response:
    """The block diagram of what goes on at the moment; raises `Refused` where no device is open."""
    loop, experiment = panel.motor.loop, panel.motor.experiment
    if loop is None:
        raise Refused(409, "no device is open: open one first")
    return as_json(await asyncio.to_thread(_diagram_data, experiment, loop.info))


async def exercise_list(request: Request, panel: Panel) -> Response:
    """The exercises."""
    return await list_exercises(request)


async def exercise(request: Request, panel: Panel) -> Response:
    """One exercise."""
    return await show_exercise(request)


async def exercise_results(request: Request, panel: Panel) -> Response:
    """The results of an exercise's studies."""
    _outside_of_assessments(panel)
    return await show_results(request, panel.work)


async def exercise_checked(request: Request, panel: Panel) -> Response:
    """Whether an answer is right."""
    _outside_of_assessments(panel)
    return await check_exercise(request, panel.work)


def _outside_of_assessments(panel: Panel) -> None:
    """Raise `Refused` if the motor is a student's own: its answers are on no page, and another motor's are of no use."""
    if panel.motor.experiment.device.name == ASSIGNED:
        raise Refused(409, "this motor is yours alone: your answers are marked from your form, not here")


def page_file(name: str) -> Response:
    """Return a file of the page; raises `Refused` where there is none."""
    # Compared with the names that there are: none of them leads anywhere else.
    file_name = next((each for each in _static_files() if each == name), None)
    kind = None if file_name is None else _TYPES.get(file_name[file_name.rfind(".") :])
    if file_name is None or kind is None:
        raise Refused(404, "there is no such file")
    return Response((resources("servobench.panel") / "static" / file_name).read_bytes(), media_type=kind)


def as_json(answer: Any) -> Response:
    """Return an answer in JSON; a number that isn't finite is a fault of ours."""
    return Response(json.dumps(answer, allow_nan=False), media_type="application/json")


def _static_files() -> tuple[str, ...]:
    return tuple(each.name for each in (resources("servobench.panel") / "static").iterdir() if each.is_file())


@cache
def _of_uplot(name: str) -> bytes:
    try:
        (file,) = (
            each for each in files("uplot-python") or () if each.name == name and "static" in each.parts
        )
    except PackageNotFoundError:
        raise UsageError('the panel needs uPlot: pip install "servobench[panel]"') from None
    return file.read_binary()


def _diagram_data(experiment: Experiment, info: DeviceInfo) -> dict[str, Any]:
    from servobench.panel.diagram import diagram
    from servobench.panel.placement import drawing

    return drawing(diagram(experiment, info, Chain.parse(experiment.chain)))


@cache
def _catalogue() -> dict[str, Any]:
    return all_that_can_be_chosen()
