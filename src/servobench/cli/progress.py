"""Progress messages: how far a command is, and that kernels are being compiled."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Any, Self, TextIO

from rich.text import Text

from servobench.cli.terminal import is_terminal, messages, one_line, printable

_PATIENCE = 1.0  # s; what takes less needs no word
_INTERVAL = 0.25  # s


@dataclass(frozen=True, kw_only=True)
class _Work:
    """The current step, its start [s], and the first and the latest (time [s], part that was done by then).

    `left` is the time that is left [s] where the work itself tells it, as a run does; `rate` is its pace in words.

    It is replaced as a whole, so that the thread that writes about it never sees a half of each of two.
    """

    what: str
    start: float
    first: tuple[float, float] | None = None
    latest: tuple[float, float] | None = None
    left: float | None = None
    rate: str = ""

    @property
    def done(self) -> float:
        """The part that is done, from 0 to 1."""
        return self.latest[1] if self.latest else 0.0

    def time_left(self, now: float) -> float | None:
        """Return the time that is left [s], at the pace so far unless it is given; None if the pace is unknown."""
        if self.left is not None:
            return max(0.0, self.left)
        if self.first is None or self.latest is None or self.latest[1] <= self.first[1]:
            return None
        (started, before), (latest, done) = self.first, self.latest
        return max(0.0, (1.0 - done) * (latest - started) / (done - before) - (now - latest))


class Progress:
    """One line on standard error that says what is being done and how long it will take, where it takes more than a second.

    A thread of its own writes it: a motor's loop doesn't wait for a terminal. On a terminal the line is kept up to date and taken
    away in the end; a file gets it once for each thing that is begun. `now` is the clock [s].
    """

    def __init__(self, *, stream: TextIO | None = None, now: Callable[[], float] = time.monotonic) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._now = now
        self._written = ""
        self.begin("")
        self._width = 0
        self._over = Event()
        self._writing = Lock()
        self._thread = Thread(target=self._write, name="servobench progress", daemon=True)

    def __enter__(self) -> Self:
        if self._stream is not None:
            try:
                self._thread.start()
            except RuntimeError as error:
                # Ctrl-C may come while Python waits for the thread, and its lock fails then in place of it.
                if isinstance(error.__context__, KeyboardInterrupt):
                    raise error.__context__ from None
                raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Take the line away."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join(timeout=1.0)

    @property
    def what(self) -> str:
        """The current step."""
        return self._work.what

    def begin(self, what: str) -> None:
        """Say from now on that this is being done; nothing for an empty text."""
        self._work = _Work(what=what, start=self._now())

    def advance(self, done: float, left: float | None = None, rate: str = "") -> None:
        """Take note of the part of the work that is done, from 0 to 1, and of time left [s] and pace where they are known."""
        place = (self._now(), done)
        # The pace is counted from here: what comes before the first word is preparation.
        self._work = replace(self._work, first=self._work.first or place, latest=place, left=left, rate=rate)

    def note(self, sentence: str) -> None:
        """Print a sentence that stays, above the line."""
        with self._writing, suppress(OSError):  # the terminal is gone; the work isn't
            if is_terminal(self._stream):
                self._put("")
            messages().print(Text(one_line(sentence), style="dim"), soft_wrap=True)

    @contextmanager
    def pause(self) -> Iterator[None]:
        """Take the line away while something else is printed."""
        with self._writing:
            if is_terminal(self._stream):
                self._put("")
            yield

    def alarm(self, sentence: str) -> None:
        """Print at once what a person at the motor has to know; the current step is no longer shown as running."""
        self.begin("")
        with self._writing, suppress(OSError):  # the run has to end even if nothing reads the message
            if is_terminal(self._stream):
                self._put("")
            messages().print(Text(printable(sentence), style="bold red"), soft_wrap=True)

    def line(self) -> str:
        """Return what there is to say now; nothing before a second is over."""
        work, now = self._work, self._now()
        if not work.what or now - work.start < _PATIENCE:
            return ""
        left = work.time_left(now)
        if left is None:
            return f"{work.what}, {duration(now - work.start)} so far"
        return f"{work.what}, {100 * work.done:.0f} %,{work.rate} {duration(left)} left"

    def _write(self) -> None:
        with suppress(OSError, ValueError):  # the terminal is gone; the work isn't
            put = self._put if is_terminal(self._stream) else self._put_once
            while not self._over.wait(_INTERVAL):
                with self._writing:
                    put(self.line())
            with self._writing:
                put("")

    def _put_once(self, line: str) -> None:
        """Write the first line about each thing, and no other."""
        if line and self._written != self._work.what:
            self._written = self._work.what
            self._stream.write(f"{line}\n")
            self._stream.flush()

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
def announce_compiling(progress: Progress) -> Iterator[None]:
    """Note that kernels are being compiled, once, when and only when Numba really compiles one."""
    from numba.core import event

    from servobench.core.compiled import code_is_kept, keep_announcement_quiet

    class CompileListener(event.Listener):
        """Hears of each compilation; code that comes from the cache on disk isn't compiled, and makes no sound."""

        heard = False

        def on_start(self, event: Any) -> None:
            if not self.heard:
                self.heard = True
                progress.note(
                    f"compiling the numeric kernels{'; this is done once and kept' * code_is_kept()}"
                )

        def on_end(self, event: Any) -> None:
            """Say nothing."""

    with keep_announcement_quiet(), event.install_listener("numba:compile", CompileListener()):
        yield
