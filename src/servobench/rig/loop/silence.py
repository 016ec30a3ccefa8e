"""A silent loop: the device, or something else that its thread waits for, doesn't answer; and what is known of the motor.

The loop writes the state of its thread into the ring, before and after each call of the device. The program that started it
reads this state. Nothing in the loop's process has to run for it, so it works even if an extension keeps the interpreter's
lock.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

from servobench.core.finding import Finding, danger
from servobench.rig.devices.observed import Call
from servobench.rig.loop.ring import CALL, OPENING_TIME, ZERO_VOLTS, RowRing

PATIENCE = 0.8  # s; after 0.1 s the watchdog has tried a write, after 0.3 s a stop, and within 1 s the user gets a message
RUN_PATIENCE = 4.0  # s; from then on the loop's process is ended, as no call of a tick takes as long
OPENING_PATIENCE = 30.0  # s; the same for a device that is being opened or started
DEVICE_SILENT = "device-silent"
"""The code of the finding of a run that was ended because the device didn't answer."""

_DOING = {
    Call.OPEN: "while it is being opened",
    Call.START: "while it is being started",
    Call.READ: "to a read",
    Call.WRITE: "to a write",
    Call.STOP: "to a stop",
    Call.CLOSE: "while it is being closed",
}
_OPENING = (Call.OPEN, Call.START)


@dataclass(frozen=True, kw_only=True)
class Silence:
    """A loop that doesn't go on, and what is known of the motor."""

    call: Call
    """The condition that its thread waits for."""
    duration: float
    """For how long by now [s]."""
    expected: float
    """The longest time that it takes if all is well [s]."""
    zero_volts: bool
    """Whether zero volts are known to be put out."""

    @property
    def too_long(self) -> bool:
        """Whether nothing is to be expected any more."""
        patience = OPENING_PATIENCE if self.call in _OPENING else RUN_PATIENCE
        return self.duration > patience + self.expected

    @property
    def sentence(self) -> str:
        """The event, as the beginning of a sentence, and the state of the motor."""
        known = "zero volts were confirmed" if self.zero_volts else "zero volts were not confirmed"
        if self.call is Call.BETWEEN:
            return (
                f"no sign of life from the loop for {self.duration:.1f} s (its controller doesn't return, or its process is "
                f"stopped); {known}"
            )
        return f"no answer from the device for {self.duration:.1f} s {_DOING[self.call]}; {known}"

    @property
    def warning(self) -> str:
        """The sentence in capitals, with what to do, for the person at the motor."""
        return urgent(self.sentence, " if the motor turns" if self.call in _OPENING else "")

    def finding(self) -> Finding:
        """Return the finding that this is, where it ended the run."""
        return danger(
            DEVICE_SILENT,
            f"{self.sentence[0].upper()}{self.sentence[1:]}, and the loop's process was ended. Switch off the "
            "supply, then check the device, its cable and its driver.",
        )


def urgent(sentence: str, condition: str = "") -> str:
    """Return a sentence about a motor that may be driven, in capitals, with what to do."""
    return f"{sentence}; switch off the supply{condition}".upper()


def silence_of(ring: RowRing, sample_time: float) -> Silence | None:
    """Return what a loop with that sample time [s] waits for, where that has taken longer than it may; None where it goes on."""
    word = ring.get(CALL)
    if not word:
        return None
    call = Call(word & 7)
    duration = 1e-9 * (time.monotonic_ns() - (word >> 3))
    # The loop sleeps between two calls for up to a sample time, and a board that keeps the time lets a read wait as long.
    expected = 2 * sample_time if call in (Call.BETWEEN, Call.READ) else 0.0
    if call is Call.OPEN:
        expected = 1e-9 * ring.get(OPENING_TIME)
    if duration <= PATIENCE + expected:
        return None
    return Silence(call=call, duration=duration, expected=expected, zero_volts=bool(ring.get(ZERO_VOLTS)))
