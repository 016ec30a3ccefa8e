"""A session with a board under test: it says what it is told to, right or wrong, and keeps all that it hears."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from servobench.core.errors import DeviceError
from servobench.rig.wire.conversation import Port
from servobench.rig.wire.frames import Reader, encode
from servobench.rig.wire.messages import protocol

PATIENCE = 0.5  # s; a board that hasn't answered by then doesn't
QUIET = 0.1  # s; long enough for an answer that must not come

Heard = tuple[str, dict[str, Any]]


@dataclass
class Session:
    """A board at an open port. `now` tells the time that the port's waits take [s]."""

    port: Port
    now: Callable[[], float] = time.monotonic
    owner: int = field(default_factory=lambda: secrets.randbelow(0xFFFF) + 1)
    """The number by which it claims the board."""
    heard: list[Heard] = field(default_factory=list, init=False)
    """Messages that came since `send` or `say` was called last, by name and values."""
    strange: int = field(default=0, init=False)
    """Frames that came damaged, with an unknown code or with a wrong length."""
    _reader: Reader = field(default_factory=Reader, init=False)
    _said: int = field(default=-1, init=False)

    # Saying

    def payload(self, message: str, *, skip: int = 0, **values: Any) -> bytes:
        """Return a message's payload with the next sequence number but `skip`, and the owner unless another is given."""
        self._said = (self._said + 1 + skip) & 0xFF
        kind = protocol().message(message)
        if any(each.name == "owner" for each in kind.fields):
            values = {"owner": self.owner, **values}
        if message == "table":
            values["duty"] = [*values["duty"], *[0] * (8 - len(values["duty"]))]
        return kind.pack(self._said, **values)

    def send(self, data: bytes) -> None:
        """Send bytes as they are; what was heard before is forgotten."""
        self.heard = []
        self.port.write(data)

    def say(self, message: str, **values: Any) -> int:
        """Send a message, and return its sequence number."""
        self.send(encode(self.payload(message, **values)))
        return self._said

    # Hearing

    def hear(self) -> None:
        """Hear what comes within a turn of the port."""
        payloads = self._reader.feed(self.port.read())
        self.strange += self._reader.damaged
        self._reader.damaged = 0
        for payload in payloads:
            message = protocol().of(payload)
            if message is None or message.sender != "device" or len(payload) != message.struct.size:
                self.strange += 1
            else:
                self.heard.append((message.name, message.unpack(payload)))

    def wait(self, seconds: float) -> None:
        """Hear for that long [s]."""
        begun = self.now()
        while self.now() - begun < seconds:
            self.hear()

    def all(self, message: str) -> list[dict[str, Any]]:
        """Return the messages of that name that were heard."""
        return [values for name, values in self.heard if name == message]

    def some(self, message: str) -> list[dict[str, Any]]:
        """Return the messages of that name that were heard; raises `DeviceError` where none was."""
        messages = self.all(message)
        if not messages:
            raise DeviceError(f"no {message.upper()} came")
        return messages

    def until(self, what: str, condition: Callable[[], Any], seconds: float = PATIENCE) -> Any:
        """Hear until `condition` returns something true, and return it; raises `DeviceError` where nothing came in time."""
        begun = self.now()
        while not (result := condition()):
            if self.now() - begun >= seconds:
                raise DeviceError(f"no {what} came within {seconds:g} s")
            self.hear()
        return result

    def answer(self, number: int, code: int) -> dict[str, Any]:
        """Return the STATUS that answers the frame of that number and code; raises `DeviceError` where none comes."""

        def match() -> dict[str, Any] | None:
            answers = (
                each for each in self.all("status") if each["ack"] == number and each["command"] == code
            )
            return next(answers, None)

        status: dict[str, Any] = self.until(f"STATUS that answers the code 0x{code:02x}", match)
        return status

    def ask(self, message: str, **values: Any) -> dict[str, Any]:
        """Send a message and return the STATUS that answers it."""
        return self.answer(self.say(message, **values), protocol().message(message).code)

    def fault(self, seconds: float) -> dict[str, Any]:
        """Return the STATUS that tells of a fault by itself; raises `DeviceError` where none comes in time."""

        def match() -> dict[str, Any] | None:
            return next((each for each in self.all("status") if not each["command"] and each["faults"]), None)

        status: dict[str, Any] = self.until("STATUS of a fault", match, seconds)
        return status

    # States

    def rest(self) -> None:
        """Bring the board to switch_on_disabled, from wherever it is."""
        states = protocol().codes["states"]
        self.end()
        self.wait(QUIET)  # until what a slow port holds is out
        status = self.ask("stop")
        if status["state"] == states["fault"]:
            self.ask("clear")
        with suppress(DeviceError):  # a board that does something else is found out by the check of it
            self.ask("claim", schema=protocol().schema)
            self.ask("sampling", period=0, block=0)
            self.ask("release")

    def end(self) -> None:
        """Tell the board to let go of the motor, to send no more samples, and that it is free; wait for no answer."""
        self.say("stop")
        self.say("sampling", period=0, block=0)
        self.say("release")

    def claim(self, watchdog_ms: int = 500) -> None:
        """Claim the board, and give the host that much time."""
        self.ask("claim", schema=protocol().schema)
        self.ask("configure", watchdog_ms=watchdog_ms, stall_duty=protocol().constants["duty_full"])

    def enable(self, mode: str = "direct", watchdog_ms: int = 500) -> None:
        """Claim the board and switch its bridge on, at zero duty; raises `DeviceError` where it refuses."""
        self.claim(watchdog_ms)
        status = self.ask("enable", mode=protocol().codes["modes"][mode])
        if status["state"] != protocol().codes["states"]["operation_enabled"]:
            raise DeviceError(
                f"ENABLE in the mode {mode} was answered by the state {name_of('states', status['state'])}"
            )


def name_of(section: str, code: int) -> str:
    """Return what a code is called; its number where it is called nothing."""
    return next((name for name, each in protocol().codes[section].items() if each == code), str(code))
