"""Connections that ask for nothing keep nobody out."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from servobench.panel import half_open
from tests.panel.conftest import Served, serving


@pytest.fixture
def panel(tmp_path: Path) -> Iterator[Served]:
    with serving(tmp_path) as found:
        yield found


@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\nHost: "], ids=["nothing", "half a request"])
def test_250_connections_that_ask_for_nothing_lock_nobody_out(panel: Served, said: bytes) -> None:
    session = panel.session()
    with ExitStack() as stack:
        for _ in range(250):
            each = stack.enter_context(socket.create_connection(("127.0.0.1", panel.port)))
            each.sendall(said)

        with panel.client() as client:
            for _ in range(3):
                assert client.get("/", headers=panel.headers(session)).status_code == 200


def test_a_request_that_never_comes_is_not_waited_for_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(half_open, "PATIENCE", 0.2)
    with serving(tmp_path) as panel, socket.create_connection(("127.0.0.1", panel.port)) as waiting:
        waiting.settimeout(30)
        waiting.sendall(b"GET / HTTP/1.1\r\n")

        assert waiting.recv(1) == b""  # closed
