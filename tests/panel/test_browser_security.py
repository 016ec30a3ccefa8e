"""Attacks by other pages in the same browser: they fail against a panel, and succeed against a server without a gate.

The browser has a session of the panel, as that of somebody who works with it. The attacker's page is what a browser makes of
it: cookies, Origin and Sec-Fetch-Site are Chromium's own. What counts is what the server saw of it and let through.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

from tests.panel.browser import FLAGS, chromium, served

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from servobench.lab.exercise_file import names
from servobench.panel.routes import TABLE
from tests.panel.conftest import Served, serving

REFUSED = (401, 403, 405, 415, 421)  # 405: the question that a browser asks before, which no route answers
REBOUND = "attacker.test"
ASK_NOBODY = (
    "--disable-features=LocalNetworkAccessChecks"  # newer browsers ask before, which is none of our merit
)
WAYS = [
    [way.method, way.path.replace("{name}", names()[0] if "exercises" in way.path else "first")]
    for way in TABLE
    if way.method != "WS"
]

ATTACK = """async ([target, ways]) => {
    const patience = (start) => new Promise((resolve) => {
        const done = () => resolve();
        setTimeout(done, 4000);
        start(done);
    });
    const element = (name, set, listen = ["load", "error"]) => patience((done) => {
        const made = document.createElement(name);
        listen.forEach((event) => made.addEventListener(event, done));
        Object.assign(made, set);
        document.body.append(made);
    });
    const quietly = (asked) => asked.then(() => {}, () => {});
    for (const [method, path] of ways) {
        const body = method === "POST" ? "{}" : undefined;
        const plain = { method, body, credentials: "include" };
        if (body) plain.headers = { "Content-Type": "text/plain" };
        await quietly(fetch(target + path, { ...plain, mode: "no-cors" }));
        await quietly(fetch(target + path, plain));
        const headers = { "Content-Type": "application/json", "X-Servobench-Token": "guessed" };
        await quietly(fetch(target + path, { ...plain, headers }));
        if (method === "POST") {
            if (navigator.sendBeacon) navigator.sendBeacon(target + path, "{}");
            await patience((done) => {
                const frame = document.createElement("iframe");
                frame.name = "frame" + Math.random();
                const form = document.createElement("form");
                Object.assign(form, { method: "POST", action: target + path, enctype: "text/plain", target: frame.name });
                const field = document.createElement("input");
                Object.assign(field, { name: '{"a":"', value: '"}' });
                form.append(field);
                document.body.append(frame, form);
                frame.addEventListener("load", done);
                form.submit();
            });
        } else {
            await element("iframe", { src: target + path });
            await element("img", { src: target + path });
            await element("script", { src: target + path });
        }
    }
    await patience((done) => {
        const socket = new WebSocket(target.replace("http", "ws") + "/ws");
        socket.onopen = () => { socket.send('{"do": "hello", "token": "guessed"}'); done(); };
        socket.onerror = done;
    });
}"""


@dataclass
class Log:
    """All that a server was asked by pages of one origin and another: Origin or Referer, method, path, status."""

    seen: list[tuple[str, str, int]] = field(default_factory=list)

    @property
    def reached(self) -> list[tuple[str, str, int]]:
        return [each for each in self.seen if each[2] not in REFUSED]

    def around(self, inner: ASGIApp) -> ASGIApp:
        """Note what becomes of each request; a socket that opens is a 101."""

        async def noting(scope: Scope, receive: Receive, send: Send) -> None:
            if scope["type"] == "lifespan":
                await inner(scope, receive, send)
                return

            async def note(message: Message) -> None:
                status = {
                    "http.response.start": message.get("status"),
                    "websocket.accept": 101,
                    "websocket.close": 403,
                    "websocket.http.response.start": message.get("status"),
                }.get(message["type"])
                if status is not None and not (message["type"] == "websocket.close" and opened):
                    opened.append(status)
                    self.seen.append((scope.get("method", "WS"), scope["path"], status))
                await send(message)

            opened: list[int] = []
            await inner(scope, receive, note)

        return noting


async def open_to_all(scope: Scope, receive: Receive, send: Send) -> None:
    """A server without a gate: answers everything, and lets every page ask and read."""
    if scope["type"] == "lifespan":
        while True:
            message = await receive()
            await send({"type": f"{message['type']}.complete"})
            if message["type"] == "lifespan.shutdown":
                return
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        while (await receive())["type"] != "websocket.disconnect":
            pass
        return
    origin = dict(scope["headers"]).get(b"origin", b"*")
    headers = [
        (b"content-type", b"text/html"),
        (b"access-control-allow-origin", origin),
        (b"access-control-allow-credentials", b"true"),
        (b"access-control-allow-headers", b"content-type, x-servobench-token"),
    ]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": b"<!doctype html><title>page</title><body>"})


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium([*FLAGS, f"--host-resolver-rules=MAP {REBOUND} 127.0.0.1", ASK_NOBODY]) as found:
        yield found


@pytest.fixture(scope="module")
def log() -> Log:
    return Log()


@pytest.fixture(scope="module")
def panel(log: Log, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with serving(tmp_path_factory.mktemp("library"), log.around) as found:
        yield found


@pytest.fixture
def attacker() -> Iterator[int]:
    """The port of a server that has the attacker's page."""
    with served(open_to_all) as address:
        yield int(address.rpartition(":")[2])


