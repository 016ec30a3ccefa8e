"""Whether a page shows the motor, judged by its own drawing; a browser answers pings even for a frozen page.

A page that is frozen, hidden, stopped or hangs draws nothing, and one that is too slow draws what is long past; the browser
answers pings for all of them.
"""

from __future__ import annotations

import math
import time
from typing import Protocol

SILENCE = 0.7  # s without a beat after which a page sees nothing
LAG = 0.7  # s for which a row may wait to be drawn
# With a look each 0.1 s, and the tick in which the loop takes the command, that is zero volts within 1 s.

HIDDEN = "the driving page was hidden by another tab or window, so nobody was watching the motor"
SILENT = (
    f"the driving page has drawn nothing for {SILENCE} s: it is hidden or frozen, or its computer is too busy"
)
LATE = f"the driving page shows the motor more than {LAG} s late: its computer or the network is too slow"


class Rows(Protocol):
    """An object that knows when rows came; `frames.History` is one."""

    def came(self, number: int) -> float | None:
        """Return when the row of that number came [s, monotonic], None where it hasn't come yet."""
        ...


class Attention:
    """The reports of one page about itself, at monotonic times [s]."""

    def __init__(self) -> None:
        self._heard = -math.inf
        self._drawn = 0

    def begin(self) -> None:
        """The page has just asked for something that only the operator asks for: its code runs."""
        self._heard = time.monotonic()

    def heartbeat(self, row: int) -> None:
        """The page has drawn all rows before number `row`."""
        self._heard, self._drawn = time.monotonic(), row

    def end(self) -> None:
        """The page says that it is seen no more."""
        self._heard = -math.inf

    @property
    def there(self) -> bool:
        """Whether the page's own code has answered lately."""
        return time.monotonic() - self._heard < SILENCE

    def reason_unseen(self, rows: Rows) -> str:
        """Return why this page doesn't show the motor as it is now, as a sentence; empty if it may."""
        if not self.there:
            return SILENT
        undrawn = rows.came(self._drawn)
        return LATE if undrawn is not None and time.monotonic() - undrawn > LAG else ""
