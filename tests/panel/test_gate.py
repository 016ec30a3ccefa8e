"""Nobody gets in who shouldn't: the table of all routes is walked, with each thing wrong that a request can have wrong."""

from __future__ import annotations

import re
import socket
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from starlette.applications import Starlette
from starlette.routing import Route, WebSocketRoute
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from servobench.lab.exercise_file import names
from servobench.panel.gate import Gate
from servobench.panel.keys import KEY_TIME, LOCAL_TIME, SESSION_TIME, Carrier, Keys
from servobench.panel.routes import TABLE, Way
from servobench.panel.server import app
from tests.panel.conftest import Clock, Served, serving

HTTP = [way for way in TABLE if way.method != "WS"]
PRIVATE = [way for way in TABLE if way.asks.session]
OPENS = next(way for way in TABLE if way.path == "/open")  # a key in its body, before there is a session
POSTS = [way for way in TABLE if way.method == "POST" and way is not OPENS]

FOREIGN = {
    "another host's name": {"host": "evil.test"},
    "a rebound name with our port": {"host": "evil.test:{port}"},
    "no port": {"host": "127.0.0.1"},
    "another port": {"host": "127.0.0.1:1"},
    "another origin": {"origin": "http://evil.test"},
    "another port of this machine": {"origin": "http://127.0.0.1:1", "sec-fetch-site": "same-site"},
    "another port, whatever the browser says": {"origin": "http://127.0.0.1:1"},
    "another scheme": {"origin": "https://127.0.0.1:{port}"},
    "a page without an origin": {"origin": "null"},
    "an origin like ours": {"origin": "http://127.0.0.1:{port}.evil.test"},
    "our other name's origin": {"origin": "http://localhost:{port}"},
    "a cross-site request": {"sec-fetch-site": "cross-site"},
    "a same-site request": {"sec-fetch-site": "same-site"},
    "an unknown site": {"sec-fetch-site": ""},
}
REBOUND = {"host": "evil.test:{port}", "origin": "http://evil.test:{port}", "sec-fetch-site": "same-origin"}
"""The request of a page whose own name resolves to this machine: to its browser it's all of one origin."""


VIEWERS = ("/api/stop", "/api/preview", "/api/exercises/{name}/check")
"""The requests that a page may make if it may only watch: STOP, and those that change nothing."""


def path_of(way: Way) -> str:
    return way.path.replace("{name}", names()[0] if "exercises" in way.path else "first")


def asked(client: httpx.Client, way: Way, headers: dict[str, str]) -> int:
    content = b"{}" if way.method == "POST" else None
    path = path_of(way) + ("?name=first.csv" if way.path == "/api/upload" else "")
    return client.request(way.method, path, headers=headers, content=content).status_code


def socket_opens(served: Served, headers: dict[str, str]) -> bool:
    """Whether a socket opens with those headers."""
    given = {name.lower(): value for name, value in headers.items()}
    origin = given.pop("origin", None)
    host = given.pop("host", None)
    # The name in the address is what Host says; the machine is ours all the same.
    address = f"ws://{host or f'127.0.0.1:{served.port}'}/ws"
    to = socket.create_connection(("127.0.0.1", served.port))
    try:
        with connect(address, sock=to, origin=origin, additional_headers=given, proxy=None):  # type: ignore[arg-type]
            return True
    except InvalidStatus as error:
        return error.response.status_code not in (403, 421)


def reached(served: Served, way: Way, headers: dict[str, str]) -> bool:
    if way.method == "WS":
        return socket_opens(served, headers)
    served.http.cookies.clear()
    return asked(served.http, way, headers) not in (401, 403, 415, 421)


def right(served: Served, way: Way) -> dict[str, str]:
    content = way.asks.body if way.asks.body != "none" else "application/json"
    return served.headers(served.session(), content)


def filled(headers: dict[str, str], served: Served) -> dict[str, str]:
    return {name: value.replace("{port}", str(served.port)) for name, value in headers.items()}


def test_the_table_is_all_that_there_is(served: Served) -> None:
    gate = app(served.panel)
    assert isinstance(gate, Gate)
    inner = gate._app
    assert isinstance(inner, Starlette)

    there = [(route.path, type(route)) for route in inner.routes if isinstance(route, Route | WebSocketRoute)]

    assert len(there) == len(inner.routes) == len(TABLE)
    assert there == [(way.path, WebSocketRoute if way.method == "WS" else Route) for way in TABLE]


