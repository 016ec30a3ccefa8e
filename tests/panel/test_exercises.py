"""The answers of the exercises' routes."""

import asyncio
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.routing import Route

from servobench.lab.exercise_file import exercise, exercises
from servobench.panel.exercises import check_exercise, list_exercises, show_exercise, show_results
from servobench.panel.work import PIECES
from servobench.rig.experiment.experiment import AnyController
from servobench.systems.signals.base import AnySignal

WORKED: list[Any] = []


async def work(asked: Any) -> dict[str, Any]:
    """Do the work here, and note that it was asked for."""
    WORKED.append(asked)
    return PIECES[asked["do"]](json.loads(json.dumps(asked)))


async def results(request: Request) -> JSONResponse:
    return await show_results(request, work)


async def check(request: Request) -> JSONResponse:
    return await check_exercise(request, work)


APP = Starlette(
    routes=[
        Route("/api/exercises", list_exercises),
        Route("/api/exercises/{name}", show_exercise),
        Route("/api/exercises/{name}/results", results),
        Route("/api/exercises/{name}/check", check, methods=["POST"]),
    ]
)


def ask(method: str, path: str, **given: Any) -> tuple[int, Any]:
    async def asked() -> httpx.Response:
        transport = httpx.ASGITransport(app=APP)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost") as client:
            return await client.request(method, path, **given)

    answer = asyncio.run(asked())
    return answer.status_code, answer.json()


def test_all_exercises_are_listed_in_their_order() -> None:
    status, listed = ask("GET", "/api/exercises")

    assert status == 200
    assert [each["name"] for each in listed] == [found.name for found in exercises()]
    assert {"encoder", "step"} <= {each["name"] for each in listed}


@pytest.mark.parametrize("found", exercises(), ids=lambda e: e.name)
def test_an_exercise_is_shown_without_its_answers_and_its_experiment_can_be_set(found: Any) -> None:
    from pydantic import TypeAdapter

    status, shown = ask("GET", f"/api/exercises/{found.name}")

    assert status == 200
    assert [set(blank) for blank in shown["blanks"]] == [{"id", "label", "unit"}] * len(found.blanks)
    asked = shown["experiment"]
    assert TypeAdapter(AnySignal).validate_python(asked["signal"]) == found.experiment.signal
    assert TypeAdapter(AnyController).validate_python(asked["controller"]) == found.experiment.controller
    assert asked["chain"] == found.experiment.chain


def test_answers_are_checked() -> None:
    status, said = ask(
        "POST", "/api/exercises/encoder/check", json={"answers": {"counts": "2048", "degrees": "0.7031"}}
    )

    assert status == 200
    assert {name: each["right"] for name, each in said["answers"].items()} == {
        "counts": True,
        "degrees": False,
    }
    assert "too large" in said["answers"]["degrees"]["sentence"]


@pytest.mark.parametrize("name", ["nope", "ENCODER", "encoder.md", "..%5csecret", "%00", "%E2%80%AE"])
def test_an_exercise_that_is_not_there_is_404_with_those_that_are(name: str) -> None:
    for method, path in (("GET", f"/api/exercises/{name}"), ("POST", f"/api/exercises/{name}/check")):
        status, said = ask(method, path)
        assert status == 404
        assert "no exercise called" in said["error"]


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"[",
        b"[]",
        b"null",
        b'{"answers": 1}',
        b'{"answers": {"counts": 2048}}',
        b"\xff",
        b"[" * 50_000,
        b'{"answers": {"nothing": "1"}}',
    ],
)
def test_a_body_that_is_no_answers_is_reported(body: bytes) -> None:
    status, said = ask("POST", "/api/exercises/encoder/check", content=body)

    assert status == 400
    assert said["error"]


def test_a_body_that_is_too_large_is_refused() -> None:
    status, said = ask("POST", "/api/exercises/encoder/check", content=b" " * 70_000)

    assert status == 413
    assert said["error"]


def test_no_answer_is_among_what_is_sent() -> None:
    _, shown = ask("GET", "/api/exercises/encoder")

    assert "counts_per_rev" not in json.dumps(shown)
    assert "8192" not in json.dumps(shown)
    assert exercise("encoder").blank("wrap").answer not in json.dumps(shown)


GOOD = """+++
title = "A lecturer's own"
[experiment]
duration = "1 s"
[signal]
type = "constant"
[[blanks]]
id = "one"
label = "One"
answer = "1"
tolerance = "exact"
+++
Enter one.
"""


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    APP.state.exercises = tmp_path
    yield tmp_path
    del APP.state.exercises


def test_a_lecturers_folder_takes_the_place_of_ours(folder: Path) -> None:
    (folder / "mine.md").write_text(GOOD, encoding="utf-8")

    assert [each["title"] for each in ask("GET", "/api/exercises")[1]] == ["A lecturer's own"]
    assert ask("GET", "/api/exercises/mine")[1]["pieces"] == [{"html": "<p>Enter one.</p>\n"}]
    status, said = ask("POST", "/api/exercises/mine/check", json={"answers": {"one": "1"}})
    assert (status, said["answers"]["one"]["right"]) == (200, True)


