"""The open device: its loop, the thread that reads it, and the live identification."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from functools import partial
from types import TracebackType
from typing import Protocol

from servobench.panel.live_process import LiveProcess
from servobench.panel.pump import Loop, News, Pump
from servobench.rig.experiment import Experiment


class LoopContext(Protocol):
    """The interface that opens a loop's device and ends the loop, as `LoopProcess`; its `warnings` may come meanwhile."""

    def __enter__(self) -> Loop:
        """Open the device and begin."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None, /
    ) -> None:
        """End it, and tidy up."""
        ...

    def rest(self) -> None:
        """End the loop at once, from any thread, whether it is open, being opened or closed; one that is silent is killed."""
        ...

    @property
    def warnings(self) -> tuple[str, ...]:
        """The warnings for a person at the motor, in the order in which they came up."""
        ...

    @property
    def danger(self) -> str:
        """Problems at the motor after the end, with what to do; empty if there are none."""
        ...

    @property
    def zero_volts(self) -> bool:
        """Whether zero volts were confirmed at the end."""
        ...


LoopOf = Callable[[Experiment], LoopContext]
LiveOf = Callable[[Loop, float, Mapping[str, float]], LiveProcess | None]


class Connection:
    """A loop that goes on, as `begun` returns it; `follow` has it read, and the two ends come one after the other.

    What takes time is done by other threads, so that the server's never waits.
    """

    def __init__(self, context: LoopContext, loop: Loop) -> None:
        self._context = context
        self.loop = loop
        self.pump: Pump | None = None
        self.live: LiveProcess | None = None

    @classmethod
    async def begin(cls, context: LoopContext) -> Connection:
        """Start a loop, which opens its device; raises what keeps it from that."""
        return cls(context, await asyncio.to_thread(context.__enter__))

    async def follow(
        self,
        experiment: Experiment,
        live_of: LiveOf,
        wish: Mapping[str, float],
        take: Callable[[Loop, News], None],
    ) -> None:
        """Have the motor identified from now on, a recorder ready, and what is new handed on to `take`, in this thread."""
        await asyncio.to_thread(self.loop.ready_recorder)
        hand_on = partial(_to_thread_of, asyncio.get_running_loop(), partial(take, self.loop))
        self.live = await asyncio.to_thread(live_of, self.loop, experiment.sample_time, wish)
        self.pump = await asyncio.to_thread(
            Pump, self.loop, experiment.sample_time, experiment.chain, hand_on, self.live
        )
        self.pump.start()

    @property
    def watched(self) -> bool:
        """Whether the loop is being read; before that the device is still being opened, and puts out zero volts."""
        return self.pump is None or self.pump.is_alive()

    async def unfollow(self) -> None:
        """Read the loop no more."""
        if self.pump is not None:
            await asyncio.to_thread(self.pump.close)
        if self.live is not None:
            await asyncio.to_thread(self.live.close)

    async def end(self) -> None:
        """Tidy up after the loop, which is ended where it goes on."""
        await asyncio.to_thread(self._context.__exit__, None, None, None)


def _to_thread_of(server: asyncio.AbstractEventLoop, take: Callable[[News], None], news: News) -> None:
    """Hand news on to the server's thread; one that has ended takes none."""
    if not server.is_closed():
        server.call_soon_threadsafe(take, news)