def test_what_changes_something_asks_for_everything() -> None:
    for way in TABLE:
        if way.method not in ("GET", "WS") and way is not OPENS:
            assert way.asks.session
            assert way.asks.origin
            assert way.asks.token
            assert way.asks.body != "none"


@pytest.mark.parametrize("way", TABLE, ids=lambda way: f"{way.method} {way.path}")
def test_a_page_of_ours_gets_in(served: Served, way: Way) -> None:
    assert reached(served, way, right(served, way))


def test_nobody_from_elsewhere_reaches_any_route(served: Served) -> None:
    got_in = [
        (way.path, wrong)
        for way in TABLE
        for wrong, changes in {**FOREIGN, "rebinding": REBOUND}.items()
        if reached(served, way, {**right(served, way), **filled(changes, served)})
    ]

    assert got_in == []


def test_without_its_origin_nothing_is_changed_and_no_socket_opens(served: Served) -> None:
    for way in TABLE:
        if way.method in ("POST", "WS"):
            headers = right(served, way)
            del headers["origin"]
            assert not reached(served, way, headers), way


def wrong_cookies(served: Served) -> Iterator[dict[str, str]]:
    right = served.session()
    name = served.panel.door.cookie
    for value in ("", "wrong", right.cookie[:-1], right.cookie + "x", right.token):
        yield {"cookie": f"{name}={value}"}
    yield {"cookie": f"{name}={right.cookie}; {name}={right.cookie}"}
    yield {"cookie": name}
    yield {"cookie": f"servobench_session_{served.port + 1}={right.cookie}"}  # another panel's
    yield {"cookie": "=;;=,"}
    yield {"cookie": f"other={right.cookie}"}


def test_without_a_session_nobody_reaches_what_is_private(served: Served) -> None:
    got_in = []
    for way in PRIVATE:
        for changes in wrong_cookies(served):
            if reached(served, way, {**right(served, way), **changes}):
                got_in.append((way.path, changes))
        headers = right(served, way)
        del headers["cookie"]
        if reached(served, way, headers):
            got_in.append((way.path, {}))

    assert got_in == []


def test_a_cookie_alone_changes_nothing(served: Served) -> None:
    for way in POSTS:
        session = served.session()
        for token in (None, "", "wrong", session.cookie, served.session().token):
            headers = served.headers(session, way.asks.body)
            if token is None:
                del headers["x-servobench-token"]
            else:
                headers["x-servobench-token"] = token
            assert not reached(served, way, headers), (way, token)


def test_a_session_that_is_over_is_no_session(served: Served) -> None:
    for way in PRIVATE:
        headers = right(served, way)
        served.clock.now += SESSION_TIME + 1
        assert not reached(served, way, headers), way


def test_what_is_sent_has_to_say_what_it_is(served: Served) -> None:
    for way in POSTS:
        for content in ("text/plain", "application/x-www-form-urlencoded", "multipart/form-data", ""):
            headers = {**right(served, way), "content-type": content}
            assert not reached(served, way, headers), (way, content)


def test_a_viewer_changes_nothing_but_may_stop(served: Served) -> None:
    with served.client() as client:
        for way in POSTS:
            headers = served.headers(served.session("viewer"), way.asks.body)
            status = asked(client, way, headers)
            assert (status == 403) == (way.path not in VIEWERS), way


def test_a_link_opens_a_session_and_is_not_kept_in_the_bar(served: Served) -> None:
    with served.client() as client:
        answer = client.get(f"/?token={served.keys.new('operator')}")
        cookie = answer.headers["set-cookie"]

        assert answer.status_code == 303
        assert answer.headers["location"] == "/"
        assert "HttpOnly" in cookie
        assert "SameSite=strict" in cookie
        assert client.get("/").status_code == 200  # the cookie came along
        told = client.get("/api/session", headers={"sec-fetch-site": "same-origin"}).json()
        assert told["operator"] is True
        assert told["token"] not in cookie


