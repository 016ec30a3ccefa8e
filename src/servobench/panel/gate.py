"""Access control: the origin and the token of each request are checked before anything else sees it.

Any page that a browser has open can send requests to a port of the same machine, with our cookie where it is on another port of
it, and a name that it owns can be made to mean this machine. So the name that was requested (Host), the page that asks (Origin,
Sec-Fetch-Site) and a token that no other page can read have to be right, each by itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from servobench.panel.keys import Keys, Session, same

TOKEN = "x-servobench-token"

FORM = "application/x-www-form-urlencoded"
NO_ORIGIN = "null"  # what browsers say of a page from the file system, or in a sandbox

Body: TypeAlias = Literal[
    "none", "application/json", "application/octet-stream", "application/x-www-form-urlencoded"
]


@dataclass(frozen=True, kw_only=True)
class Asks:
    """The requirements of a route, beside the right host and no foreign page behind the request, which all have.

    `session`: the session's cookie. `own_page`: that a page of ours asks, as the browser says itself. `origin`: that the page's
    origin is said and is ours. `local_page`: that a page from the file system may ask as well, whose origin is null. `token`: the
    session's token in the header X-Servobench-Token. `operates`: that the session isn't a viewer's. `body`: what comes with it.
    """

    session: bool = True
    own_page: bool = False
    origin: bool = False
    local_page: bool = False
    token: bool = False
    operates: bool = False
    body: Body = "none"


class Refused(Exception):
    """A request that isn't let in, or asks for what can't be; the status and the sentence that answer it."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status
        self.sentence = sentence


@dataclass(frozen=True, kw_only=True)
class Door:
    """Accepted requests: the hosts, names by which this server may be asked for with the port as browsers send it, and the keys.

    `scheme` is how browsers have to reach it.
    """

    hosts: frozenset[str]
    port: int
    scheme: Literal["http", "https"]
    keys: Keys

    @property
    def cookie(self) -> str:
        """The name of the session's cookie: browsers send those of one port to all others of a host, where each has its own."""
        return f"servobench_session_{self.port}"

    def check_host(self, headers: Headers) -> None:
        """Raise `Refused` for a name that isn't ours, such as one that was made to mean this machine."""
        names = headers.getlist("host")
        if len(names) != 1 or names[0].lower() not in self.hosts:
            raise Refused(
                421,
                f"this panel isn't called {', '.join(names) or 'by no name'}; it is at {', '.join(sorted(self.hosts))}",
            )

    def admit(self, headers: Headers, asks: Asks) -> Session | None:
        """Return the session of a request whose host is right, None where none is requested; raises `Refused`."""
        self._check_page(headers, asks)
        if asks.body != "none" and headers.get("content-type", "").partition(";")[0].strip() != asks.body:
            raise Refused(415, f"the request's body must be {asks.body}, with that Content-Type")
        if not asks.session:
            return None
        session = self.session(headers)
        if session is None:
            raise Refused(401, "no session: open the last link that the panel printed in its terminal")
        if asks.token and not same(session.token, headers.get(TOKEN, "")):
            raise Refused(401, "the session's token is missing or wrong: load the page again")
        if asks.operates and session.role != "operator":
            raise Refused(403, "this session may watch, and stop the motor; it can't do this")
        return session

    def session(self, headers: Headers) -> Session | None:
        """Return the session that a request's cookie names; None where there is none."""
        return self.keys.session(_cookie(headers, self.cookie))

    def _check_page(self, headers: Headers, asks: Asks) -> None:
        """Raise `Refused` where another page than ours asks."""
        site = headers.get("sec-fetch-site")
        if asks.local_page and headers.getlist("origin") == [NO_ORIGIN] and site in ("cross-site", None):
            return
        allowed = ("same-origin",) if asks.own_page else ("same-origin", "none", None)
        if site not in allowed:
            raise Refused(
                403, f"only a page of this panel may request this, and the browser reports {site!r}"
            )
        origins = headers.getlist("origin")
        ours = f"{self.scheme}://{headers['host'].lower()}"
        if (asks.origin and not origins) or any(origin.lower() != ours for origin in origins):
            raise Refused(
                403, f"the page of {', '.join(origins) or 'no origin'} can't request this; {ours} can"
            )


