"""A device plug-in of which one call hangs, in one of several ways; a journal on disk says what reached it, and when.

It stands alone, as a user's would: the loop's process finds it by an entry point.
"""

import ctypes
import math
import os
import sys
import time
from typing import Any, ClassVar, Literal

from servobench.core.channels import Channel, DeviceInfo, Sample
from servobench.core.settings import Settings

Call = Literal["none", "enter", "start", "read", "write", "stop", "exit"]


class HangingSettings(Settings):
    """The call that misbehaves, how, from when on, and the journal's path."""

    journal: str
    """File to which each call is added as a line."""
    call: Call = "none"
    """The call that misbehaves."""
    how: Literal[
        "sleeps", "blocks", "keeps the lock", "keeps the lock until a signal", "raises", "prints"
    ] = "sleeps"
    """Whether it sleeps as Python does, waits where no signal helps, keeps the interpreter's lock besides, raises or prints."""
    after: float = 0.5
    """Time since the first read from which on read and write misbehave [s]."""
    one_at_a_time: bool = False
    """Whether all of its calls wait for each other, as behind a port with a lock."""


class Hanging:
    """A motor of 20 rad/(s·V) that is at its speed at once."""

    Settings: ClassVar[type[HangingSettings]] = HangingSettings

    def __init__(self, settings: HangingSettings) -> None:
        self.settings = settings
        self._journal = os.open(settings.journal, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        self._angle = self._voltage = 0.0
        self._index = -1
        self._last = math.nan
        self._began = math.inf

    @property
    def info(self) -> DeviceInfo:
        return DeviceInfo(
            name="hanging",
            channels=(
                Channel(name="voltage", unit="V", minimum=-10.0, maximum=10.0),
                Channel(name="counts", unit="counts", resolution=1.0, counter_bits=32, counts_per_rev=2048.0),
            ),
            timing="host",
        )

    def __enter__(self) -> Any:
        self._member_named("enter")
        return self

    def __exit__(self, *error: object) -> None:
        self._member_named("exit")

    def start(self, sample_time: float, seed: int | None) -> None:
        self._member_named("start")
        self._index, self._began = -1, math.inf

    def read(self) -> Sample:
        if self._index < 0:
            self._began = self._last = time.monotonic()
        self._member_named("read")
        now = time.monotonic()
        self._angle += 20.0 * self._voltage * (now - self._last)
        self._last = now
        self._index += 1
        return Sample(index=self._index, time=now - self._began, counts=int(self._angle * 2048 / 6.283185307))

    def write(self, voltage: float) -> float:
        # Zero volts are taken at any time, unless the calls wait for each other: what hangs is a write that drives.
        self._member_named("write" if voltage or self.settings.one_at_a_time else "zero", f"{voltage:.6f}")
        self._voltage = voltage
        self._say("written", f"{voltage:.6f}")
        return voltage

    def stop(self) -> None:
        self._member_named("stop")
        self._voltage = 0.0
        self._say("stopped")

    def _say(self, *words: str) -> None:
        os.write(self._journal, f"{time.monotonic():.6f} {os.getpid()} {' '.join(words)}\n".encode())

    def _member_named(self, call: str, *words: str) -> None:
        self._say(call, *words)
        early = call in ("read", "write", "zero") and time.monotonic() - self._began < self.settings.after
        if call != self.settings.call or early:
            return
        self._say("misbehaves")
        if self.settings.how == "raises":
            raise OSError(f"{call} was refused")
        if self.settings.how == "prints":
            print("warning: a driver's words", flush=True)
            print(f"warning: \x1b[31m{call} number {self._index}", "x" * 400, file=sys.stderr, flush=True)
            return
        while True:
            self._wait()

    def _wait(self) -> None:
        if self.settings.how == "sleeps":
            time.sleep(600.0)
            return
        if self.settings.how == "keeps the lock until a signal":
            ctypes.PyDLL(None).sleep(600)
            return
        # A mutex that this thread holds already: to lock it again takes for ever, whatever signals come.
        library = ctypes.PyDLL(None) if self.settings.how == "keeps the lock" else ctypes.CDLL(None)
        mutex = ctypes.create_string_buffer(128)
        library.pthread_mutex_lock(mutex)
        library.pthread_mutex_lock(mutex)