def test_a_file_with_a_mistake_is_reported_and_takes_no_other_away(folder: Path) -> None:
    (folder / "mine.md").write_text(GOOD, encoding="utf-8")
    (folder / "bad.md").write_text(GOOD.replace('"exact"', '"so so"'), encoding="utf-8")

    good, bad = ask("GET", "/api/exercises")[1]

    assert "error" not in good
    assert bad["name"] == "bad"
    assert bad["error"].startswith("bad.md:7: ")
    assert str(folder) not in bad["error"]
    status, said = ask("GET", "/api/exercises/bad")
    assert (status, said["error"]) == (400, bad["error"])


def test_an_exercise_for_a_motor_that_is_not_here_says_so(folder: Path) -> None:
    (folder / "mine.md").write_text(
        GOOD.replace("[[blanks]]", '[device]\nname = "other"\n[[blanks]]'), encoding="utf-8"
    )

    status, said = ask("POST", "/api/exercises/mine/check", json={"answers": {"one": "1"}})

    assert status == 400
    assert "only the twin runs without a motor" in said["error"]


STUDY = """[studies.twice]
type = "values"
title = "Twice"
[[studies.twice.rows]]
label = "two turns"
answer = "2 * counts_per_rev"
paper = 4000
[[corrections]]
where = "II.B"
paper = "4000"
ours = "{}"
answer = "twice_value_1"
why = "A turn has more."
[[blanks]]"""


def test_what_studies_find_is_worked_out_once_until_the_file_changes(folder: Path) -> None:
    import os

    file = folder / "mine.md"
    text = GOOD.replace("[[blanks]]", STUDY).replace("Enter one.", "Enter one.\n\n{{ twice }}")
    file.write_text(text, encoding="utf-8")
    WORKED.clear()
    assert ask("GET", "/api/exercises/mine")[1]["pieces"][1] == {"study": "twice"}

    status, found = ask("GET", "/api/exercises/mine/results")
    again = ask("GET", "/api/exercises/mine/results")[1]

    assert (status, again, len(WORKED)) == (200, found, 1)
    (table,) = found["studies"]["twice"]["tables"]
    assert [column["texts"] for column in table["columns"]][:3] == [["two turns"], ["4096"], ["4000"]]
    assert found["corrections"] == [
        {"where": "II.B", "paper": "4000", "ours": "4096", "why": "A turn has more."}
    ]
    file.write_text(text.replace("2 * counts", "3 * counts"), encoding="utf-8")
    os.utime(file, ns=(0, 12345))
    assert ask("GET", "/api/exercises/mine/results")[1]["corrections"][0]["ours"] == "6144"


def test_a_study_that_can_not_be_carried_out_is_reported_with_its_line(folder: Path) -> None:
    text = GOOD.replace("[[blanks]]", STUDY.replace("counts_per_rev", "counts_a_rev"))
    (folder / "mine.md").write_text(text.replace("Enter one.", "{{ twice }}"), encoding="utf-8")

    status, said = ask("GET", "/api/exercises/mine/results")

    assert status == 400
    assert "mine.md:7: the study 'twice': `2 * counts_a_rev`: no fact called 'counts_a_rev'" in said["error"]


@pytest.mark.parametrize("found", exercises(), ids=lambda e: e.name)
def test_all_that_exercises_show_can_be_sent(found: Any) -> None:
    status, sent = ask("GET", f"/api/exercises/{found.name}/results")

    assert status == 200
    assert set(sent["studies"]) == {piece.study for piece in found.pieces if piece.study}
    assert len(sent["corrections"]) == len(found.corrections)
    drawings = [figure["svg"] for study in sent["studies"].values() for figure in study["figures"]]
    assert all(svg.startswith("<svg ") and "<script" not in svg for svg in drawings)


def test_what_answers_are_held_against_is_found_once_and_elsewhere(folder: Path) -> None:
    (folder / "mine.md").write_text(
        GOOD.replace('answer = "1"', 'answer = "counts_per_rev"'), encoding="utf-8"
    )
    WORKED.clear()

    said = [
        ask("POST", "/api/exercises/mine/check", json={"answers": {"one": text}})[1]["answers"]["one"][
            "right"
        ]
        for text in ("2048", "2047", "2048")
    ]

    assert said == [True, False, True]
    assert [(each["do"], each["names"]) for each in WORKED] == [("facts", ["counts_per_rev"])]


def test_a_fact_that_is_not_there_is_reported_with_those_that_are(folder: Path) -> None:
    (folder / "mine.md").write_text(GOOD.replace('answer = "1"', 'answer = "counts_a_rev"'), encoding="utf-8")

    for _ in range(2):
        status, said = ask("POST", "/api/exercises/mine/check", json={"answers": {"one": "1"}})
        assert status == 400
        assert "no fact called 'counts_a_rev'" in said["error"]
        assert "counts_per_rev" in said["error"]
