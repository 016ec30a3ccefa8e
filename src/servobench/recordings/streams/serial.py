"""A serial port that a board prints lines on, read with pyserial."""

from __future__ import annotations

import errno
import os
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from servobench.core.errors import UsageError
from servobench.recordings.streams.base import STREAMS, Rows
from servobench.recordings.streams.line_table import LineTable
from servobench.recordings.streams.pump import Pump

if TYPE_CHECKING:
    from serial import Serial

_RATE = 115_200  # baud
_TURN = 0.2  # s; how long a fetch waits for a byte


@STREAMS.member("serial")
class SerialPort:
    """Lines on a serial port: `/dev/ttyACM0`, `COM3`, or with another rate than 115,200 baud `serial:/dev/ttyACM0@57600`.

    Nothing is written to it; a `Pump` reads it, as it may have room for 4 kB only. A board that restarts when its port is opened
    prints its header then; where the first line is a row it may be torn, and is left out. A port that is gone ends the stream.
    Raises `UsageError` for a text that is no port.
    """

    def __init__(self, rest: str) -> None:
        port, _, rate = rest.partition("@")
        if not port or (rate and not (rate.isdecimal() and int(rate))):
            raise UsageError(f"serial:{rest} isn't a port; expected, for example, serial:/dev/ttyACM0@115200")
        self._port, self._rate = port, int(rate or _RATE)
        self.name = f"{port} at {self._rate} baud"
        self._table = LineTable(torn=True)
        self._serial: Serial | None = None
        self._pump: Pump | None = None

    def __enter__(self) -> Self:
        """Open the port."""
        try:
            import serial
        except ImportError:
            raise UsageError(
                "a serial port needs pyserial: python -m pip install 'servobench[rig]'"
            ) from None
        try:
            self._serial = serial.Serial(self._port, self._rate, timeout=_TURN, exclusive=True)
        except (serial.SerialException, ValueError, OSError) as error:
            number = getattr(error, "errno", None)
            why = os.strerror(number) if number else error
            if number == errno.EAGAIN:  # the lock of the port
                why = "another program is using it"
            what = "check the cable, and close other programs that use it"
            if number == errno.EACCES:
                what = "join its group (Debian, Ubuntu: sudo usermod -aG dialout $USER) and log in again"
            raise UsageError(f"{self._port} can't be opened ({why}): {what}") from None
        self._pump = Pump(self._fetch)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the port."""
        if self._pump is not None and self._serial is not None:
            self._pump.stop(2 * _TURN)
            self._serial.close()

    def read(self, patience: float) -> Rows | None:
        """Return the rows that have come; None where the port is gone; raises `UsageError` where it isn't open."""
        if self._pump is None:
            raise UsageError(f"{self.name} isn't open: use the stream in a `with`")
        data = self._pump.take(patience)
        return None if data is None else self._table.take(data)

    def _fetch(self) -> bytes | None:
        """The bytes that have come within a turn; None where the port is gone."""
        port: Any = self._serial
        try:
            data: bytes = port.read(1)
            return data + port.read(port.in_waiting) if data else b""
        except OSError:  # SerialException is one
            return None
