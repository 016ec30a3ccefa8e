"""The server's event loop waits for no file, process or import: the interpreter itself tells an audit hook of them, in the thread
that asks for them. No time is measured."""

from __future__ import annotations

import asyncio
import json
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn
from websockets.asyncio.client import connect

from servobench.panel.keys import Keys
from servobench.panel.library import Library
from servobench.panel.pages import Panel
from servobench.panel.server import app, door_for, listen, settings
from servobench.panel.session import MotorSession
from servobench.rig.experiment import DeviceChoice, Experiment
from tests.panel.doubles import rows_until

PATIENCE = 240.0  # s; kernels may have to be compiled
WAITS = (
    "open",
    "os.",
    "shutil.",
    "tempfile.",
    "subprocess.",
    "mmap.",
    "import",
    "glob.",
    "pathlib.",
    "fsync",
)


class Watched:
    """The actions of one thread that may block."""

    def __init__(self) -> None:
        self.thread = 0
        self.seen: list[str] = []

    def __call__(self, event: str, given: tuple[Any, ...]) -> None:
        if self.thread and event.startswith(WAITS) and threading.get_ident() == self.thread:
            ours = [code for code in _callers() if "servobench" in code]
            if ours:  # a module that a library loads once, when it is first needed, is its own
                self.seen.append(f"{event} {str(given)[:120]} in {' < '.join(ours[:3])}")


def _callers() -> Iterator[str]:
    frame = sys._getframe(2)
    while frame is not None:
        yield f"{frame.f_code.co_filename.rpartition('src/')[2]}:{frame.f_lineno}"
        frame = frame.f_back  # type: ignore[assignment]


@pytest.fixture(scope="module")
def hook() -> Iterator[Watched]:
    watched = Watched()
    sys.addaudithook(watched)  # for good; without a thread it looks at nothing
    with pytest.MonkeyPatch.context() as patch:
        fsync = os.fsync

        def told(file: int) -> None:
            sys.audit("fsync", file)
            fsync(file)

        patch.setattr(os, "fsync", told)
        yield watched
    watched.thread = 0


@contextmanager
def served(folder: Path, watched: Watched) -> Iterator[tuple[Panel, str, Keys]]:
    """A panel with a real loop in its own process, and 20 recordings; the event loop's thread is watched from now on."""
    library, keys = Library(folder), Keys()
    library.prepare()
    for k in range(20):
        (library.new(f"old-{k}") / "recording.mcap").write_bytes(b"no recording")
    with listen("127.0.0.1", 0) as listener:
        port = listener.getsockname()[1]
        door = door_for(["127.0.0.1"], port, "http", keys)
        asked = Experiment(device=DeviceChoice(name="twin", settings={"timing": "host"}))
        panel = Panel(motor=MotorSession(asked, library), library=library, door=door)
        server = uvicorn.Server(settings(app(panel), None))
        thread = threading.Thread(target=lambda: asyncio.run(server.serve([listener])))
        thread.start()
        try:
            until = time.monotonic() + PATIENCE
            while not server.started and time.monotonic() < until:
                time.sleep(0.01)
            assert server.started
            watched.seen, watched.thread = [], thread.ident or 0
            yield panel, f"http://127.0.0.1:{port}", keys
        finally:
            watched.thread = 0
            server.should_exit = True
            thread.join(PATIENCE)
    assert not thread.is_alive()


class Visit:
    """A page without a browser, with its socket."""

    def __init__(self, http: httpx.AsyncClient, socket: Any, headers: dict[str, str]) -> None:
        self.http = http
        self.headers = headers
        self.heard: list[dict[str, Any]] = []
        self._socket = socket
        self._listening = asyncio.create_task(self._listen())

    async def _listen(self) -> None:
        async for message in self._socket:
            if isinstance(message, str):
                self.heard.append(json.loads(message))
            else:
                await self._socket.send(json.dumps({"do": "beat", "row": rows_until(message)}))

    async def until(self, kind: str, **what: object) -> dict[str, Any]:
        async with asyncio.timeout(PATIENCE):
            while True:
                for each in self.heard:
                    if each["kind"] == kind and what.items() <= each.items():
                        return each
                await asyncio.sleep(0.01)

    async def say(self, **said: object) -> None:
        number = len(self.heard) + 1000
        await self._socket.send(json.dumps({"id": number, **said}))
        answer = await self.until("answer", id=number)
        assert answer["ok"], answer

    async def get(self, path: str) -> Any:
        return (await self.http.get(path)).raise_for_status()

    async def post(self, path: str, body: dict[str, Any]) -> Any:
        return (await self.http.post(path, json=body, headers=self.headers)).raise_for_status()


