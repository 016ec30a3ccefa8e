"""The server: the application made from the table of routes, and how it is run."""

from __future__ import annotations

import signal
import socket
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from threading import current_thread, main_thread
from types import FrameType
from typing import Literal

import uvicorn
from starlette.applications import Starlette
from starlette.types import ASGIApp
from uvicorn.server import HANDLED_SIGNALS

from servobench.core.errors import DeviceError, UsageError
from servobench.panel import half_open
from servobench.panel.catalogue import catalogue
from servobench.panel.gate import Door, Gate, not_so, nowhere, respond_with_failure
from servobench.panel.keys import Keys
from servobench.panel.pages import Panel
from servobench.panel.routes import routes
from servobench.recordings.measurement.base import STAGES
from servobench.rig.loop.requests import requests_here

PORT = 8765
PING_INTERVAL = 0.4  # s
PING_TIMEOUT = 0.5  # s; a page that doesn't answer for both together is gone
LARGEST_MESSAGE = 64 * 1024  # bytes, on a socket
_END_TIME = 2  # s that open pages have when the server ends


@dataclass(frozen=True, kw_only=True)
class Tls:
    """The files of a certificate and its key."""

    certificate: Path
    key: Path


def app(panel: Panel) -> ASGIApp:
    """Return the app; its lifespan opens the device and ends its loop; then `MotorSession.last_word` says what is known."""

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        panel.library.prepare()
        load()
        await panel.motor.begin()
        try:
            yield
        finally:
            await panel.motor.close()

    inner = Starlette(
        routes=routes(panel, panel.door),
        lifespan=lifespan,
        exception_handlers={405: not_so, Exception: respond_with_failure},
    )
    inner.router.redirect_slashes = False
    inner.router.default = nowhere
    inner.state.exercises = panel.exercises
    return Gate(inner, panel.door)


def load() -> None:
    """Load what is loaded when it is first requested, before a page comes that would have to wait for it.

    Those are the members of the kinds that can be chosen, and what compiles: while its library is loaded no thread goes on.
    """
    catalogue()
    for name in STAGES.names():
        STAGES[name]
    import_module("servobench.rig.loop.kernels")
    import_module("servobench.recordings.measurement.kernels")


def door_for(hosts: Sequence[str], port: int, scheme: Literal["http", "https"], keys: Keys) -> Door:
    """Return what is let in: these hosts, with the port as browsers write it."""
    usual = {"http": 80, "https": 443}[scheme]
    names = {_bracket(host).lower() for host in hosts}
    return Door(
        hosts=frozenset({f"{name}:{port}" for name in names} | (names if port == usual else set())),
        port=port,
        scheme=scheme,
        keys=keys,
    )


def listen(host: str, port: int | None) -> socket.socket:
    """Return a socket that listens there; without a port at the usual one, or any that is free.

    Raises `UsageError` where that can't be.
    """
    for wanted in (port,) if port is not None else (PORT, 0):
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        # The protocol is said, as asyncio sends small pieces at once on sockets only that are of TCP by their own word.
        listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        try:
            if socket.has_dualstack_ipv6() and family == socket.AF_INET6:
                listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            if sys.platform != "win32":
                # The port of a panel that was killed is free at once; on Windows the option would share one that is in use.
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind((host, wanted))
            listener.listen(128)
            return listener
        except OSError as error:
            listener.close()
            reason = error.strerror or str(error)
    raise UsageError(
        f"the panel can't listen on {host}, port {port}: {reason}; give another `port=...`, or `port=0` for any"
    )


def settings(served: ASGIApp, tls: Tls | None) -> uvicorn.Config:
    """Return how an app of ours is served."""
    return uvicorn.Config(
        served,
        loop="auto",  # uvloop where it is installed: a tenth less of the processor
        log_level="warning",
        access_log=False,  # an address with a token must not be logged
        server_header=False,
        lifespan="on",
        http=half_open.protocol(),
        ws="websockets-sansio",
        ws_max_size=LARGEST_MESSAGE,
        ws_ping_interval=PING_INTERVAL,
        ws_ping_timeout=PING_TIMEOUT,
        ws_per_message_deflate=False,
        timeout_graceful_shutdown=_END_TIME,
        proxy_headers=False,
        limit_concurrency=200,
        ssl_certfile=None if tls is None else str(tls.certificate),
        ssl_keyfile=None if tls is None else str(tls.key),
    )


def run(
    panel: Panel,
    listener: socket.socket,
    tls: Tls | None,
    begun: Callable[[], None],
    ended: Callable[[], None] = lambda: None,
) -> None:
    """Serve until Ctrl-C or a request to end, such as SIGTERM; `begun` is called once pages can be loaded, `ended` when none can.

    The motor is at rest when this ends, or it raises `DeviceError`, which says what is known of the motor. Ctrl-C then ends it by
    `KeyboardInterrupt`, and SIGTERM the process.
    """
    server = _Server(settings(app(panel), tls), begun, panel.motor.close)
    before = {}
    if current_thread() is main_thread():
        for request in {*HANDLED_SIGNALS, *requests_here()}:
            if signal.getsignal(request) in (
                signal.SIG_DFL,
                signal.default_int_handler,
            ):  # nohup's stays ignored
                before[request] = signal.signal(request, server.handle_exit)
    try:
        server.run(sockets=[listener])
    finally:
        ended()
    if panel.motor.danger:
        raise DeviceError(panel.motor.danger)
    for request in HANDLED_SIGNALS:
        if request in before:
            signal.signal(request, before[request])
            if request in server.requests:
                signal.raise_signal(request)


class _Server(uvicorn.Server):
    """Uvicorn's server, which says when it has begun, and ends by `close` first: the motor before the pages.

    `requests` are the signals that asked it to end.
    """

    def __init__(
        self, config: uvicorn.Config, begun: Callable[[], None], close: Callable[[], Awaitable[None]]
    ) -> None:
        super().__init__(config)
        self._begun = begun
        self._close = close
        self.requests: set[int] = set()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        self.requests.add(sig)
        super().handle_exit(sig, frame)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        try:
            await self._close()  # also where a second Ctrl-C leaves out the rest
        finally:
            await super().shutdown(sockets=sockets)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets=sockets)
        if self.started:
            self._begun()


def _bracket(host: str) -> str:
    return f"[{host}]" if ":" in host else host
