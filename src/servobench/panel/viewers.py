"""One open page: the messages that wait for it, sent as fast as it reads them."""

from __future__ import annotations

import asyncio
import json
from collections import deque
from collections.abc import Iterator, Mapping
from typing import Any

from servobench.panel.attention import Attention
from servobench.panel.keys import Role

_BEAT = '{"kind":"beat"}'
_MOST_TEXTS = 1000  # that may wait; who is behind by more isn't there


class Viewer:
    """One socket: its texts in a queue, and the number of the row that it gets next.

    Who is slow gets more rows at once, and of states and live figures the newest only; nothing waits for it.
    """

    def __init__(self, role: Role) -> None:
        self.role = role
        self.attention = Attention()
        self.next_row = 0
        self.lost = False
        """Whether so much waits for it that it is given up."""
        self._texts: deque[str] = deque()
        self._newest: dict[str, str] = {}
        self._wake = asyncio.Event()

    def tell(self, message: Mapping[str, Any]) -> None:
        """Send a message, after those before it."""
        if len(self._texts) >= _MOST_TEXTS:
            self.lost = True
        else:
            self._texts.append(as_text(message))
        self._wake.set()

    def show(self, kind: str, text: str) -> None:
        """Send a text of a kind of which the newest matters only."""
        self._newest[kind] = text
        self._wake.set()

    def wake(self) -> None:
        """There are new rows."""
        self._wake.set()

    async def texts(self) -> list[str]:
        """Wait for anything to be sent, and return the texts that wait, what happened before what is."""
        await self._wake.wait()
        self._wake.clear()
        waiting = [*self._texts, *self._newest.values()]
        self._texts.clear()
        self._newest.clear()
        return waiting


class Viewers:
    """All pages that look on."""

    def __init__(self) -> None:
        self._all: set[Viewer] = set()
        self._fed = False  # whether they got rows since the last beat

    def __iter__(self) -> Iterator[Viewer]:
        return iter(self._all)

    def __bool__(self) -> bool:
        return bool(self._all)

    def add(self, viewer: Viewer) -> None:
        """One more looks on."""
        self._all.add(viewer)

    def discard(self, viewer: Viewer) -> None:
        """One is gone."""
        self._all.discard(viewer)

    def tell(self, message: Mapping[str, Any]) -> None:
        """Tell everybody."""
        for viewer in self._all:
            viewer.tell(message)

    def show_news(self, live: str, rows: bool) -> None:
        """Show everybody what is known of the motor, where that is new, and that there are new rows, where there are."""
        self._fed = self._fed or rows
        for viewer in self._all:
            if live:
                viewer.show("live", live)
            if rows:
                viewer.wake()

    def show_state(self, state: Mapping[str, Any], operator: Viewer | None) -> None:
        """Send all pages the status; only the operator's says that it is the operator."""
        for_others = as_text({**state, "operator": False})
        for viewer in self._all:
            own = viewer is operator
            viewer.show("state", as_text({**state, "operator": True}) if own else for_others)

    def heartbeat(self) -> None:
        """Tell everybody that this goes on, where no rows have told it since the last time."""
        if not self._fed:
            for viewer in self._all:
                viewer.show("beat", _BEAT)
        self._fed = False

    def begin_anew(self) -> None:
        """The rows count from 0 again."""
        for viewer in self._all:
            viewer.next_row = 0


def as_text(message: Mapping[str, Any]) -> str:
    """Return a message as JSON; a number that isn't finite is a fault of ours."""
    return json.dumps(message, allow_nan=False, separators=(",", ":"))
