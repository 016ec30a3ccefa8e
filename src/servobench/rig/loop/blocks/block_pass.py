"""A run in virtual time in compiled blocks of ticks, where every part of it is built in.

Why it is so is explained in docs/decisions/0057-one-compiled-pass.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, Self, runtime_checkable

import numpy as np

from servobench.core.channels import Array, Sample
from servobench.rig.clock import Clock, Tick, VirtualClock
from servobench.rig.devices import handover as at
from servobench.rig.devices.base import Device
from servobench.rig.devices.faulty import Faulty
from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.handover import NEVER, Handover, handover_part
from servobench.systems.control.base import Controller
from servobench.systems.control.lead import Lead
from servobench.systems.control.open_loop import OpenLoop
from servobench.systems.control.pid import Pid
from servobench.systems.control.running import Running
from servobench.systems.control.state_feedback import StateFeedback

LAWS: tuple[type[Controller], ...] = (OpenLoop, Pid, Lead, StateFeedback)
"""The control laws that are compiled, in the order of their numbers in `block_kernels`."""

BLOCK_ROWS = 16_384  # that are handed on at once: a call costs as much as some hundred ticks, and these take milliseconds
FEWEST_TICKS = 1000  # fewer are done before the compiled block is loaded, which takes 10 ms
_LONGEST_WAIT = 512  # ticks
_SPARE = 2  # normal numbers beyond those of a block: a tick whose sensors might find none isn't ordinary


@runtime_checkable
class BlockSink(Protocol):
    """Takes the rows of many ticks at once."""

    def add_block(self, rows: Array, last: Tick) -> None:
        """Take the rows (N, 1 + C) of ticks that are done, in time, up to the last one."""
        ...


@runtime_checkable
class BlockAttendant(Protocol):
    """An attendant that needn't be shown every tick."""

    @property
    def due(self) -> int:
        """The number of the next tick that it has to be shown; `NEVER` where that is none in time."""
        ...

    def pass_to(self, tick: Tick) -> None:
        """Take note that the ticks up to this one are done, all in time."""
        ...


class BlockDrive(Protocol):
    """The drive of the motor through a block."""

    @property
    def controller(self) -> Controller:
        """The control law in force."""
        ...

    @property
    def state(self) -> object:
        """Its state."""
        ...

    @property
    def is_steady(self) -> bool:
        """Whether it is let through, and nothing is to change."""
        ...

    def references(self, index: int) -> Array:
        """Return the references (N,) from that tick on, one at least."""
        ...

    def pass_to(self, state: object, voltage: float) -> None:
        """Take the state after a block, and the voltage [V] commanded last."""
        ...


def tick_by_tick_reason(device: Device, controller: Controller) -> str:
    """Return which part of a run in virtual time isn't compiled, so that it goes tick by tick; empty where each is."""
    if handover_part(device) is None:
        injected = isinstance(device, Faulty) and handover_part(device.device) is not None
        what = "a fault has to see every sample" if injected else ""
        return what or f"the device {device.info.name!r} isn't compiled as it is set"
    if type(controller) not in LAWS:
        return f"the controller {type(controller).__name__} isn't compiled"
    return ""


class BlockPass:
    """Carries a run forward in blocks, and leaves to the loop each tick that isn't ordinary."""

    def __init__(
        self,
        device: Guarded,
        clock: VirtualClock,
        drive: BlockDrive,
        sink: BlockSink,
        attendants: Sequence[BlockAttendant],
    ) -> None:
        self._device = device
        self._clock = clock
        self._drive = drive
        self._sink = sink
        self._attendants = attendants
        self._not_before = 1
        self._wait = 1

    @classmethod
    def of(
        cls,
        device: Guarded,
        clock: Clock,
        drive: BlockDrive,
        sink: object,
        attendants: Sequence[object],
        ticks: int | None,
    ) -> Self | None:
        """Return the pass of a run, None where a part of it has to go tick by tick or the run is too short for it."""
        if not (type(clock) is VirtualClock and isinstance(device, Guarded) and isinstance(sink, BlockSink)):
            return None
        if tick_by_tick_reason(device.device, drive.controller) or device.in_blocks is None:
            return None
        able = [each for each in attendants if isinstance(each, BlockAttendant)]
        if len(able) < len(attendants) or (ticks is not None and ticks < FEWEST_TICKS):
            return None
        return cls(device, clock, drive, sink, able)

    def advance(self, due: int, ticks: int | None) -> int:
        """Do the ticks from the number `due` on as far as they are ordinary, and return the number of the next one."""
        end = min(NEVER if ticks is None else ticks, *(each.due for each in self._attendants), NEVER)
        if due < self._not_before or due >= end or not (self._drive.is_steady and self._device.is_under_way):
            return due
        done = _Block(self._device, self._clock, self._drive, self._sink, self._attendants).run(due, end)
        # Where one tick after the other isn't ordinary it doesn't pay to try at each.
        self._wait = 1 if done > due else min(2 * self._wait, _LONGEST_WAIT)
        self._not_before = done + self._wait
        return done


