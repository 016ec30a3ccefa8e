"""The panel with a student's own motor: no answer of any route, no file and no word on the socket tells its parameters."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import cache
from typing import Any

import httpx
import pytest

from servobench.lab.exercise_file import exercise
from servobench.panel.routes import TABLE
from servobench.rig.motor.individual import individual
from tests.lab.test_assessment import everything, physical, spellings
from tests.panel.test_real_loop import PATIENCE, Page, Program, played, turning
from tests.stories.program import running

SECRET = bytes(range(32))
EXERCISES = ("step", "parameter_estimation")
OWN = individual(SECRET, "parameter_estimation", "ada")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Program]:
    folder = tmp_path_factory.mktemp("assigned")
    (folder / "secret").write_bytes(SECRET)
    (folder / "secret").chmod(0o600)
    options = ["--assess", "Ada", "--secret", "secret", "--exercise", "parameter_estimation"]
    with running(folder, *options) as found:
        yield Program(found.process, found.base, lambda: found.address, found.folder)


@cache
def hidden() -> set[bytes]:
    values = (*(v for v in OWN.twin_settings.values() if v), *physical(OWN))
    numbers = set().union(*(spellings(value) for value in values))
    return {*numbers, SECRET, SECRET.hex().encode(), str(OWN.noise_seed).encode()}


def check_tells_nothing(what: str, content: bytes) -> None:
    for each in hidden():
        assert not stands_in(each, content), (what, each)


def stands_in(each: bytes, content: bytes) -> bool:
    """Whether the content contains those bytes; digits only as a number of their own.

    Six digits of ours are somewhere within others' in one of a million places, and a session's numbers have more than 1e5.
    """
    if not re.fullmatch(rb"[-+0-9.,eE]+", each):
        return each in content
    return each in content and bool(re.search(rb"(?<![0-9.])" + re.escape(each) + rb"(?![0-9])", content))


@pytest.mark.parametrize(
    ("content", "told"),
    [(b"[0.123456]", True), (b'"-0.123456,"', True), (b"10.123456", False), (b"0.1234567", False)],
)
def test_a_number_is_looked_for_as_one(content: bytes, told: bool) -> None:
    assert stands_in(b"0.123456", content) == told


async def recorded(program: Program, page: Page) -> str:
    """Record half a second of the turning motor; return the recording's name."""
    await turning(page)
    assert (await page.say(do="record", name="mine", duration=0.5))["ok"]
    await page.listen_until(lambda: any(each["kind"] == "recorded" for each in page.heard))
    return str(next(each["name"] for each in page.heard if each["kind"] == "recorded"))


async def all_answers(program: Program, name: str) -> dict[str, bytes]:
    """The answer of each route to a client with all rights."""
    found = {}
    async with httpx.AsyncClient(base_url=program.base, timeout=3 * PATIENCE) as client:
        await client.get(f"/?token={program.key}")
        token = (await client.get("/api/session", headers={"sec-fetch-site": "same-origin"})).json()["token"]
        headers = {
            "origin": program.base,
            "sec-fetch-site": "same-origin",
            "content-type": "application/json",
            "x-servobench-token": token,
        }
        for way in TABLE:
            if way.method == "WS" or way.path.endswith(("/delete", "/undelete", "/upload")):
                continue
            called = EXERCISES if "exercises" in way.path else (name,)
            for each in called if "{name}" in way.path else ("",):
                path = way.path.replace("{name}", each)
                for query in ("", "?as=csv") if path.endswith("download") else ("",):
                    body = json.dumps({"answers": {"inertia": "1"}}) if way.method == "POST" else None
                    answer = await client.request(way.method, path + query, headers=headers, content=body)
                    found[f"{way.method} {path}{query} {answer.status_code}"] = (
                        answer.content + repr(answer.headers).encode()
                    )
    return found


def test_nothing_that_the_panel_says_tells_the_parameters(program: Program) -> None:
    # Loaded before the page is there: one that takes nothing for as long as that falls behind.
    begun = exercise("parameter_estimation").experiment.model_dump(mode="json")
    hidden()

    async def story(sockets: list[Any]) -> None:
        page = await program.page(sockets)
        # It begins with the exercise's own experiment, on this motor.
        assert page.state["signal"] == begun["signal"]
        assert page.state["device"]["name"] == "assigned"
        name = await recorded(program, page)

        answers = await all_answers(program, name)

        for asked, content in answers.items():
            check_tells_nothing(asked, content)
        answered = {key.rpartition(" ")[0] for key in answers if key.endswith(" 200")}
        assert {
            "GET /api/diagram",
            "GET /api/catalogue",
            "GET /api/recordings",
            f"GET /api/recordings/{name}/download",
            f"GET /api/recordings/{name}/download?as=csv",
            f"GET /api/recordings/{name}/rows",
            "GET /api/exercises/step",
        } <= answered
        # Answers are marked from the form; another motor's would be held against them here.
        for each in EXERCISES:
            assert f"POST /api/exercises/{each}/check 409" in answers
            assert f"GET /api/exercises/{each}/results 409" in answers
        check_tells_nothing("what was heard", json.dumps(page.heard).encode())
        for path, content in everything(program.folder):
            check_tells_nothing(str(path), content)

    played(story)


def test_the_motor_can_t_be_changed_for_another(program: Program) -> None:
    async def story(sockets: list[Any]) -> None:
        page = await program.page(sockets)
        await page.say(do="lease")
        own = page.state["device"]["settings"]

        for device in (
            {"name": "twin"},
            {"name": "assigned", "settings": {**own, "student": "blaise"}},
            {"name": "assigned", "settings": {**own, "shared": {"viscous_friction": 0.1}}},
        ):
            refused = await page.say(do="open", device=device)
            assert not refused["ok"]
            assert "assigned to you" in refused["error"]
        again = await page.say(do="open", device={"name": "assigned", "settings": own}, sample_time=0.001)
        assert again["ok"], again
        await page.listen_until(lambda: page.state["sample_time"] == 0.001)

    played(story)
