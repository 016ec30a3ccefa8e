"""A virtual board: its outputs, what it measures, its tasks and its watchdog, carried forward to the present time."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from servobench.compat.quanser.enumerations import DigitalState
from servobench.compat.quanser.errors import Code, hil_error
from servobench.compat.quanser.layout import LAYOUTS, LIGHTS, TACHOMETER, Address
from servobench.compat.quanser.motion import Motion
from servobench.compat.quanser.tasks import Groups, Row, Task
from servobench.compat.quanser.timebase import CALL, Timebase
from servobench.compat.quanser.waits import Idle
from servobench.compat.quanser.watchdog import Watchdog

GREEN, RED = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)
PWM_VOLTAGE = 15.0  # V at a duty cycle of 1; assumed, as no public page tells it
CODES = 4096  # of the converters, 12 bits


@dataclass(frozen=True, kw_only=True)
class Ending:
    """The state in which a program left a board: the `voltage` [V], and whether the amplifier was `enabled`.

    `title` names the board; it was `closed` by the program or not, and maybe `unplugged` before.
    """

    title: str
    voltage: float
    enabled: bool
    closed: bool
    unplugged: bool

    @property
    def is_safe(self) -> bool:
        """Whether a real board would have been left at rest."""
        return self.closed and not self.enabled and self.voltage == 0.0

    def __str__(self) -> str:
        """The line that a program's run ends with."""
        at_rest = f"{self.title}: 0 V, amplifier off"
        if self.unplugged or self.is_safe:
            return f"{at_rest}{', after it was unplugged' if self.unplugged else ''}."
        left = f"{self.voltage:g} V, amplifier {'on' if self.enabled else 'off'}"
        never = "" if self.closed else ", and never closed the board"
        danger = ": a real motor might keep turning" if self.enabled and self.voltage else ""
        return f"{at_rest}, by the stand-in. The program itself left {left}{never}{danger}."