def _cookie(headers: Headers, cookie: str) -> str:
    """The cookie with a name; empty where there is none, or more than one, of which one isn't ours."""
    pairs = [pair.strip().partition("=") for line in headers.getlist("cookie") for pair in line.split(";")]
    values = [value for name, _, value in pairs if name == cookie]
    return values[0] if len(values) == 1 else ""


def page_policy(door: Door, form_action: Literal["'none'", "'self'"] = "'none'") -> str:
    """Return the content security policy of the panel's pages: nothing that isn't ours, no script or style in the page.

    `form_action` says where a form may be sent to.
    """
    ws = "wss" if door.scheme == "https" else "ws"
    sockets = " ".join(f"{ws}://{host}" for host in sorted(door.hosts))
    return (
        f"default-src 'self'; connect-src 'self' {sockets}; img-src 'self' data: blob:; object-src 'none'; "
        f"base-uri 'none'; form-action {form_action}; frame-ancestors 'none'"
    )


REPORT_POLICY = (
    "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
"""A report is a page by itself, with its style in it: it may do nothing at all."""


class Gate:
    """The outermost part of the server: asks for the host, of sockets as well, and puts the headers on every answer."""

    def __init__(self, app: ASGIApp, door: Door) -> None:
        self._app = app
        self._door = door
        self._headers = tuple(
            (name.encode(), value.encode())
            for name, value in (
                ("content-security-policy", page_policy(door)),
                ("referrer-policy", "no-referrer"),
                ("x-content-type-options", "nosniff"),
                ("cross-origin-opener-policy", "same-origin"),
                ("cross-origin-resource-policy", "same-origin"),
                ("cache-control", "no-store"),
            )
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request in, or refuse it."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] in ("http.response.start", "websocket.http.response.start"):
                message["headers"] = [*_without(message["headers"], self._headers), *message["headers"]]
            await send(message)

        try:
            self._door.check_host(Headers(scope=scope))
        except Refused as refused:
            await refuse(refused, scope, receive, with_headers)
            return
        await self._app(scope, receive, with_headers)


def _without(
    headers: Iterable[tuple[bytes, bytes]], ours: tuple[tuple[bytes, bytes], ...]
) -> list[tuple[bytes, bytes]]:
    """Our headers, without those that an answer has of its own."""
    own = {name.lower() for name, _ in headers}
    return [(name, value) for name, value in ours if name not in own]


async def refuse(refused: Refused, scope: Scope, receive: Receive, send: Send) -> None:
    """Answer a request that isn't let in; a socket is closed before it is open: a 403 without a word, as no page can read one.

    (The answer in its place that ASGI has for that is told by uvicorn 0.54 as an error in the terminal, each time.)
    """
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 4403, "reason": refused.sentence[:100]})
        return
    await error_answer(refused)(scope, receive, send)


def error_answer(refused: Refused, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """Return the answer to a request that is refused: one shape for all, `{"error": sentence}`."""
    return JSONResponse({"error": refused.sentence}, status_code=refused.status, headers=headers)


async def nowhere(scope: Scope, receive: Receive, send: Send) -> None:
    """Answer a request for a path that isn't in the table of routes."""
    await refuse(
        Refused(404, f"there is nothing at {scope['path'][:80]} in this panel"), scope, receive, send
    )


async def not_so(request: Request, error: Exception) -> Response:
    """Answer a request whose method its path doesn't have."""
    headers = error.headers if isinstance(error, HTTPException) else None
    known = (headers or {}).get("Allow", "another method")
    sentence = f"{request.method[:20]} isn't possible for {request.url.path[:80]}; expected {known}"
    return error_answer(Refused(405, sentence), headers)


async def respond_with_failure(request: Request, error: Exception) -> Response:
    """Answer a request at which the panel has a mistake of its own; the server writes it to the terminal after that."""
    return error_answer(Refused(500, "the panel has an internal error, not caused by you; see its terminal"))
