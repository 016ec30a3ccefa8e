"""A page that goes away before it was let in: there is nobody to answer, and nothing to be told of it."""

import asyncio
from typing import Any, cast

import pytest
from starlette.types import Message
from starlette.websockets import WebSocket

from servobench.panel.keys import Session
from servobench.panel.session import MotorSession
from servobench.panel.socket import converse


@pytest.mark.parametrize("goes_at", ["websocket.accept", "websocket.close"])
def test_a_page_that_is_gone_before_it_was_let_in_is_no_error(goes_at: str) -> None:
    sent: list[str] = []
    to_come = iter(["websocket.connect", "websocket.disconnect"])

    async def receive() -> Message:
        return {"type": next(to_come), "code": 1006}

    async def send(message: Message) -> None:
        sent.append(message["type"])
        if message["type"] == goes_at:
            raise OSError("the other side is gone")  # what a server raises then

    socket = WebSocket({"type": "websocket", "path": "/", "headers": []}, receive, send)

    # Neither is asked for anything before the first message, which never comes.
    asyncio.run(converse(socket, cast(Session, None), cast(MotorSession, cast(Any, None))))

    assert sent[-1] == goes_at