class Board:
    """One board, from when it is opened until it is closed; what it does in between happens in `call`.

    Its motor is there before and after, as it has a supply of its own.
    """

    def __init__(
        self, address: Address, motion: Motion, timebase: Timebase, idle: Idle, *, has_watchdog: bool
    ) -> None:
        self.address, self.layout = address, LAYOUTS[address.card_type]
        self.motion, self.timebase, self._idle = motion, timebase, idle
        self.has_watchdog = has_watchdog
        self.lock = threading.RLock()
        self.lights: tuple[float, ...] = RED
        self.pwm, self.duty, self.pwm_frequency = False, 0.0, 23195.0
        self.output_limit = motion.limit
        self.tasks: list[Task] = []
        self.watchdog = Watchdog()
        self.unplugged, self.unplug_at = False, math.inf
        self.ending: Ending | None = None
        self._kept = False

    @contextmanager
    def call(self, cost: float = CALL, *, guarded: bool = True) -> Iterator[float]:
        """Bring the board to the present time, after what the call costs [s], and yield that time.

        Raises `HILError` where it was unplugged, or, unless it isn't `guarded`, where its watchdog has expired.
        """
        self._idle.end(driven=self.motion.drives and self.motion.voltage != 0.0)
        now = self.timebase.spend(cost)
        with self.lock:
            self.advance(now)
            if self.unplugged:
                raise hil_error(Code.CANNOT_RECEIVE, "It was unplugged.")
            if guarded and self.watchdog.expired:
                raise hil_error(Code.NO_PERMISSION, "Its watchdog has expired; clear that first.")
            yield now
        self._idle.begin()

    def advance(self, now: float) -> None:
        """Let everything happen that is due until a time [s]."""
        while True:
            task = min(self.tasks, key=Task.due, default=None)
            tick = task.due() if task else math.inf
            moment = min(tick, self.watchdog.expires, self.unplug_at)
            if moment > now:
                break
            self._carry_to(moment)
            if self.unplug_at <= moment:
                self._lose()
            elif self.watchdog.expires <= moment:
                self._expire()
            elif task:
                task.tick()
        self._carry_to(now)

    def _carry_to(self, moment: float) -> None:
        self.motion.advance_to(moment)

    def _expire(self) -> None:
        """Put the outputs to the states for that; everything else is refused until it is cleared."""
        self._kept = self.motion.enabled
        watchdog = self.watchdog
        watchdog.expire()
        on = watchdog.enabled == DigitalState.HIGH or (
            watchdog.enabled == DigitalState.NO_CHANGE and self.motion.enabled
        )
        self.motion.put(watchdog.voltage, on)
        self.lights = watchdog.lights

    def clear_watchdog(self, now: float) -> None:
        """Allow outputs again; the amplifier is as before the watchdog expired."""
        if self.watchdog.expired:
            self.motion.put(self.motion.voltage, self._kept)
        self.watchdog.clear(now)

    def unplug(self) -> None:
        """Take the cable off: the amplifier is off, and nothing answers."""
        with self.lock:
            self.advance(self.timebase.now())
            self._lose()

    def _lose(self) -> None:
        """End all that needs the cable; the amplifier turns off by itself."""
        self.motion.put(0.0, False)
        self.unplugged, self.unplug_at = True, math.inf
        self.watchdog.stop()
        for task in self.tasks:
            task.stop()

    def close(self, *, by_program: bool) -> None:
        """End with zero volts, the amplifier off and a red light, and note what the program had left."""
        with self.lock:
            self.advance(self.timebase.now())
            self.ending = Ending(
                title=self.layout.title,
                voltage=self.motion.voltage,
                enabled=self.motion.enabled,
                closed=by_program,
                unplugged=self.unplugged,
            )
            for task in self.tasks:
                task.stop()
                task.deleted = True
            self.tasks.clear()
            self.watchdog.stop()
            self.motion.put(0.0, False)
            self.lights = RED

    def latch(self, groups: Groups) -> Row:
        """Return what the inputs show at the present time, as requested."""
        return (
            tuple(self.motion.current for _ in groups.analog),
            tuple(float(self.counts(channel)) for channel in groups.second),
            tuple(float(self._digital(channel)) for channel in groups.digital),
            tuple(self.motion.speeds[channel - TACHOMETER] for channel in groups.other),
        )

    def counts(self, channel: int) -> int:
        """Return what the counter of an encoder shows."""
        return self.motion.counters[channel].counts(self.motion.angles[channel])

    def _digital(self, channel: int) -> bool:
        return (False, self.motion.stall_warning, self.motion.stall_error)[channel]

    def put(self, groups: Groups, row: Row) -> None:
        """Put values out, as checked."""
        analog, pwm, digital, other = row
        voltage, enabled = self.motion.voltage, self.motion.enabled
        if analog:
            voltage = max(-self.output_limit, min(self.output_limit, analog[-1]))
        if pwm:
            self.duty = max(-1.0, min(1.0, pwm[-1]))
            voltage = self.duty * PWM_VOLTAGE
        if digital:
            enabled = bool(digital[-1])
        if analog or pwm or digital:
            self.motion.put(voltage, enabled)
        self._light(dict(zip(groups.other, other, strict=True)))

    def _light(self, values: Mapping[int, float]) -> None:
        if values:
            self.lights = tuple(
                max(0.0, min(1.0, values.get(channel, shown)))
                for channel, shown in zip(LIGHTS, self.lights, strict=True)
            )

    def set_options(self, text: str) -> None:
        """Take board options, `name=value;name=value`."""
        for part in filter(None, (each.strip() for each in text.split(";"))):
            name, _, value = (each.strip() for each in part.partition("="))
            self._set_option(name, value)

    def _set_option(self, name: str, value: str) -> None:
        if name not in OPTIONS or not self.layout.pwm_outputs:
            raise hil_error(Code.INVALID_ARGUMENT, f"there is no board option {name!r}.")
        try:
            number = float(value)
        except ValueError:
            raise hil_error(
                Code.INVALID_ARGUMENT, f"the board option {name} is {value!r}, which is no number."
            ) from None
        if name == "pwm_en":
            self.pwm = bool(number)
        elif name == "deadband_compensation":
            self.motion.compensation = number


OPTIONS = (
    "deadband_compensation",
    "pwm_en",
    "enc0_velocity",
    "enc1_velocity",
    "min_diode_compensation",
    "max_diode_compensation",
)
"""The board options of the QUBE-Servo 3; the stand-in takes all of them, and the first two make a difference."""