class _Block:
    """The ticks from one extraordinary tick to the next."""

    def __init__(
        self,
        device: Guarded,
        clock: VirtualClock,
        drive: BlockDrive,
        sink: BlockSink,
        attendants: Sequence[BlockAttendant],
    ) -> None:
        self._device, self._clock, self._drive = device, clock, drive
        self._sink, self._attendants = sink, attendants
        self._handed = Handover()
        device.hand_over(self._handed)
        self._law = LAWS.index(type(drive.controller))
        running = drive.state
        self._running = running if isinstance(running, Running) else None
        self._gains = self._running.p if self._running else None
        self._x = self._running.x.copy() if self._running else None
        self._after = None if self._x is None else np.empty_like(self._x)
        self._new = np.empty_like(self._handed.s)
        p = self._handed.p
        sensors = int(p[at.SPEED_STEP] > 0) + int(p[at.CURRENT_STEP] > 0)
        self._columns = 7 + sensors + (self._running is not None)
        self._rows, self._filled = np.empty((0, self._columns)), 0
        self._last: Tick | None = None
        # Normal numbers in a tick, at most: three for each part of it, one for each sensor that is noisy.
        torques = min(len(self._handed.parts), 2)
        noisy_sensors = sum(p[k] != 0.0 for k in (at.SPEED_NOISE, at.CURRENT_NOISE))
        self._draws = 3 * torques + int(noisy_sensors)

    def run(self, due: int, end: int) -> int:
        """Do the ticks from `due` to before `end`, and return the number of the next one."""
        try:
            end = min(end, self._handed.until) if self._handed.s[at.INDEX] + 1 == due else due
            while due < end:
                if self._filled == len(self._rows):
                    self._hand_on()
                    self._rows = np.empty((min(end - due, BLOCK_ROWS), self._columns))
                references = self._drive.references(due)[: len(self._rows) - self._filled]
                done = self._do(np.ascontiguousarray(references))
                due += done
                if done < len(references):
                    break
        finally:
            self._hand_on()
            self._take_back()
        return due

    def _hand_on(self) -> None:
        """Hand the rows on that are there."""
        if self._filled:
            rows, self._rows, self._filled = self._rows[: self._filled], self._rows[:0], 0
            self._last = self._tick()
            self._sink.add_block(rows, self._last)

    def _do(self, references: Array) -> int:
        """Do a tick for each reference as far as they are ordinary, and return how many are."""
        from servobench.rig.loop.blocks.kernels import run_block

        block, count = self._handed, len(references)
        coming = np.concatenate([block.coming, np.empty((count, 2))])
        block.s[[at.FIRST_COMING, at.COMING, at.DRAWS]] = 0.0, len(block.coming), 0.0
        with _Normals(block, (count * self._draws + _SPARE) if self._draws else 0) as normals:
            done = run_block(
                block.coefficients, block.p, block.s, self._new, coming, self._law, self._gains, self._x, self._after, references,
                normals, block.parts, block.factors, self._rows[self._filled :],
            )  # fmt: skip
        block.coming = coming[int(block.s[at.FIRST_COMING]) : int(block.s[at.COMING])]
        self._filled += done
        return int(done)

    def _tick(self) -> Tick:
        """The last tick that was done."""
        p, s = self._handed.p, self._handed.s
        index = int(s[at.INDEX])
        time = float(s[at.TIME])
        sample = Sample(
            index=index,
            time=time,
            counts=int(s[at.COUNTS]),
            tachometer=float(s[at.SEEN_SPEED]) if p[at.SPEED_STEP] else None,
            current=float(s[at.SEEN_CURRENT]) if p[at.CURRENT_STEP] else None,
        )
        return Tick(index=index, scheduled=time, actual=time, late=False, sample=sample)

    def _take_back(self) -> None:
        """Let everything go on from the last tick that was done."""
        if self._last is None:
            return
        self._device.take_back(self._handed)
        running = self._running
        state = running if self._x is None or running is None else Running(running.law, running.p, self._x)
        self._drive.pass_to(state, float(self._handed.s[at.COMMANDED]))
        self._clock.pass_to(self._last)
        for attendant in self._attendants:
            attendant.pass_to(self._last)


class _Normals:
    """Normal numbers for a block of ticks, drawn ahead; those that it leaves are drawn again by the next one."""

    def __init__(self, block: Handover, count: int) -> None:
        self._block, self._count = block, count

    def __enter__(self) -> Array:
        if not (self._count and self._block.random):
            return np.empty(0)
        self._before = self._block.random.bit_generator.state
        return self._block.random.standard_normal(self._count)

    def __exit__(self, *_: object) -> None:
        draws = int(self._block.s[at.DRAWS])
        if self._block.random and draws < self._count:
            self._block.random.bit_generator.state = self._before
            self._block.random.standard_normal(draws)
