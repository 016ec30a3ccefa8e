"""The server: the app that the table of routes makes, and how it is run."""

from __future__ import annotations

import socket
import sys
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Literal

import uvicorn
from starlette.applications import Starlette
from starlette.types import ASGIApp

from servobench.errors import UsageError
from servobench.measurement.base import STAGES
from servobench.panel.catalogue import catalogue
from servobench.panel.gate import Door, Gate, broken, not_so, nowhere
from servobench.panel.keys import Keys
from servobench.panel.pages import Panel
from servobench.panel.routes import routes

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
    """Return the app; its lifespan opens the device and leaves the motor at rest."""

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
        exception_handlers={405: not_so, Exception: broken},
    )
    inner.router.redirect_slashes = False
    inner.router.default = nowhere
    inner.state.exercises = panel.exercises
    return Gate(inner, panel.door)


def load() -> None:
    """Load what is loaded when it is first asked for, before a page comes that would have to wait for it.

    Those are the members of the kinds that can be chosen, and what compiles: while its library is loaded no thread goes on.
    """
    catalogue()
    for name in STAGES.names():
        STAGES[name]
    import_module("servobench.loop.kernels")
    import_module("servobench.measurement.kernels")


def door_for(hosts: Sequence[str], port: int, scheme: Literal["http", "https"], keys: Keys) -> Door:
    """Return what is let in: these hosts, with the port as browsers write it."""
    usual = {"http": 80, "https": 443}[scheme]
    names = {_bracketed(host).lower() for host in hosts}
    return Door(
        hosts=frozenset({f"{name}:{port}" for name in names} | (names if port == usual else set())),
        port=port,
        scheme=scheme,
        keys=keys,
    )


def listening(host: str, port: int | None) -> socket.socket:
    """Return a socket that listens there; without a port at the usual one, or any that is free.

    Raises `UsageError` where that can't be.
    """
    for wanted in (port,) if port is not None else (PORT, 0):
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        # The protocol is said, as asyncio sends small pieces at once on sockets only that are of TCP by their own word.
        found = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
        try:
            if socket.has_dualstack_ipv6() and family == socket.AF_INET6:
                found.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            if sys.platform != "win32":
                # The port of a panel that was killed is free at once; on Windows the option would share one that is in use.
                found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            found.bind((host, wanted))
            found.listen(128)
            return found
        except OSError as error:
            found.close()
            reason = error.strerror or str(error)
    raise UsageError(
        f"the panel can't listen at {host}, port {port}: {reason}; give another --port, or --port 0 for any"
    )


def settings(served: ASGIApp, tls: Tls | None) -> uvicorn.Config:
    """Return how an app of ours is served."""
    return uvicorn.Config(
        served,
        loop="auto",  # uvloop where it is installed: a tenth less of the processor
        log_level="warning",
        access_log=False,  # an address with a token is nobody's to read
        server_header=False,
        lifespan="on",
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


def run(panel: Panel, listener: socket.socket, tls: Tls | None, begun: Callable[[], None]) -> None:
    """Serve until Ctrl-C or SIGTERM; `begun` is called once pages can be loaded. The motor is at rest when this returns."""
    _Server(settings(app(panel), tls), begun).run(sockets=[listener])


class _Server(uvicorn.Server):
    """Uvicorn's server, which says when it has begun."""

    def __init__(self, config: uvicorn.Config, begun: Callable[[], None]) -> None:
        super().__init__(config)
        self._begun = begun

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets=sockets)
        if self.started:
            self._begun()


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host
