"""The routes of recordings."""

from __future__ import annotations

import asyncio
import json
import os
import re
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from starlette.background import BackgroundTask
from starlette.requests import Request
from starlette.responses import FileResponse, Response

from servobench.core import toml
from servobench.core.errors import FormatError, UsageError
from servobench.panel.bodies import LARGEST_UPLOAD, gather, json_object, pieces
from servobench.panel.columns import QUESTIONS
from servobench.panel.field_names import with_fields
from servobench.panel.gate import REPORT_POLICY, Refused
from servobench.panel.leftovers import complete_leftovers
from servobench.panel.library import (
    MAPPING,
    RECORDING,
    REPORT,
    About,
    about_in,
    check_name,
    keep_about,
    nearest_name,
    replace_file,
)
from servobench.panel.pages import Panel, as_json
from servobench.panel.replay import frame_of
from servobench.panel.work import Said, nobody_asks

_SUFFIXES = 16  # characters of a file's ending that matter to what it is
_LONGEST_SHOWN = 80  # characters of a file's name in a sentence


async def list_all(request: Request, panel: Panel) -> Response:
    """All recordings, those among them that a killed panel left."""
    await asyncio.to_thread(complete_leftovers, panel.library, panel.motor.takings.name)
    return as_json(await asyncio.to_thread(panel.library.list))


async def save_notes(request: Request, panel: Panel) -> Response:
    """Notes to one."""
    body = await json_object(request)
    await asyncio.to_thread(panel.library.note, _name(request), body.get("notes"))
    return _announce_change(panel)


async def delete(request: Request, panel: Panel) -> Response:
    """Away with one, where it can be brought back from."""
    await json_object(request)
    _check_not_being_made(request, panel)
    await asyncio.to_thread(panel.library.delete, _name(request))
    return _announce_change(panel)


async def undelete(request: Request, panel: Panel) -> Response:
    """One is brought back."""
    await json_object(request)
    await asyncio.to_thread(panel.library.undelete, _name(request))
    return _announce_change(panel)


async def download(request: Request, panel: Panel) -> Response:
    """One as a file: as it is, or as text. Raises `UsageError` for another format."""
    name = _name(request)
    native = await asyncio.to_thread(panel.library.file, name, RECORDING)
    form = request.query_params.get("as", "mcap")
    if form == "mcap":
        return FileResponse(native, filename=f"{name}.mcap", media_type="application/octet-stream")
    if form != "csv":
        raise UsageError(f"a recording isn't available as {form[:20]!r}; expected mcap or csv")
    folder = await asyncio.to_thread(TemporaryDirectory, prefix="servobench-")
    try:
        text = Path(folder.name) / f"{name}.csv"
        order = {"do": "convert", "file": os.fspath(native), "called": name, "to": os.fspath(text)}
        await panel.work(order)
    except BaseException:
        await asyncio.to_thread(folder.cleanup)
        raise
    return FileResponse(
        text,
        filename=text.name,
        media_type="text/csv; charset=utf-8",
        background=BackgroundTask(folder.cleanup),
    )


async def rows(request: Request, panel: Panel) -> Response:
    """One as scopes show it; raises `Refused` with 422 where its file can't be read, so that nothing else can be done with it."""

    def draw() -> bytes:
        return frame_of(panel.library.file(_name(request), RECORDING))

    try:
        frame = await asyncio.to_thread(draw)
    except FormatError as error:
        raise Refused(422, with_fields(panel.library.with_names(str(error)))) from error
    return Response(frame, media_type="application/octet-stream")


async def identify_one(request: Request, panel: Panel) -> Response:
    """The result of a recording.

    Raises `UsageError` for a structure that is no name, `Refused` where nobody has said what its columns are.
    """
    body = await json_object(request)
    structure = body.get("structure", "auto")
    if not isinstance(structure, str):
        raise UsageError(f"{structure!r} isn't the name of a model structure")
    name = _name(request)
    native = await asyncio.to_thread(panel.library.file, name, RECORDING)
    page = native.parent / REPORT
    order = {
        "do": "identify",
        "file": os.fspath(native),
        "called": name,
        "structure": structure,
        "report": os.fspath(page),
    }
    known = await asyncio.to_thread(about_in, native.parent)
    if known.columns == "open":
        raise Refused(409, f"the columns of {name} aren't assigned yet: choose Columns there")

    async def identify_and_keep(order: Mapping[str, Any], said: Said = nobody_asks) -> dict[str, Any]:
        """The result, stored before the end of the identification is announced, so that a request after that finds it."""
        identification: dict[str, Any] = (await panel.work(order, said))["result"]
        await asyncio.to_thread(panel.library.judge, native.parent, identification)
        return identification

    result = await panel.jobs.identify(identify_and_keep, panel.motor.tell, name, order, known.samples)
    panel.motor.tell({"kind": "library"})
    return _answer(name, result)


async def identification_ended(request: Request, panel: Panel) -> Response:
    """Cancel an identification."""
    await json_object(request)
    panel.jobs.end(_name(request))
    return as_json({})


async def result(request: Request, panel: Panel) -> Response:
    """The stored result of a recording; raises `Refused` if there is none, or not for these columns."""
    name = _name(request)
    identification = await asyncio.to_thread(panel.library.result, name)
    if identification is None:
        raise Refused(404, f"{name} isn't identified yet: identify it first")
    return _answer(name, identification)


