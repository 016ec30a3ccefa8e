"""The table of all routes, each with the access that it needs. The server is made from this table alone."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.types import Receive, Scope, Send
from starlette.websockets import WebSocket

from servobench.core.errors import DeviceError, ServobenchError, StorageError, UnknownName
from servobench.panel import pages, recordings
from servobench.panel.bodies import BodyReceiver
from servobench.panel.field_names import with_fields
from servobench.panel.gate import Asks, Door, Refused, error_answer, refuse
from servobench.panel.jobs import JobEnded
from servobench.panel.lease import Refusal
from servobench.panel.pages import Panel
from servobench.panel.socket import converse

Answers = Callable[[Request, Panel], Awaitable[Response]]

ANYBODY = Asks(session=False)
BRINGS_KEY = Asks(session=False, origin=True, local_page=True, body="application/x-www-form-urlencoded")
READS = Asks()
OWN_PAGE = Asks(own_page=True)
SAYS = Asks(origin=True, token=True, body="application/json")
CHANGES = Asks(origin=True, token=True, operates=True, body="application/json")
UPLOADS = Asks(origin=True, token=True, operates=True, body="application/octet-stream")
SOCKET = Asks(origin=True)  # and the token in its first message


@dataclass(frozen=True, kw_only=True)
class Way:
    """One way in: the method (`WS` for the socket), the path, what it asks for, and what answers."""

    method: str
    path: str
    asks: Asks
    answer: Answers | None = None


TABLE = (
    Way(method="GET", path="/", asks=ANYBODY, answer=pages.front),
    Way(method="POST", path="/open", asks=BRINGS_KEY, answer=pages.open_with_key),
    Way(method="GET", path="/static/{name}", asks=ANYBODY, answer=pages.static),
    Way(method="GET", path="/uplot/{name}", asks=ANYBODY, answer=pages.uplot),
    Way(method="GET", path="/api/session", asks=OWN_PAGE, answer=pages.session),
    Way(method="GET", path="/api/catalogue", asks=READS, answer=pages.catalogue),
    Way(method="POST", path="/api/preview", asks=SAYS, answer=pages.preview),
    Way(method="POST", path="/api/stop", asks=SAYS, answer=pages.stop),
    Way(method="GET", path="/api/recordings", asks=READS, answer=recordings.list_all),
    Way(method="POST", path="/api/recordings/{name}/notes", asks=CHANGES, answer=recordings.save_notes),
    Way(method="POST", path="/api/recordings/{name}/delete", asks=CHANGES, answer=recordings.delete),
    Way(method="POST", path="/api/recordings/{name}/undelete", asks=CHANGES, answer=recordings.undelete),
    Way(method="GET", path="/api/recordings/{name}/download", asks=READS, answer=recordings.download),
    Way(method="GET", path="/api/recordings/{name}/rows", asks=READS, answer=recordings.rows),
    Way(method="POST", path="/api/recordings/{name}/identify", asks=CHANGES, answer=recordings.identify_one),
    Way(
        method="POST",
        path="/api/recordings/{name}/identify/end",
        asks=CHANGES,
        answer=recordings.identification_ended,
    ),
    Way(method="GET", path="/api/recordings/{name}/result", asks=READS, answer=recordings.result),
    Way(method="GET", path="/api/recordings/{name}/columns", asks=READS, answer=recordings.columns),
    Way(method="POST", path="/api/recordings/{name}/columns", asks=CHANGES, answer=recordings.columns_said),
    Way(method="GET", path="/reports/{name}", asks=READS, answer=recordings.report),
    Way(method="POST", path="/api/upload", asks=UPLOADS, answer=recordings.upload),
    Way(method="GET", path="/api/diagram", asks=READS, answer=pages.block_diagram),
    Way(method="GET", path="/api/exercises", asks=READS, answer=pages.exercise_list),
    Way(method="GET", path="/api/exercises/{name}", asks=READS, answer=pages.exercise),
    Way(method="GET", path="/api/exercises/{name}/results", asks=READS, answer=pages.exercise_results),
    Way(method="POST", path="/api/exercises/{name}/check", asks=SAYS, answer=pages.exercise_checked),
    Way(method="WS", path="/ws", asks=SOCKET),
)


def routes(panel: Panel, door: Door, table: tuple[Way, ...] = TABLE) -> list[BaseRoute]:
    """Return the server's routes: each of the table behind what it asks for."""
    return [_route(way, panel, door) for way in table]


def _route(way: Way, panel: Panel, door: Door) -> BaseRoute:
    if way.answer is None:
        return WebSocketRoute(way.path, _Socket(way.asks, panel, door))
    return Route(way.path, _Endpoint(way.asks, way.answer, panel, door), methods=[way.method])


class _Endpoint:
    """Answers requests that bring what is requested; what goes wrong is a sentence."""

    def __init__(self, asks: Asks, answer: Answers, panel: Panel, door: Door) -> None:
        self._asks = asks
        self._answer = answer
        self._panel = panel
        self._door = door

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        heard = BodyReceiver(receive)
        try:
            scope.setdefault("state", {})["session"] = self._door.admit(Headers(scope=scope), self._asks)
            response = await self._answer(Request(scope, heard), self._panel)
        except Refused as refused:
            response = error_answer(refused)
        except ServobenchError as error:
            response = error_answer(
                Refused(_status(error), with_fields(self._panel.library.with_names(str(error))))
            )
        except RecursionError:
            response = error_answer(Refused(400, "its lists or objects are nested too deeply"))
        if not heard.over:
            await heard.let_pass()
        if not heard.over:
            response.headers["connection"] = "close"
        await response(scope, receive, send)


class _Socket:
    """The socket, behind what it asks for."""

    def __init__(self, asks: Asks, panel: Panel, door: Door) -> None:
        self._asks = asks
        self._panel = panel
        self._door = door

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        try:
            session = self._door.admit(Headers(scope=scope), self._asks)
            if session is None:
                raise Refused(401, "no session")
        except Refused as refused:
            await refuse(refused, scope, receive, send)
            return
        await converse(WebSocket(scope, receive, send), session, self._panel.motor)


def _status(error: ServobenchError) -> int:
    """The status that an error of ours is answered with."""
    for kind, status in (
        (Refusal, 409),
        (JobEnded, 409),
        (UnknownName, 404),
        (StorageError, 507),
        (DeviceError, 409),
    ):
        if isinstance(error, kind):
            return status
    return 400
