"""What a command says while it works: how far it is, and that kernels are compiled."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Any, Self, TextIO

from rich.text import Text

from servobench.cli.terminal import is_terminal, messages

_PATIENCE = 1.0  # s; what takes less needs no word
_INTERVAL = 0.25  # s


class Progress:
    """One line on standard error that says what is being done and how long it will take, from the second second on.

    A thread of its own writes it: a motor's loop doesn't wait for a terminal. On a terminal the line is kept up to date and taken
    away in the end; a file gets it once. `now` is the clock [s].
    """

    def __init__(
        self, what: str, *, stream: TextIO | None = None, now: Callable[[], float] = time.monotonic
    ) -> None:
        self._what = what
        self._stream = sys.stderr if stream is None else stream
        self._now = now
        self._start = now()
        self._first: tuple[float, float] | None = None
        self._latest: tuple[float, float] | None = None
        self._width = 0
        self._over = Event()
        self._writing = Lock()
        self._thread = Thread(target=self._write, name="servobench progress", daemon=True)

    def __enter__(self) -> Self:
        if self._stream is not None:
            self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Take the line away."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join(timeout=1.0)

    def reached(self, done: float) -> None:
        """Take note of the part of the work that is done, from 0 to 1."""
        self._latest = (self._now(), done)
        # The pace is counted from here: what comes before the first word is preparation.
        self._first = self._first or self._latest

    def note(self, sentence: str) -> None:
        """Print a sentence that stays, above the line."""
        with self._writing:
            self._put("")
            messages().print(Text(sentence, style="dim"), soft_wrap=True)

    def line(self) -> str:
        """Return what there is to say now; nothing before a second is over."""
        now = self._now()
        if now - self._start < 0.99 * _PATIENCE:  # a clock may be a little short of what was waited for
            return ""
        left = self._time_left(now)
        if left is None or self._latest is None:
            return f"{self._what}, {duration(now - self._start)} so far"
        return f"{self._what}, {100 * self._latest[1]:.0f} %, {duration(left)} left"

    def _time_left(self, now: float) -> float | None:
        """The time that is left at the pace so far [s]; None where nothing tells the pace."""
        if self._first is None or self._latest is None or self._latest[1] <= self._first[1]:
            return None
        (started, before), (latest, done) = self._first, self._latest
        return max(0.0, (1.0 - done) * (latest - started) / (done - before) - (now - latest))

    def _write(self) -> None:
        with suppress(OSError, ValueError):  # the terminal is gone; the work isn't
            if is_terminal(self._stream):
                self._keep_up_to_date()
            elif not self._over.wait(_PATIENCE):
                self._stream.write(f"{self.line()}\n")
                self._stream.flush()

    def _keep_up_to_date(self) -> None:
        while not self._over.wait(_INTERVAL):
            with self._writing:
                self._put(self.line())
        with self._writing:
            self._put("")

    def _put(self, line: str) -> None:
        """Write a line over the one before; blanks do where a terminal knows no other way."""
        if line or self._width:
            self._stream.write(f"\r{line:{self._width}}" if line else f"\r{'':{self._width}}\r")
            self._stream.flush()
            self._width = len(line)


def duration(seconds: float) -> str:
    """Return a duration as people say it: `8 s`, `3 min 20 s`, `2 h 5 min`."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


@contextmanager
def told_when_compiling(progress: Progress) -> Iterator[None]:
    """Note that kernels are being compiled, once, when and only when Numba really compiles one."""
    from numba.core import event

    class Compiling(event.Listener):
        """Hears of each compilation; code that comes from the cache on disk isn't compiled, and makes no sound."""

        heard = False

        def on_start(self, event: Any) -> None:
            if not self.heard:
                self.heard = True
                progress.note("compiling the numeric kernels; this is done once and kept")

        def on_end(self, event: Any) -> None:
            """Say nothing."""

    with event.install_listener("numba:compile", Compiling()):
        yield
