"""A conversation with the open rig at an open port: what is said and heard, with numbers, answers and losses accounted for."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from threading import RLock
from typing import Any, Protocol

from servobench.core.errors import DeviceError
from servobench.rig.wire.frames import Reader, encode
from servobench.rig.wire.messages import protocol

PATIENCE = 0.5  # s of silence, after which nobody is there
ENDLESS = 100_000  # bytes, 2 s at 500 kBd; a board that says as much without what is waited for won't say it
TURN = 0.05  # s; how long a port waits for the first byte


class Port(Protocol):
    """A serial port that is open; its `read` waits `TURN` at most. What goes wrong at it is an `OSError`."""

    def read(self) -> bytes:
        """Return what has come, b"" where nothing came in time."""
        ...

    def write(self, data: bytes) -> None:
        """Send some bytes."""
        ...

    def close(self) -> None:
        """Close it."""
        ...


@dataclass
class Conversation:
    """The host's side of the protocol at one port.

    >>> class Echo:
    ...     def write(self, data): self.data = data
    ...     def read(self): return self.data
    >>> talk = Conversation(Echo(), "echo")
    >>> talk.say("stop")
    0
    >>> next(talk.hear())
    ('stop', {'sequence': 0})
    """

    port: Port
    name: str
    """The port's name, for messages."""
    silent: float = field(default=0.0, init=False)
    """For how long nothing has come [s], by the port's own turns."""
    received: int = field(default=0, init=False)
    """Bytes that have come."""
    damaged: int = field(default=0, init=False)
    """Frames from the board that were damaged."""
    lost: int = field(default=0, init=False)
    """Frames from the board that are missing by their sequence numbers."""
    refusals: Counter[str] = field(default_factory=Counter, init=False)
    """The board's refusals, counted by message and reason."""
    _reader: Reader = field(default_factory=Reader, init=False)
    _saying: RLock = field(default_factory=RLock, init=False)
    _said: int = field(default=-1, init=False)
    _heard: int | None = field(default=None, init=False)
    _waiting: deque[bytes] = field(default_factory=deque, init=False)

    def say(self, message: str, **values: Any) -> int:
        """Send a message, from any thread, and return its sequence number. Raises `OSError` where the port fails."""
        kind = protocol().message(message)
        with self._saying:
            self._said = (self._said + 1) & 0xFF
            self.port.write(encode(kind.pack(self._said, **values)))
            return self._said

    def hear(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yield the messages, by their names and values, that came within a turn; none where nothing came.

        What isn't taken is yielded the next time.
        """
        if not self._waiting:
            data = self.port.read()
            self.received += len(data)
            self.silent = 0.0 if data else self.silent + TURN
            self._waiting.extend(self._reader.feed(data))
            self.damaged = self._reader.damaged
        while self._waiting:
            payload = self._waiting.popleft()
            message = protocol().of(payload)
            if message is None:
                continue
            values = message.unpack(payload)
            if self._heard is not None:
                self.lost += (values["sequence"] - self._heard - 1) & 0xFF
            self._heard = values["sequence"]
            if message.name == "status" and values["refusal"]:
                self._count_refusal(values)
            yield message.name, values

    def ask(self, message: str, **values: Any) -> dict[str, Any]:
        """Send a message and return the STATUS that answers it. Raises `DeviceError` where none comes."""
        number = self.say(message, **values)
        code = protocol().message(message).code
        self.silent, most = 0.0, self.received + ENDLESS
        while self.silent < PATIENCE and self.received < most:
            for name, heard in self.hear():
                if name == "status" and heard["command"] == code and heard["ack"] == number:
                    return heard
        raise DeviceError(
            f"rig: {self.name} didn't answer {message} for {PATIENCE:g} s; check its supply and its cable"
        )

    def _count_refusal(self, status: dict[str, Any]) -> None:
        names = {code: name for name, code in protocol().codes["refusals"].items()}
        command = next((each.name for each in protocol().messages if each.code == status["command"]), "?")
        self.refusals[f"{command}: {names.get(status['refusal'], '?')}"] += 1