@pytest.mark.parametrize("path", ["/", "/?token=wrong"])
def test_a_person_without_a_key_reads_a_page_and_a_program_an_error(served: Served, path: str) -> None:
    with served.client() as client:
        page = client.get(path, headers={"accept": "text/html,*/*"})
        assert page.status_code == 401
        assert page.headers["content-type"].startswith("text/html")
        assert "works once" in page.text
        assert "<form hidden" in page.text  # there is no code
        assert "REASON" not in page.text
        assert "default-src 'self'" in page.headers["content-security-policy"]
        program = client.get(path)
        assert program.status_code == 401
        assert program.json()["error"][1:] in page.text


def test_two_panels_of_one_host_do_not_log_each_other_out(served: Served, tmp_path: Path) -> None:
    """Cookies know no ports: a browser that is let in to both sends each both."""

    def lets_in(panel: Served) -> bool:
        answer = browser.get(f"{panel.origin}/api/session", headers={"sec-fetch-site": "same-origin"})
        return answer.status_code == 200

    with serving(tmp_path) as other, served.client() as browser:
        assert not lets_in(served)
        browser.get(f"{served.origin}/?token={served.keys.new('operator')}")
        assert (lets_in(served), lets_in(other)) == (True, False)
        browser.get(f"{other.origin}/?token={other.keys.new('operator')}")
        assert (lets_in(served), lets_in(other)) == (True, True)


@pytest.mark.parametrize("key", ["", "wrong", "%00", "%ed%a0%80", "x" * 4000])
def test_a_wrong_link_opens_nothing(served: Served, key: str) -> None:
    with served.client() as client:
        answer = client.get(f"/?token={key}")

    assert answer.status_code == 401
    assert "set-cookie" not in answer.headers


@pytest.mark.promise("S61")
def test_a_key_opens_by_its_own_carrier_until_it_expires_and_all_but_a_code_once() -> None:
    clock = Clock()
    keys = Keys(clock)
    carriers: tuple[Carrier, ...] = ("link", "local page", "code")
    for carrier in carriers:
        key = keys.new("operator", carrier)
        assert [keys.open(key, other) for other in carriers if other != carrier] == [None, None]
        assert keys.open(key, carrier) is not None
        assert (keys.open(key, carrier) is not None) == (carrier == "code")
        assert keys.is_spent(key) == (carrier != "code")

    for carrier, lasts in zip(carriers, (KEY_TIME, LOCAL_TIME, KEY_TIME), strict=True):
        for late in (-1.0, 0.0):
            key = keys.new("operator", carrier)
            clock.now += lasts + late
            assert (keys.open(key, carrier) is None) == (late == 0.0), carrier
    assert keys.open("") is None
    assert Keys(clock).open("") is None
    assert Keys(clock).session("") is None


def test_each_link_that_comes_in_time_or_late_is_followed_by_a_fresh_one() -> None:
    clock, printed = Clock(), []
    keys = Keys(clock, used=lambda carrier: printed.append((carrier, keys.new("operator"))))
    first, code = keys.new("operator"), keys.new("viewer", "code")

    assert keys.open(code, "code") is not None
    assert keys.open("wrong") is None
    assert printed == []
    assert keys.open(first) is not None
    assert keys.open(first) is None
    ((_, second),) = printed
    clock.now += KEY_TIME
    assert keys.open(second) is None  # nobody has used it, and there has to be another one all the same
    _, (carrier, third) = printed
    assert carrier == "link"
    assert keys.open(third) is not None


def test_a_code_is_typed_as_people_do_and_nobody_guesses_it() -> None:
    keys = Keys(Clock())
    code = keys.new("viewer", "code")

    assert re.fullmatch(r"[a-z2-9]{4}(-[a-z2-9]{4}){2}", code)
    for typed in (code, f" {code.upper()}\n", code.replace("-", ""), code.replace("-", " ")):
        session = keys.open(typed, "code")
        assert session is not None
        assert session.role == "viewer"
    assert keys.open(code[:-1], "code") is None
    assert keys.open("", "code") is None
    # 31 signs that don't look alike; a guess in 2^59 isn't made in twelve hours, at 10,000 per second 2^29 of them.
    assert len({sign for _ in range(200) for sign in keys.new("viewer", "code")} - {"-"}) == 31


FROM_FILE = {"origin": "null", "sec-fetch-site": "cross-site"}
"""A browser's headers for a form in a page of the file system, by Fetch and by Fetch Metadata."""


