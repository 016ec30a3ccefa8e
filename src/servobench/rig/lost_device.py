"""The errors of a device that is lost during a run; they carry the recording so far."""

from __future__ import annotations

from servobench.core.errors import DeviceError
from servobench.recordings.recording import Recording


class DeviceLost(DeviceError):
    """A device that stopped answering during a run; `recording` holds everything up to then."""

    def __init__(self, message: str, recording: Recording) -> None:
        super().__init__(message)
        self.recording = recording


class DeviceSilent(DeviceLost):
    """A device call didn't return; the message says whether zero volts were confirmed before the loop was ended."""