async def visited(base: str, key: str, story: Any) -> None:
    async with httpx.AsyncClient(base_url=base, timeout=PATIENCE) as http:
        await http.get(f"/?token={key}")
        told = (await http.get("/api/session", headers={"sec-fetch-site": "same-origin"})).json()
        cookie = "; ".join(f"{name}={value}" for name, value in http.cookies.items())
        headers = {
            "origin": base,
            "sec-fetch-site": "same-origin",
            "content-type": "application/json",
            "x-servobench-token": told["token"],
        }
        async with connect(
            base.replace("http", "ws") + "/ws",
            origin=base,  # type: ignore[arg-type]
            additional_headers={"cookie": cookie},
            max_size=None,
            proxy=None,
            open_timeout=PATIENCE,
        ) as socket:
            await socket.send(json.dumps({"do": "hello", "token": told["token"]}))
            await story(Visit(http, socket, headers))


async def all_that_a_page_does(page: Visit) -> None:
    await page.until("state", running=True)
    for path in ("/", "/static/page.js", "/uplot/uPlot.iife.js", "/api/catalogue", "/api/diagram"):
        await page.get(path)
    await page.post("/api/preview", {"signal": {"type": "square"}})
    await page.say(do="lease")
    await page.say(do="start")
    await page.say(do="set", chain="derivative | lowpass 70 rad/s", signal={"type": "sine"})
    await page.say(do="record", name="mine", duration=1.0)
    await page.until("recorded", name="mine")
    await page.say(do="open", device={"name": "twin", "settings": {}}, sample_time=0.002)
    assert len((await page.get("/api/recordings")).json()) == 21
    await page.post("/api/recordings/mine/notes", {"notes": "a note"})
    for path in ("rows", "download", "download?as=csv"):
        await page.get(f"/api/recordings/mine/{path}")
    await page.post("/api/recordings/mine/identify", {"structure": "first_order"})
    await page.get("/reports/mine")
    await page.post("/api/recordings/mine/delete", {})
    await page.post("/api/recordings/mine/undelete", {})
    text = b"t,voltage,counts\n" + b"".join(b"%.3f,%d,%d\n" % (k / 500, k // 100 % 2, k) for k in range(2000))
    content = {**page.headers, "content-type": "application/octet-stream"}
    sent = await page.http.post("/api/upload?name=theirs.csv", content=text, headers=content)
    assert sent.status_code == 200, sent.text
    names = [each["name"] for each in (await page.get("/api/exercises")).json()]
    await page.get(f"/api/exercises/{names[0]}")
    await page.post("/api/exercises/encoder/check", {"answers": {"counts": "2048"}})
    await page.say(do="release")
    await page.post("/api/stop", {})


def test_no_file_process_or_import_is_waited_for_by_the_event_loop(tmp_path: Path, hook: Watched) -> None:
    with served(tmp_path, hook) as (_, base, keys):
        asyncio.run(visited(base, keys.new("operator"), all_that_a_page_does))
        seen = sorted(set(hook.seen))

    assert seen == []


def test_what_the_event_loop_waits_for_is_seen(tmp_path: Path, hook: Watched) -> None:
    """The test above can fail: a page that reads a file where it shouldn't."""
    with served(tmp_path, hook) as (panel, base, keys):

        async def story(page: Visit) -> None:
            await page.until("state", running=True)
            before = panel.motor.lease.take

            def slow(viewer: Any) -> None:
                list(os.scandir(tmp_path))
                before(viewer)

            panel.motor.lease.take = slow  # type: ignore[method-assign]
            hook.seen = []
            await page.say(do="lease")
            assert [each.partition(" ")[0] for each in hook.seen] == ["os.scandir"]

        asyncio.run(visited(base, keys.new("operator"), story))