def _answer(name: str, result: Mapping[str, Any]) -> Response:
    """A result with the place of its report; its findings name the page's fields where there is something to say there."""
    findings = [{**each, "sentence": with_fields(each["sentence"])} for each in result.get("findings", ())]
    return as_json({**result, "findings": findings, "report": f"/reports/{name}"})


async def report(request: Request, panel: Panel) -> Response:
    """The report of one, which may do nothing."""
    page = await asyncio.to_thread(panel.library.file, _name(request), REPORT)
    return FileResponse(
        page, media_type="text/html; charset=utf-8", headers={"content-security-policy": REPORT_POLICY}
    )


async def upload(request: Request, panel: Panel) -> Response:
    """Import a file as a recording; its name is adjusted, and its columns may have to be assigned."""
    file_name = request.query_params.get("name", "")
    stem, suffix = _stem_and_suffix(file_name)
    folder = await asyncio.to_thread(panel.library.new_like, stem)
    try:
        place = await asyncio.to_thread(TemporaryDirectory, prefix=".", dir=folder)
        try:
            # Its recording is called after it; what can't be a name everywhere is none on this disk.
            file = Path(place.name) / f"{nearest_name(stem)}{suffix}"
            await _store_body(request, file)
            order = {
                "do": "import",
                "file": os.fspath(file),
                "called": _file_text(file_name),
                "name": file.name,
                "to": os.fspath(folder / RECORDING),
                "created": datetime.now().isoformat(timespec="seconds"),
            }
            description = await panel.work(order)
        finally:
            await asyncio.to_thread(place.cleanup)
        await asyncio.to_thread(_write_description, folder, description)
    except BaseException:
        await asyncio.to_thread(panel.library.forget, folder)
        raise
    panel.motor.tell({"kind": "library"})
    return as_json(
        {
            "name": folder.name,
            "open": description["questions"]["open"],
            "warnings": description["about"]["warnings"],
        }
    )


async def columns(request: Request, panel: Panel) -> Response:
    """The questions about an imported file's columns, with the answers so far."""
    return as_json(await asyncio.to_thread(_questions, panel, _name(request)))


def _questions(panel: Panel, name: str) -> dict[str, Any]:
    questions: dict[str, Any] = json.loads(panel.library.file(name, QUESTIONS).read_text(encoding="utf-8"))
    mapping_file = panel.library.folder_of(name) / MAPPING
    questions["said"] = toml.loads(mapping_file.read_text(encoding="utf-8")) if mapping_file.is_file() else {}
    return questions


async def columns_said(request: Request, panel: Panel) -> Response:
    """Store the answers with the recording if the file agrees with them."""
    answers = await json_object(request)
    native = await asyncio.to_thread(panel.library.file, _name(request), RECORDING)
    await asyncio.to_thread(
        panel.library.file, _name(request), QUESTIONS
    )  # or else it says itself what it holds
    order = {"do": "map", "file": os.fspath(native), "called": _name(request), "said": answers}
    answer = await panel.work(order)
    await asyncio.to_thread(
        panel.library.say_columns, native.parent, answer["mapping"], answer["length"], answer["samples"]
    )
    return _announce_change(panel)


def _write_description(folder: Path, description: dict[str, Any]) -> None:
    """Keep what is known of an imported file, and what is asked about it."""
    replace_file(folder / QUESTIONS, json.dumps(description["questions"]))
    known = About(**description["about"])
    # Without known times the duration is unknown.
    open_questions = description["questions"]["open"]
    keep_about(
        folder,
        replace(known, columns="open", duration=0.0) if open_questions else replace(known, columns="known"),
    )


async def _store_body(request: Request, file: Path) -> None:
    """Write the body of a request to a file as it comes, and no more of it than may be."""
    out = await asyncio.to_thread(file.open, "xb")
    try:
        async for piece in gather(pieces(request, LARGEST_UPLOAD)):
            await asyncio.to_thread(out.write, piece)
        length = out.tell()
    finally:
        await asyncio.to_thread(out.close)
    if not length:
        raise UsageError("the file is empty")


def _stem_and_suffix(name: str) -> tuple[str, str]:
    """The name of a file without its ending, and the ending; raises `UsageError` where it has none that could be one."""
    stem, dot, suffix = name.rpartition(".")
    if not stem or not re.fullmatch(f"[A-Za-z0-9]{{1,{_SUFFIXES}}}", suffix):
        raise UsageError(f"{name[:80]!r} has no file ending; expected one such as .csv")
    return stem, dot + suffix.lower()


def _file_text(name: str) -> str:
    """The name of an uploaded file in a sentence: on one line, and no longer than a line."""
    return "".join(each if each.isprintable() else "?" for each in name)[:_LONGEST_SHOWN]


def _name(request: Request) -> str:
    return check_name(request.path_params["name"])


def _check_not_being_made(request: Request, panel: Panel) -> None:
    if panel.motor.takings.name == _name(request):
        raise Refused(409, "this is being recorded: end that first")


def _announce_change(panel: Panel) -> Response:
    panel.motor.tell({"kind": "library"})
    return as_json({})
