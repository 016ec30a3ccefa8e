"""The web socket of a page: its requests, and the messages to it."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from servobench.core.errors import ServobenchError, UsageError
from servobench.panel.bodies import parse_object
from servobench.panel.commands import command_from, experiment_from
from servobench.panel.field_names import with_fields
from servobench.panel.gate import Refused
from servobench.panel.keys import Session, same
from servobench.panel.session import MotorSession
from servobench.panel.viewers import Viewer

HELLO_TIME = 5.0  # s in which the first message, with the token, has to come
NO_TOKEN = 4401  # the code that a socket without the right token is closed with
FELL_BEHIND = 4408

Said = Mapping[str, Any]
Answer = dict[str, Any]
UNANSWERED = ("beat", "hidden")
"""The page's own status, ten times a second or as it is hidden; it gets no answer."""


async def converse(socket: WebSocket, session: Session, motor: MotorSession) -> None:
    """Serve one page until its socket is closed; the motor is at zero volts then, if it was the operator's."""
    # A page may be gone at any time, even before it was admitted; then there is nothing to answer.
    try:
        await socket.accept()
    except OSError:  # only an open socket tells it as WebSocketDisconnect
        return
    if not await _hello(socket, session):
        with suppress(WebSocketDisconnect, RuntimeError):
            await socket.close(NO_TOKEN, "the first message must be a hello with the session's token")
        return
    viewer = Viewer(session.role)
    motor.join(viewer)
    sending = asyncio.create_task(_send(socket, viewer, motor))
    tasks: set[asyncio.Task[None]] = set()
    try:
        while True:
            text = await socket.receive_text()
            # Each by itself: what takes long doesn't hold a STOP up that comes after it.
            task = asyncio.create_task(_answer(text, viewer, motor))
            tasks.add(task)
            task.add_done_callback(tasks.discard)
    except (WebSocketDisconnect, KeyError):  # closed; or bytes came, which pages don't send
        pass
    finally:
        motor.leave(viewer)
        sending.cancel()
        with suppress(asyncio.CancelledError):
            await sending


async def _hello(socket: WebSocket, session: Session) -> bool:
    """Return whether the first message came in time with the session's token."""
    try:
        async with asyncio.timeout(HELLO_TIME):
            said = parse_object(await socket.receive_text())
    except (TimeoutError, WebSocketDisconnect, Refused, KeyError):
        return False
    token = said.get("token")
    return said.get("do") == "hello" and isinstance(token, str) and same(session.token, token)


async def _send(socket: WebSocket, viewer: Viewer, motor: MotorSession) -> None:
    """Send what there is to be sent, as fast as the page takes it."""
    with suppress(WebSocketDisconnect, RuntimeError):  # it is closed, which the other side of this sees
        while not viewer.lost:
            for text in await viewer.texts():
                await socket.send_text(text)
            history = motor.history
            frames, viewer.next_row = history.since(viewer.next_row), history.next
            for frame in frames:
                await socket.send_bytes(frame)
        await socket.close(FELL_BEHIND, "this page no longer receives data; load it again")


async def _answer(text: str, viewer: Viewer, motor: MotorSession) -> None:
    """Do what a message asks for, and answer it."""
    message: Said = {}
    try:
        message = parse_object(text)
        answer = await _perform(message, viewer, motor)
        if message["do"] not in UNANSWERED:
            viewer.tell({"kind": "answer", "id": _id(message), "ok": True, **answer})
    except (ServobenchError, Refused, RecursionError) as error:
        viewer.tell({"kind": "answer", "id": _id(message), "ok": False, "error": with_fields(str(error))})


def _id(message: Said) -> str | int | None:
    """The number or text by which a page knows its message again."""
    identifier = message.get("id")
    return identifier if isinstance(identifier, str | int) and len(str(identifier)) <= 64 else None


