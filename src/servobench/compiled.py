"""The typed face of Numba: how the kernels of this package are compiled."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar, cast

import numba
from numba.core.event import Event, Listener, register, unregister

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a numeric function to machine code at its first call, and keep the code on disk for the next process.

    Only contraction to fused multiply-adds is allowed: NaN and infinity keep their meaning.
    """
    return cast(F, numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})(function))


@contextmanager
def told_while_compiling(begun: Callable[[int], None], over: Callable[[], None]) -> Iterator[None]:
    """Tell meanwhile of each kernel that isn't on the disk yet, and is compiled: when that begins, and when it is over.

    `begun` gets how many were compiled before. Kernels that call others are compiled after those: `over` is told after the last.
    """
    watching = _Watching(begun, over)
    register("numba:compile", watching)  # type: ignore[no-untyped-call]
    try:
        yield
    finally:
        unregister("numba:compile", watching)  # type: ignore[no-untyped-call]


class _Watching(Listener):
    """Hears of compilations, one within the other."""

    def __init__(self, begun: Callable[[int], None], over: Callable[[], None]) -> None:
        self._begun = begun
        self._over = over
        self._depth = self._done = 0

    def on_start(self, event: Event) -> Any:
        """One begins."""
        self._begun(self._done)
        self._depth += 1

    def on_end(self, event: Event) -> Any:
        """One ends, whether it went well or not."""
        self._depth -= 1
        self._done += 1
        if self._depth == 0:
            self._over()