def brought(served: Served, key: str, **changes: str) -> httpx.Response:
    """The answer to a form with a key, as a page of ours sends it but for the changes."""
    headers = {"origin": served.origin, "sec-fetch-site": "same-origin", "accept": "text/html", **changes}
    with served.client() as client:
        return client.post("/open", data={"token": key}, headers={n: v for n, v in headers.items() if v})


def lets_in(answer: httpx.Response) -> bool:
    return answer.status_code == 200 and "set-cookie" in answer.headers


def test_a_local_page_opens_a_session_once_and_goes_on_by_itself(served: Served) -> None:
    key = served.keys.new("operator", "local page")
    wrong = brought(served, "wrong", **FROM_FILE)
    answer = brought(served, key, **FROM_FILE)
    again = brought(served, key, **FROM_FILE)

    assert (wrong.status_code, "set-cookie" in wrong.headers) == (401, False)
    assert lets_in(answer)
    assert 'http-equiv="refresh" content="0; url=/"' in answer.text
    assert "SameSite=strict" in answer.headers["set-cookie"]
    assert (again.status_code, "set-cookie" in again.headers) == (401, False)
    assert "link in the panel&#x27;s terminal" in again.text


@pytest.mark.promise("S61")
def test_a_key_in_a_form_is_taken_from_the_pages_that_may_send_it_only(served: Served) -> None:
    page, code = served.keys.new("operator", "local page"), served.keys.new("viewer", "code")
    port = {"origin": f"http://127.0.0.1:{served.port + 1}"}
    wrong = {
        "another page": {"origin": "http://evil.test", "sec-fetch-site": "cross-site"},
        "another port": {**port, "sec-fetch-site": "same-site"},
        "another port, whatever the browser says": port,
        "no origin": {"origin": ""},
        "no origin, from elsewhere": {"origin": "", "sec-fetch-site": "cross-site"},
        "a page of ours without origin": {"origin": "null"},
        "a page of this site without origin": {"origin": "null", "sec-fetch-site": "same-site"},
        "ours, from elsewhere": {"sec-fetch-site": "cross-site"},
        "a rebound name": {**FROM_FILE, "host": f"evil.test:{served.port}"},
        "another kind of body": {**FROM_FILE, "content-type": "text/plain"},
    }
    for what, changes in wrong.items():
        for key in (page, code):
            answer = brought(served, key, **changes)
            assert answer.status_code in (403, 415, 421), what
            assert "set-cookie" not in answer.headers, what
    # A page in a sandbox has no origin either: who knows the code mustn't give others a viewer's session in place of their own.
    assert not lets_in(brought(served, code, **FROM_FILE))
    assert not lets_in(brought(served, page))
    assert lets_in(brought(served, page, **FROM_FILE))  # nothing of that has used it up
    # Browsers say no site over http to another machine.
    assert lets_in(brought(served, code, **{"sec-fetch-site": ""}))
    other = served.keys.new("operator", "local page")
    assert lets_in(brought(served, other, **{"origin": "null", "sec-fetch-site": ""}))


@pytest.mark.parametrize(
    "body", [b"", b"token=", b"token=a&token=b", b"{}", b"\xff\xfe", b"token=" + b"x" * 5000]
)
def test_a_form_without_one_right_key_opens_nothing(served: Served, body: bytes) -> None:
    headers = {**FROM_FILE, "content-type": "application/x-www-form-urlencoded"}
    with served.client() as client:
        answer = client.post("/open", content=body, headers=headers)

    assert answer.status_code in (400, 401, 413)
    assert "set-cookie" not in answer.headers


def test_the_page_for_who_is_not_let_in_takes_a_code_where_there_is_one(tmp_path: Path) -> None:
    with serving(tmp_path) as panel, panel.client() as client:
        code = panel.keys.new("viewer", "code")
        page = client.get("/", headers={"accept": "text/html"})
        assert '<form method="post" action="/open">' in page.text
        assert "form-action 'self'" in page.headers["content-security-policy"]
        assert page.headers["referrer-policy"] == "same-origin"  # or its form has no origin
        assert client.get(f"/?token={code}").status_code == 401  # no address has it
        wrong = brought(panel, "wrong")
        assert (wrong.status_code, "This code is wrong" in wrong.text) == (401, True)
        assert all(lets_in(brought(panel, code)) for _ in range(3))


