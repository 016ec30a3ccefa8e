"""The stand-in while it is installed: its time, its boards, and how it ends."""

from __future__ import annotations

import atexit
import math
import os
import sys
from collections.abc import Mapping
from typing import Any, Literal

from servobench.compat.quanser.board import Board, Ending
from servobench.compat.quanser.errors import Code, hil_error
from servobench.compat.quanser.layout import LAYOUTS, Address, find
from servobench.compat.quanser.motion import Motion, Mounted
from servobench.compat.quanser.timebase import Timebase
from servobench.compat.quanser.waits import Idle, ReplacedTime

_installed: list[Bench] = []

FOLLOW = 1.0
"""The boards follow simulated time in such steps while a program sleeps [s], so that a sleep costs what it simulates."""


class Bench:
    """The stand-in for `quanser`, from `install` until `uninstall`; a context manager that uninstalls.

    `time` is "simulated" or "real"; `mounted` is what hangs on the motors, the disc or a pendulum (a simulator's address chooses
    by itself); `settings` are those of the twin that differ from the data sheet, `seed` makes its noise repeatable;
    `has_watchdog` says whether the boards have one, which isn't known of real ones; with `ignore_threads` other threads don't
    pace simulated time; `quiet` leaves out the lines on standard error.
    """

    def __init__(
        self,
        *,
        time: Literal["simulated", "real"],
        mounted: Mounted,
        settings: Mapping[str, Any],
        seed: int | None,
        has_watchdog: bool,
        ignore_threads: bool,
        quiet: bool,
    ) -> None:
        self.timebase = Timebase(paced=time == "real", ignore_threads=ignore_threads)
        self.endings: list[Ending] = []
        self.unplug_at = math.inf
        """When the boards are unplugged [s], from the installation on."""
        self._mounted, self._settings, self._seed = mounted, dict(settings), seed
        self._has_watchdog, self._quiet = has_watchdog, quiet
        self._motions: dict[Address, Motion] = {}
        self._boards: list[Board] = []
        self._modules: dict[str, Any] = {}
        self._idle = Idle(self.timebase, self.say)
        self._time = ReplacedTime(self.timebase, self.wait, self._idle) if time == "simulated" else None
        self.forks = 0
        """The number of child processes that were forked off."""
        self._titled: set[str] = set()

    def __enter__(self) -> Bench:
        return self

    def __exit__(self, *ending: object) -> None:
        self.uninstall()

    def install(self) -> None:
        """Put the modules and functions of the stand-in into the place of others."""
        from servobench.compat.quanser.modules import replace_modules

        if _installed:
            raise RuntimeError("the stand-in for quanser is installed already; uninstall it first")
        _installed.append(self)
        self._modules = replace_modules()
        if self._time:
            self._time.__enter__()
        atexit.register(self.uninstall)

    def uninstall(self) -> None:
        """Put every board to rest, and the modules and functions back; may be called twice."""
        from servobench.compat.quanser.modules import restore_modules

        if self not in _installed:
            return
        self.close_all(by_program=False)
        _installed.remove(self)
        if self._time:
            self._time.__exit__()
        restore_modules(self._modules)
        atexit.unregister(self.uninstall)

    @property
    def board(self) -> Board:
        """The board that is open, or was opened last; raises `LookupError` where none was."""
        if not self._boards:
            raise LookupError("no board was opened yet")
        return self._boards[-1]

    def open(self, card_type: object, identifier: object) -> Board:
        """Open a board; raises `HILError` where there is none, or it is open."""
        address = find(card_type, identifier)
        if any(board.address == address and board.ending is None for board in self._boards):
            raise hil_error(Code.BOARD_IN_USE)
        self._tell_title(LAYOUTS[address.card_type].title)
        if self._time:
            self._time.follow(sys._getframe())
        board = Board(
            address, self._motion(address), self.timebase, self._idle, has_watchdog=self._has_watchdog
        )
        board.advance(self.timebase.now())
        board.unplug_at = self.unplug_at
        self._boards.append(board)
        return board

    def wait(self, duration: float) -> None:
        """Let a time pass [s], with the boards following step by step, so that it can be interrupted like any other wait."""
        end = self.timebase.now() + duration
        while (now := self.timebase.now()) < end:
            now = self.timebase.wait_until(min(end, now + FOLLOW))
            if not self.timebase.paced:
                self._follow(now)

    def _follow(self, now: float) -> None:
        """Carry the boards that are open, and all motors, to a time [s]."""
        for board in self._boards:
            if board.ending is None:
                with board.lock:
                    board.advance(now)
        for motion in self._motions.values():
            motion.advance_to(now)

    def close(self, board: Board, *, by_program: bool = True) -> None:
        """Close a board, with its motor at rest; nothing happens where it was closed."""
        if board.ending is None:
            board.close(by_program=by_program)
            if board.ending is not None:
                self.endings.append(board.ending)

    def close_all(self, *, by_program: bool) -> None:
        """Close all boards."""
        for board in self._boards:
            self.close(board, by_program=by_program)

    def unplug(self) -> None:
        """Take the cable off the boards that are open: from now on nothing answers."""
        for board in self._boards:
            if board.ending is None:
                board.unplug()

    def rest(self) -> None:
        """Put new motors, at rest and without voltage, in the place of those of the open boards, for tests that repeat."""
        self._motions.clear()
        for board in self._boards:
            if board.ending is None:
                board.motion = self._motion(board.address)
                board.motion.advance_to(self.timebase.now())

    def _motion(self, address: Address) -> Motion:
        """The motor at an address, which goes on while no board is open."""
        if address not in self._motions:
            mounted: Mounted = self._mounted
            if address.simulator:
                mounted = "disc" if not address.pendulum else "hanging" if mounted == "disc" else mounted
            self._motions[address] = Motion(LAYOUTS[address.card_type], mounted, self._settings, self._seed)
        return self._motions[address]

    def _tell_title(self, title: str) -> None:
        if title not in self._titled:
            self._titled.add(title)
            self.say(
                f"a stand-in for the {title}: a simulated motor, never the real board. What runs here is verified on simulated "
                "hardware only."
            )

    def say(self, line: str) -> None:
        """Tell the user a line, on standard error, where the program's own output isn't disturbed."""
        if not self._quiet:
            sys.stderr.write(f"servobench: {line}\n")
            sys.stderr.flush()


def _count_fork() -> None:
    for bench in _installed:
        bench.forks += 1


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_parent=_count_fork)


def current() -> Bench:
    """Return the stand-in that is installed; raises `HILError` where none is any more."""
    if not _installed:
        raise hil_error(Code.BOARD_NOT_FOUND, "The stand-in was uninstalled.")
    return _installed[-1]
