"""The rescue from a device call that doesn't return: separate threads try the other ways to zero volts."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self, TypeAlias

PATIENCE = 0.1  # s; as long as the watchdog's own default

Attempt: TypeAlias = Callable[[], BaseException | None]
"""One way to zero volts; returns the error where the device doesn't take it, and never raises."""


def first_that_works(attempts: Sequence[Attempt], patience: float = PATIENCE) -> bool:
    """Make attempts, one after the other, until one returns without an error; return whether one did.

    Each gets a thread of its own and `patience` [s], so that one that hangs doesn't keep the next from being made. It goes on
    hanging then, and may still come through.
    """
    for attempt in attempts:
        outcome: list[BaseException | None] = []
        thread = threading.Thread(
            target=lambda made=attempt, results=outcome: results.append(made()),
            name="servobench rescue",
            daemon=True,
        )
        thread.start()
        thread.join(patience)
        if outcome == [None]:
            return True
    return False


class Rescue:
    """A context in which the device is stopped; where that isn't done after `patience` [s], the attempts are made beside it."""

    def __init__(self, attempts: Sequence[Attempt], patience: float = PATIENCE) -> None:
        self._timer = threading.Timer(patience, first_that_works, (attempts, patience))
        self._timer.daemon = True

    def __enter__(self) -> Self:
        self._timer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._timer.cancel()