@pytest.mark.parametrize(
    ("method", "headers"),
    [("HEAD", {}), ("GET", {"sec-purpose": "prefetch;prerender"}), ("GET", {"purpose": "prefetch"})],
)
def test_what_only_looks_ahead_does_not_use_a_link_up(
    served: Served, method: str, headers: dict[str, str]
) -> None:
    key = served.keys.new("operator")
    with served.client() as client:
        assert client.request(method, f"/?token={key}", headers=headers).status_code == 403
        assert client.get(f"/?token={key}").status_code == 303


def test_a_used_link_says_what_to_do_and_leads_the_browser_that_used_it_back(served: Served) -> None:
    key = served.keys.new("operator")
    with served.client() as browser, served.client() as other:
        assert browser.get(f"/?token={key}").status_code == 303
        assert "set-cookie" not in (back := browser.get(f"/?token={key}")).headers
        assert (back.status_code, back.headers["location"]) == (303, "/")
        refused = other.get(f"/?token={key}", headers={"accept": "text/html"})
        assert refused.status_code == 401
        assert "there is a new one in the panel&#x27;s terminal" in refused.text
        watching = served.headers(served.session("viewer"))
        assert other.get(f"/?token={key}", headers={"cookie": watching["cookie"]}).status_code == 401


def told(answer: httpx.Response) -> str:
    """The sentence of a refusal, which is all that there is in it."""
    assert answer.headers["content-type"] == "application/json"
    (sentence,) = answer.json().values()
    assert list(answer.json()) == ["error"]
    return str(sentence)


@pytest.mark.parametrize("way", HTTP, ids=lambda way: f"{way.method} {way.path}")
def test_whatever_a_route_refuses_is_a_sentence_in_json(served: Served, way: Way) -> None:
    other = "DELETE" if way.method == "GET" else "GET"
    wrong = {
        421: {"host": f"evil.test:{served.port}"},
        403: {"origin": "http://evil.test"},
        **({401: {"cookie": ""}} if way.asks.session else {}),
        **({415: {"content-type": "text/plain"}} if way.asks.body != "none" else {}),
    }
    for status, changes in wrong.items():
        answer = served.http.request(way.method, path_of(way), headers={**right(served, way), **changes})
        assert (answer.status_code, bool(told(answer))) == (status, True), changes
    answer = served.http.request(other, path_of(way), headers=right(served, way))
    if answer.status_code == 405:  # some paths have both
        assert other in told(answer)
        assert way.method in answer.headers["allow"]


@pytest.mark.parametrize("path", ["/nowhere", "/api/nowhere", "/api/recordings/", "/ws", "/static/a/b"])
def test_a_path_that_there_is_not_is_reported_as_json(served: Served, path: str) -> None:
    answer = served.http.get(path)

    assert answer.status_code == 404
    assert path in told(answer)


def test_a_mistake_of_the_panel_itself_is_reported_as_json(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken() -> None:
        raise ZeroDivisionError("a secret")

    monkeypatch.setattr(served.panel.library, "list", broken)
    answer = served.http.get("/api/recordings", headers=served.headers(served.session()))

    assert answer.status_code == 500
    assert "terminal" in told(answer)
    assert "secret" not in answer.text


def test_every_answer_says_what_a_page_may_do(served: Served) -> None:
    with served.client() as client:
        answers = [
            client.request(way.method, path_of(way), headers={"host": host})
            for way in HTTP
            for host in (f"127.0.0.1:{served.port}", "evil.test")
        ]
        answers.append(client.get("/nowhere"))

    for answer in answers:
        policy = answer.headers["content-security-policy"]
        assert "default-src 'self'" in policy
        assert "frame-ancestors 'none'" in policy
        assert "unsafe" not in policy
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["cache-control"] == "no-store"
        assert "server" not in answer.headers
        assert not [name for name in answer.headers if name.startswith("access-control")]


def test_no_page_of_ours_has_script_or_style_in_it(served: Served) -> None:
    session = served.session()
    with served.client() as client:
        page = client.get("/", headers=served.headers(session)).text

    assert not re.search(r"<style|\sstyle=|\son\w+=|javascript:", page, re.IGNORECASE)
    assert all("src=" in tag for tag in re.findall(r"<script[^>]*>", page, re.IGNORECASE))
