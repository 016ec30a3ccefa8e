"""Live output of a watched stream: a block that is updated on a terminal, or a line every few seconds elsewhere."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from servobench.cli.option_names import with_options
from servobench.cli.terminal import OutputGone, printable, say
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import group_digits, rounded_interval

if TYPE_CHECKING:
    from servobench.identification.watch import Watch

_INTERVAL = 5.0  # s between two lines
_FRAME = 0.1  # s between two states of the block: nobody reads more, and a terminal far away gets less
_LIGHTS = {
    True: ("●", "bold green", "the innovations are white: the motor behaves as the model says"),
    False: ("●", "bold red", "the innovations aren't white: something is not in the model"),
    None: ("○", "dim", "too few innovations to tell"),
}


class LiveText:
    """Shows a watched stream on a console, over and over; a context manager.

    On a terminal it is one block, taken to its last state in the end; elsewhere a line every five seconds by the clock `now` [s].
    """

    def __init__(self, console: Console, now: Callable[[], float] = time.monotonic) -> None:
        self._console = console
        self._now = now
        self._live = Live(console=console, auto_refresh=False) if console.is_terminal else None
        self._interval = _INTERVAL if self._live is None else _FRAME
        self._next = now() + (_INTERVAL if self._live is None else 0.0)
        self._is_read = True

    def __enter__(self) -> Self:
        """Take the place on the terminal."""
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the last state on the terminal."""
        if self._live is not None:
            self._live.stop()

    def show(self, watch: Watch, silence: float) -> None:
        """Show what is known now; `silence` is how long nothing has come [s]."""
        if self._now() < self._next:
            return
        self._next = self._now() + self._interval
        if self._live is not None:
            self._live.update(block(watch, silence), refresh=True)
        else:
            self._say(line(watch, silence))

    def show_last(self, watch: Watch) -> None:
        """Show the state that the stream ended in."""
        if self._live is not None:
            self._live.update(block(watch, 0.0), refresh=True)
        else:
            self._say(line(watch, 0.0))

    def _say(self, text: str) -> None:
        """Print a line while the output has a reader; the recording goes on without one."""
        if not self._is_read:
            return
        try:
            say(self._console, text)
        except OutputGone:
            self._is_read = False


def block(watch: Watch, silence: float) -> Group:
    """Return the block for a terminal: the parameters, what they rest on, the innovation light and the sentence."""
    message = watch.message() or {"parameters": {}, "white": None}
    table = Table.grid(padding=(0, 2))
    for name, value in _values(message):
        table.add_row(Text(f"  {name}"), Text(value))
    mark, style, meaning = _LIGHTS[message["white"]]
    light = Text.assemble((f"{mark} ", style), (meaning, "dim"))
    return Group(
        table, Text(_basis(watch, silence)), light, Text(with_options(watch.sentence()), style="bold")
    )


def line(watch: Watch, silence: float) -> str:
    """Return the same on one line, for a log."""
    message = watch.message() or {"parameters": {}, "white": None}
    values = [f"{name} {value}" for name, value in _values(message)]
    return "; ".join([_basis(watch, silence), *values, with_options(watch.sentence())])


def _values(message: dict[str, Any]) -> list[tuple[str, str]]:
    """The parameters in words, each with its value, half of its interval and its unit."""
    shown = []
    for name, estimate in message["parameters"].items():
        low, high = estimate["interval"]
        text = rounded_interval(estimate["value"], (low, high), estimate["unit"])
        shown.append((parameter_in_words(name), str(text)))
    return shown


def _basis(watch: Watch, silence: float) -> str:
    parts = [f"{group_digits(watch.rows)} rows in {watch.duration:.1f} s"]
    parts += [f"{group_digits(watch.lost)} lost"] if watch.lost else []
    parts += [f"{group_digits(watch.damaged)} damaged"] if watch.damaged else []
    parts += [f"nothing for {silence:.0f} s"] if silence >= 2.0 else []
    return printable(", ".join(parts))
