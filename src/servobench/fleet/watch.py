"""Take recordings as a test stand drops them into a folder: each once it is whole."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from servobench.fleet.name_pattern import NamePattern
from servobench.fleet.source import Item, Source, recording_endings

SETTLED = 0.5  # s without a change after which a file counts as whole
LOOK = 0.2  # s between two looks at the folder


@dataclass
class Arrivals:
    """The files of a source that are whole and not taken yet.

    `taken` are those that have a row already, by name with their stamps. A file is whole once its size and time have stayed as
    they are for 0.5 s; one that is renamed into the folder, as a careful stand does it, waits no longer either. One that
    changes after that is taken again, so a stand that writes with pauses has its last word.
    """

    source: Source
    pattern: NamePattern | None
    """The pattern of the files' names; None for the endings of formats."""
    taken: dict[str, str]
    _seen: dict[str, tuple[str, float]] = field(default_factory=dict)

    def look(self, now: float) -> list[Item]:
        """Return the files that are whole since the last look, at the time `now` [s] of any clock."""
        items = [item for item in self.source.files() if self._is_meant(item)]
        self._seen = {item.name: self._since(item, now) for item in items}
        whole = [item for item in items if now - self._seen[item.name][1] >= SETTLED]
        self.take(whole)
        return sorted(whole)

    def take(self, items: Iterable[Item]) -> None:
        """Take note that files have been taken."""
        self.taken.update({item.text: item.stamp for item in items})

    def _since(self, item: Item, now: float) -> tuple[str, float]:
        """The stamp of a file, and since when it has been like that."""
        stamp, since = self._seen.get(item.name, ("", now))
        return item.stamp, since if stamp == item.stamp else now

    def _is_meant(self, item: Item) -> bool:
        if self.taken.get(item.text) == item.stamp or item.stamp.startswith("0-"):
            return False
        if self.pattern is not None:
            return self.pattern.columns(item.name) is not None
        return item.name.lower().endswith(recording_endings())
