"""Idle connections: their number is limited, so they can't block others."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Any

from uvicorn.protocols.http.auto import AutoHTTPProtocol

MOST = 64
"""That many connections may wait before their first request is there; the oldest goes. A browser has six, for milliseconds."""
PATIENCE = 10.0  # s for a first request


def protocol() -> type[asyncio.Protocol]:
    """Return uvicorn's protocol of HTTP, which gives up connections that ask for nothing, for one server."""
    waiting: deque[Any] = deque()

    class FirstRequest(AutoHTTPProtocol):  # type: ignore[misc, valid-type]
        """Waits for a first request, for a limited time and with a limited number of others."""

        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            waiting.append(self)
            self._given_up = self.loop.call_later(PATIENCE, transport.close)
            if len(waiting) > MOST:
                waiting.popleft().transport.abort()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            if self.cycle is not None or self not in self.connections:  # a request is there, or a socket
                self._stop_waiting()

        def connection_lost(self, exc: Exception | None) -> None:
            self._stop_waiting()
            super().connection_lost(exc)

        def _stop_waiting(self) -> None:
            self._given_up.cancel()
            if self in waiting:
                waiting.remove(self)

    return FirstRequest