@contextmanager
def at_work(browser: Any, panel: Served) -> Iterator[Any]:
    """A browser in which somebody drives the motor, on one of its pages."""
    context = browser.new_context()
    page = context.new_page()
    page.goto(f"{panel.origin}/?token={panel.keys.new('operator')}")
    page.get_by_text("You drive").wait_for()
    page.wait_for_load_state("networkidle")  # what the page itself asks for at its beginning is over
    yield context
    context.close()


def attack(context: Any, page_at: str, target: str) -> None:
    """Open the attacker's page and let it try everything; where its name was rebound, it was loaded before that."""
    page = context.new_page()
    if REBOUND in page_at:
        context.route(page_at, lambda route: route.fulfill(content_type="text/html", body="<body>"))
    page.goto(page_at)
    page.evaluate(ATTACK, [target, WAYS])
    page.close()


@pytest.mark.parametrize(
    ("name", "asks_for"),
    [
        ("127.0.0.1", "127.0.0.1"),
        ("localhost", "127.0.0.1"),
        (REBOUND, "localhost"),
        pytest.param("127.0.0.1", "localhost", marks=pytest.mark.long),
        pytest.param("localhost", "localhost", marks=pytest.mark.long),
        pytest.param(REBOUND, "127.0.0.1", marks=pytest.mark.long),
    ],
)
def test_a_page_from_another_port_or_host_reaches_nothing(
    browser: Any, panel: Served, log: Log, attacker: int, name: str, asks_for: str
) -> None:
    with at_work(browser, panel) as context:
        before, commands = len(log.seen), list(panel.loop.commands)
        attack(context, f"http://{name}:{attacker}/attack", f"http://{asks_for}:{panel.port}")
        got = log.seen[before:]
        assert panel.loop.commands == commands

    assert [each for each in got if each[2] not in REFUSED] == []
    assert {(method, path) for method, path, _ in got} >= {(m, p) for m, p in WAYS} | {("WS", "/ws")}


def test_a_name_that_was_rebound_to_this_machine_reaches_nothing(
    browser: Any, panel: Served, log: Log
) -> None:
    """To the browser, page and panel are of one origin then: Sec-Fetch-Site and Origin are as the panel's own page has them."""
    origin = f"http://{REBOUND}:{panel.port}"
    with at_work(browser, panel) as context:
        before = len(log.seen)
        attack(context, f"{origin}/attack", origin)
        got = log.seen[before:]

    assert [each for each in got if each[2] != (403 if each[0] == "WS" else 421)] == []
    assert {(method, path) for method, path, _ in got} >= {(m, p) for m, p in WAYS} | {("WS", "/ws")}


def test_the_same_attacks_reach_a_server_without_a_gate(browser: Any, attacker: int) -> None:
    """This shows that the attacks above really happen."""
    naked = Log()
    with served(naked.around(open_to_all)) as address:
        context = browser.new_context()
        attack(context, f"http://localhost:{attacker}/attack", address)
        context.close()

    for method, path in WAYS:
        # no-cors, plain, with our headers after the browser's question; and as a form and a beacon, or frame, picture and script
        assert sum(each[:2] == (method, path) for each in naked.reached) >= (5 if method == "POST" else 6), (
            method,
            path,
        )
    assert ("WS", "/ws", 101) in naked.reached


def test_the_panels_own_page_reaches_it(browser: Any, panel: Served, log: Log) -> None:
    before = len(log.seen)
    with at_work(browser, panel) as context:
        (page,) = context.pages
        page.get_by_role("button", name="STOP").click()
        page.wait_for_timeout(500)
        answered = page.evaluate("fetch('/api/recordings').then((answer) => answer.status)")
    own = log.seen[before:]
    assert answered == 200
    assert ("POST", "/api/stop", 200) in own
    assert ("WS", "/ws", 101) in own
    assert [each for each in own if each[2] in REFUSED] == []


def test_a_frame_shows_nothing_of_the_panel(browser: Any, panel: Served, attacker: int) -> None:
    with at_work(browser, panel) as context:
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{attacker}/")
        page.evaluate(
            "(src) => { const f = document.createElement('iframe'); f.src = src; document.body.append(f); }",
            panel.origin,
        )
        page.wait_for_timeout(1000)
        texts = [frame.evaluate("document.body.innerText") for frame in page.frames[1:]]
        assert len(texts) == 1
        assert "STOP" not in texts[0]


def test_our_other_name_is_another_page(browser: Any, panel: Served) -> None:
    """A page of localhost isn't one of 127.0.0.1, though both are the panel's."""
    with at_work(browser, panel) as context:
        page = context.new_page()
        page.goto(f"http://localhost:{panel.port}/static/icon.svg")
        said = page.evaluate(
            """(base) => fetch(base + "/api/session", { credentials: "include" }).then((a) => a.text(), (e) => "refused")""",
            panel.origin,
        )
    assert said == "refused"
