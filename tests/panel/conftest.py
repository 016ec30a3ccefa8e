"""A panel that is served by a real server in a thread, with a loop that is none."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import httpx
import pytest
import uvicorn
from starlette.types import ASGIApp

from servobench.panel import work
from servobench.panel.keys import Keys, Session
from servobench.panel.library import Library
from servobench.panel.low_priority import surroundings
from servobench.panel.pages import Panel
from servobench.panel.server import app, door_for, listen, settings
from servobench.panel.session import MotorSession
from servobench.rig.experiment import Experiment
from tests.panel.browser import Stage
from tests.panel.browser import served as serve
from tests.panel.doubles import LoopDouble, unidentified
from tests.panel.fake import app as app_of_a_bench

PATIENCE = 120.0  # s; on a machine that is busy with other tests


@dataclass
class Clock:
    """A time that a test moves."""

    now: float = 0.0

    def __call__(self) -> float:
        return self.now


@dataclass
class Served:
    """A panel that is served, and what a test wants to look at behind it."""

    panel: Panel
    keys: Keys
    clock: Clock
    port: int
    loops: list[LoopDouble] = field(default_factory=list)

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def loop(self) -> LoopDouble:
        return self.loops[-1]

    def session(self, role: str = "operator") -> Session:
        found = self.keys.open(self.keys.new(role))  # type: ignore[arg-type]
        assert found is not None
        return found

    def headers(self, session: Session, content: str = "application/json") -> dict[str, str]:
        """All that a page of ours sends."""
        return {
            "origin": self.origin,
            "sec-fetch-site": "same-origin",
            "content-type": content,
            "x-servobench-token": session.token,
            "cookie": f"servobench_session_{self.port}={session.cookie}",
        }

    @cached_property
    def http(self) -> httpx.Client:
        """A client for many requests; making one takes long."""
        return self.client()

    def client(self) -> httpx.Client:
        return httpx.Client(base_url=self.origin, timeout=PATIENCE)


def wait_for(what: Callable[[], bool]) -> None:
    """Wait until something is so; how long doesn't matter, but not for ever."""
    met = threading.Event()
    for _ in range(int(PATIENCE / 0.01)):
        if what():
            return
        met.wait(0.01)
    raise AssertionError("it never came to be so")


@pytest.fixture(scope="module")
def tab(browser: Any) -> Iterator[Any]:
    """A tab for pages of a file's tests, one after the other: a new one for each would take a quarter longer."""
    context = browser.new_context(viewport={"width": 1440, "height": 900})
    yield context.new_page()
    context.close()


@pytest.fixture(scope="module")
def stage() -> Iterator[tuple[Stage, str]]:
    """A server for the benches of a file's tests, one after the other, and its address."""
    made = Stage()
    with serve(made) as address:
        yield made, address


@pytest.fixture
def server(stage: tuple[Stage, str], browser: Any, tab: Any) -> Iterator[tuple[str, Any]]:
    """The address of the stand-in server, and its bench, which is a new one for each test."""
    made = app_of_a_bench()
    with stage[0].shows(made):
        yield stage[1], made.state.bench
        for context in browser.contexts:  # a page that is left open would go on with the next test's bench
            if context is not tab.context:
                context.close()


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("library")) as found:
        yield found


@contextmanager
def serving(folder: Path, around: Callable[[ASGIApp], ASGIApp] = lambda inner: inner) -> Iterator[Served]:
    """Serve a panel with its recordings in a folder; `around` is put around the app, gate and all."""
    loops: list[LoopDouble] = []

    def loop_of(experiment: Experiment) -> LoopDouble:
        loops.append(LoopDouble(experiment))
        return loops[-1]

    clock = Clock()
    keys, library = Keys(clock), Library(folder)
    with listen("127.0.0.1", 0) as listener:
        port = listener.getsockname()[1]
        door = door_for(["127.0.0.1", "localhost"], port, "http", keys)
        panel = Panel(
            motor=MotorSession(Experiment(), library, loop_of, unidentified), library=library, door=door
        )
        server = uvicorn.Server(settings(around(app(panel)), None))
        thread = threading.Thread(target=lambda: asyncio.run(server.serve([listener])))
        thread.start()
        try:
            wait_for(lambda: server.started and bool(loops) and loops[0].entered)
            wait_for(lambda: panel.motor.loop is not None)
            found = Served(panel=panel, keys=keys, clock=clock, port=port, loops=loops)
            with found.http:
                yield found
        finally:
            server.should_exit = True
            thread.join(PATIENCE)
    assert not thread.is_alive()
    assert all(loop.left for loop in loops)


@pytest.fixture(scope="module")
def pressing_work() -> Iterator[None]:
    """Work on recordings at the priority of everybody else: for tests of what comes of it, which would wait on a busy machine."""
    program = "import os, runpy; os.nice = lambda _: 0; runpy.run_module('servobench.panel.work', run_name='__main__')"

    def process() -> subprocess.Popen[bytes]:
        pipes: Any = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
        return subprocess.Popen([sys.executable, "-P", "-c", program], env=surroundings(), **pipes)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(work, "_process", process)
        yield


@pytest.fixture
def folder(served: Served) -> Path:
    return served.panel.library.folder