async def _perform(message: Said, viewer: Viewer, motor: MotorSession) -> Answer:
    """Do what a message asks for, if it may, and return what there is to say about it."""
    name = message.get("do")
    action = ACTIONS.get(name) if isinstance(name, str) else None
    if action is None:
        raise UsageError(f"there is no action {str(name)[:40]!r}; known: {', '.join(ACTIONS)}")
    unknown = sorted(set(message) - {"do", "id", *action.takes})
    if unknown:
        raise UsageError(
            f"{name} doesn't take {', '.join(unknown)[:80]}; it takes {', '.join(action.takes) or 'nothing'}"
        )
    if action.operates:
        motor.lease.check(viewer)
    return await action.carry_out(motor, viewer, message)


@dataclass(frozen=True, kw_only=True)
class Action:
    """A page's request: the fields that it takes, whether it is the operator's (it operates), and who carries it out.

    `carry_out` gets the session, the viewer and what was said, and returns the answer.
    """

    carry_out: Callable[[MotorSession, Viewer, Said], Awaitable[Answer]]
    takes: tuple[str, ...] = ()
    operates: bool = True


async def _lease(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    motor.take_lease(viewer)
    return {}


async def _release(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    motor.release(viewer)
    return {}


async def _heartbeat(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    row = message.get("row")
    if not isinstance(row, int) or isinstance(row, bool) or row < 0:
        raise UsageError(
            f"{str(row)[:40]!r} isn't a row that a page could have drawn; expected a number, 0 or above"
        )
    motor.note_seen(viewer, row)
    return {}


async def _hide(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    motor.note_hidden(viewer)
    return {}


async def _open(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    asked = await asyncio.to_thread(
        experiment_from, motor.experiment, message.get("device"), message.get("sample_time")
    )
    motor.lease.check(viewer)  # a page may have gone meanwhile
    await motor.open(asked)
    return {}


async def _set(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    changes = {key: message[key] for key in SETTABLE if key in message}
    if not changes:
        raise UsageError(f"set changes nothing; give one of {', '.join(SETTABLE)}")
    return {"number": motor.command(command_from(changes))}


async def _start(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    return {"number": motor.start()}


async def _halt(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    return {"number": motor.command(command_from({"enabled": False}))}


async def _stop(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    return {"number": motor.stop("STOP was pressed; the voltage is zero")}


async def _acknowledge(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    return {"number": motor.acknowledge()}


async def _record(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    duration, name = message.get("duration"), message.get("name")
    if duration is not None and not _is_duration(duration):
        raise UsageError(
            f"a recording can't last {duration!r} s; expected a number above 0, or null until it's ended"
        )
    return {"name": await motor.record(name or None, None if duration is None else float(duration))}


async def _end_record(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    motor.end_record()
    return {}


async def _wish(motor: MotorSession, viewer: Viewer, message: Said) -> Answer:
    until = message.get("until")
    if not isinstance(until, str):
        raise UsageError(f"{str(until)[:40]!r} isn't a target; expected a text such as time_constant=0.5%")
    motor.wish(until)
    return {}


def _is_duration(duration: object) -> bool:
    return (
        isinstance(duration, int | float)
        and not isinstance(duration, bool)
        and 0 < duration <= 1e6
        and math.isfinite(duration)
    )


SETTABLE = ("signal", "controller", "enabled", "chain")

ACTIONS: dict[str, Action] = {
    "lease": Action(carry_out=_lease, operates=False),
    "stop": Action(carry_out=_stop, operates=False),
    "beat": Action(carry_out=_heartbeat, takes=("row",), operates=False),
    "hidden": Action(carry_out=_hide, operates=False),
    "release": Action(carry_out=_release),
    "open": Action(carry_out=_open, takes=("device", "sample_time")),
    "set": Action(carry_out=_set, takes=SETTABLE),
    "start": Action(carry_out=_start),
    "halt": Action(carry_out=_halt),
    "acknowledge": Action(carry_out=_acknowledge),
    "record": Action(carry_out=_record, takes=("duration", "name")),
    "wish": Action(carry_out=_wish, takes=("until",)),
    "end_record": Action(carry_out=_end_record),
}
"""All that a page can say on its socket. STOP, the wish to drive and what it says of itself are anybody's; all else is the
operator's."""
