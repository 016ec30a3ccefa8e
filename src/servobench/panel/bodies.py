"""The body of a request, read up to a limit and parsed."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import AsyncIterator
from contextlib import suppress
from typing import Any
from urllib.parse import parse_qs

from starlette.requests import Request
from starlette.types import Message, Receive

from servobench.panel.gate import Refused

LARGEST_JSON = 64 * 1024  # bytes
LARGEST_FORM = 4096  # bytes
LARGEST_UPLOAD = 64 * 1024 * 1024  # bytes
WRITTEN_AT_ONCE = (
    1024 * 1024
)  # bytes; each time it is handed to another thread, which takes longer than to write a page
_WHOLE_TIME = 10.0  # s until it has to be there
_PASSING_TIME = 2.0  # s


async def pieces(request: Request, largest: int) -> AsyncIterator[bytes]:
    """Yield the body of a request as it comes; raises `Refused` once it has, or says that it has, more than `largest` bytes."""
    declared = request.headers.get("content-length")
    if declared is not None and (not declared.isdecimal() or len(declared) > 15 or int(declared) > largest):
        raise Refused(413, f"{declared[:20]} bytes are too many; expected at most {largest}")
    got = 0
    async for piece in request.stream():
        got += len(piece)
        if got > largest:
            raise Refused(413, f"more than {largest} bytes came, which is too many")
        yield piece


async def gather(pieces: AsyncIterator[bytes], size: int = WRITTEN_AT_ONCE) -> AsyncIterator[bytes]:
    """Yield pieces of at least `size` bytes, but for the last, put together from smaller ones."""
    body = bytearray()
    async for piece in pieces:
        body += piece
        if len(body) >= size:
            yield bytes(body)
            body.clear()
    if body:
        yield bytes(body)


class BodyReceiver:
    """A request's `receive` that knows whether all of the body has come."""

    def __init__(self, receive: Receive) -> None:
        self._receive = receive
        self.over = False

    async def __call__(self) -> Message:
        """Wait for the next piece."""
        message = await self._receive()
        self.over = not message.get("more_body", False)
        return message

    async def let_pass(self) -> None:
        """Read the rest and drop it, for a limited time: a client that is cut off while it sends sees no answer."""
        most = LARGEST_UPLOAD
        with suppress(TimeoutError):
            async with asyncio.timeout(_PASSING_TIME):
                while not self.over and most > 0:
                    most -= len((await self()).get("body", b""))


async def json_object(request: Request) -> dict[str, Any]:
    """Return the JSON object that came with a request; raises `Refused` for anything else."""
    return parse_object(await _read_body(request, LARGEST_JSON))


async def form_field(request: Request, name: str) -> str:
    """Return a field of the form that came with a request; raises `Refused` (400) where it isn't in there once."""
    body = await _read_body(request, LARGEST_FORM)
    values = parse_qs(body.decode("ascii", "replace"), keep_blank_values=True).get(name, [])
    if len(values) != 1:
        raise Refused(400, f"expected a form with the field {name!r} once; found it {len(values)} times")
    return values[0]


async def _read_body(request: Request, largest: int) -> bytes:
    body = bytearray()
    try:
        async with asyncio.timeout(_WHOLE_TIME):
            async for piece in pieces(request, largest):
                body += piece
    except TimeoutError:
        raise Refused(400, f"the request wasn't complete after {_WHOLE_TIME:g} s") from None
    return bytes(body)


def parse_object(text: str | bytes) -> dict[str, Any]:
    """Return the JSON object in a text, numbers finite; raises `Refused` (400) for anything else."""
    try:
        content = json.loads(text, parse_constant=_no_number, parse_float=_finite)
        json.dumps(
            content, ensure_ascii=False
        ).encode()  # half a surrogate pair is no text that a file can hold
    except RecursionError:
        raise Refused(400, "its lists or objects are nested too deeply") from None
    except ValueError as error:  # UnicodeDecodeError is one, too
        raise Refused(400, f"that isn't JSON: {error}") from None
    if not isinstance(content, dict):
        raise Refused(400, f"expected a JSON object, not {type(content).__name__}")
    return content


def _no_number(text: str) -> float:
    raise ValueError(f"{text} isn't a number")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} is too large for a number")
    return value
