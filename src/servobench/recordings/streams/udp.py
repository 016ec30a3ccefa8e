"""UDP datagrams with lines in them, as a microcontroller with a radio sends."""

from __future__ import annotations

import socket
from contextlib import suppress
from types import TracebackType
from typing import Self

from servobench.core.errors import UsageError
from servobench.recordings.streams.base import STREAMS, Rows
from servobench.recordings.streams.line_table import LineTable

_LARGEST = 65_536  # bytes of a datagram
_BUFFER = 1 << 22  # bytes that the system buffers
_MOST = 1000  # datagrams at once


@STREAMS.member("udp")
class Udp:
    """Lines that datagrams to a port of this computer bring: `udp:PORT`, or `udp:ADDRESS:PORT` to listen at one address alone.

    A datagram holds whole lines; its last needs no line end. A row that the next or the next but one overtakes has its place; a
    later one is left out, and counted.
    Raises `UsageError` for a text that is no port.
    """

    def __init__(self, rest: str) -> None:
        host, _, port = rest.rpartition(":")
        if not port.isdecimal() or not int(port) < 65_536:
            raise UsageError(f"udp:{rest}: {port!r} isn't a port; expected, for example, udp:5005")
        self._address = (host, int(port))
        self.name = f"UDP port {port}"
        self._table = LineTable()
        self._socket: socket.socket | None = None

    @property
    def port(self) -> int:
        """The port that it listens at; the system's choice where 0 was requested."""
        return int(self._socket.getsockname()[1]) if self._socket else self._address[1]

    def __enter__(self) -> Self:
        """Begin to listen."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            with suppress(OSError):  # a system that allows less keeps what it allows
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
            self._socket.bind(self._address)
        except OSError as error:
            self._socket.close()
            raise UsageError(
                f"can't listen on {self.name}: {error.strerror or error}; end the program that uses it, or choose another port"
            ) from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop listening."""
        if self._socket is not None:
            self._socket.close()

    def read(self, patience: float) -> Rows | None:
        """Return the rows that have come; never None, as a sender that is silent may go on.

        Raises `UsageError` where it isn't open.
        """
        if self._socket is None:
            raise UsageError(f"{self.name} isn't open: use the stream in a `with`")
        datagrams: list[bytes] = []
        self._socket.settimeout(patience)
        with suppress(TimeoutError, BlockingIOError):
            while len(datagrams) < _MOST:
                datagrams.append(self._socket.recv(_LARGEST))
                self._socket.settimeout(0.0)
        return self._table.take(b"".join(each + b"\n" for each in datagrams))
