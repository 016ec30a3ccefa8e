"""A browser and the stand-in server, for tests of the page."""

from __future__ import annotations

import asyncio
import shutil
import threading
import time
from collections.abc import Iterator, MutableMapping, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-sync",
]


@contextmanager
def chromium(flags: Sequence[str] = FLAGS) -> Iterator[Any]:
    """A browser; the test is skipped where there is none."""
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        pytest.skip("a browser is absent: no playwright (pip install playwright)")
    path = next(filter(None, map(shutil.which, NAMES)), None)
    if path is None:
        pytest.skip("a browser is absent: no chromium (apt install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(flags))
        yield browser
        browser.close()


@contextmanager
def served(app: Any) -> Iterator[str]:
    """The address of an application that is served in a thread meanwhile."""
    import uvicorn

    config = uvicorn.Config(app, port=0, log_level="error", lifespan="on", ws="websockets-sansio")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        deadline = time.monotonic() + 60
        while not server.started:
            if time.monotonic() > deadline or not thread.is_alive():
                raise RuntimeError("the stand-in server didn't begin")
            time.sleep(0.01)
        port = server.servers[0].sockets[0].getsockname()[1]
        yield f"http://127.0.0.1:{port}"
    finally:
        server.should_exit = True
        server.force_exit = True
        thread.join(timeout=30)


class Stage:
    """A server for one application after the other, at one address: the browser keeps the page's files from test to test.

    Loading them anew and compiling their JavaScript is half of the work of opening the page. Each application is begun and ended
    as by a server of its own; what it hadn't answered by then is given up.
    """

    def __init__(self) -> None:
        self._inner: Any = None
        self._under_way: set[asyncio.Task[None]] = set()
        self._loop: asyncio.AbstractEventLoop | None = None

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "lifespan":
            await self._live(receive, send)
            return
        if self._inner is None:  # a page that nobody has closed yet, between two tests
            return
        answering = asyncio.create_task(self._inner(scope, receive, self._keepable(scope, send)))
        self._under_way.add(answering)
        with suppress(asyncio.CancelledError):
            await answering
        self._under_way.discard(answering)

    async def _live(self, receive: Any, send: Any) -> None:
        self._loop = asyncio.get_running_loop()
        await receive()
        await send({"type": "lifespan.startup.complete"})
        await receive()
        await send({"type": "lifespan.shutdown.complete"})

    def _keepable(self, scope: Any, send: Any) -> Any:
        """Let the browser keep the page's files, which are the same for every test; the policies remain as they are."""

        async def send_on(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start" and scope["path"].startswith(("/static/", "/uplot/")):
                others = [header for header in message["headers"] if header[0] != b"cache-control"]
                message["headers"] = [*others, (b"cache-control", b"max-age=3600")]
            await send(message)

        return send_on

    @contextmanager
    def shows(self, application: Any) -> Iterator[None]:
        """Serve an application meanwhile."""
        life = application.router.lifespan_context(application)

        async def begin() -> None:
            await life.__aenter__()
            self._inner = application

        async def end() -> None:
            self._inner = None
            for each in self._under_way:
                each.cancel()
            await life.__aexit__(None, None, None)

        assert self._loop is not None
        asyncio.run_coroutine_threadsafe(begin(), self._loop).result(60)
        try:
            yield
        finally:
            asyncio.run_coroutine_threadsafe(end(), self._loop).result(60)
