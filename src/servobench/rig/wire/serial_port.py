"""A serial port, by pyserial: opened for one program alone, and with one kind of error for whatever goes wrong at it."""

from __future__ import annotations

import errno
import os
from typing import Any

from servobench.core.errors import DeviceError, UsageError
from servobench.rig.wire.conversation import TURN


class SerialPort:
    """An open port at that many baud. Raises `DeviceError` for one that can't be opened, `UsageError` without pyserial."""

    def __init__(self, name: str, baud: int) -> None:
        try:
            import serial
        except ImportError:
            raise UsageError('the device rig needs pyserial: pip install "servobench[rig]"') from None
        self._name = name
        try:
            self._port: Any = serial.Serial(
                name, baud, timeout=TURN, write_timeout=PATIENCE_TO_WRITE, exclusive=True
            )
        except (OSError, ValueError) as error:  # SerialException is an OSError
            number = getattr(error, "errno", None)
            why = os.strerror(number) if number else str(error)
            if number == errno.EAGAIN:  # the lock of the port
                why = "another program is using it"
            what = (
                "plug the board in, close other programs that use the port, or give another one (python -m "
                "serial.tools.list_ports)"
            )
            if number == errno.EACCES:
                what = "join its group (Debian, Ubuntu: sudo usermod -aG dialout $USER) and log in again"
            if "@" in name:
                port, _, rate = name.rpartition("@")
                what = f"the rate comes after it: {port} baud={rate}"
            raise DeviceError(f"rig: the port {name} can't be opened ({why}); {what}") from None

    def read(self) -> bytes:
        """Return what has come, b"" where nothing came within a turn."""
        return bytes(self._port.read(max(1, self._port.in_waiting)))

    def write(self, data: bytes) -> None:
        """Send some bytes."""
        self._port.write(data)

    def close(self) -> None:
        """Close it."""
        self._port.close()


# s; a port that takes nothing for as long is gone. pyserial also says so of a write that succeeded while the computer itself
# stood still: longer than any watchdog of the board lasts, so that the board's own word for that, "too late", is heard first.
PATIENCE_TO_WRITE = 1.0
