"""The hardware on a virtual board: amplifier, motor, load and sensors, by the twin's physics."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np

from servobench.compat.quanser.hand import TOP, Hand
from servobench.compat.quanser.layout import Layout
from servobench.rig.devices.twin import TwinSettings
from servobench.rig.motor.amplifier import Amplifier
from servobench.rig.motor.encoder import CurrentSensor, Encoder
from servobench.rig.motor.pendulum import Rod, RotaryPendulum
from servobench.rig.motor.physics import Physics
from servobench.rig.motor.plant import Plant
from servobench.rig.motor.solvers.base import SOLVERS

Mounted: TypeAlias = Literal["disc", "hanging", "upright", "lifted"]
"""The load: the disc, or a pendulum that hangs, that a hand holds upright, or that a hand lifts after two seconds."""

TICK = 1e-3  # s, of the solver, which is exact for any
LOOK_AT_STALL = 5e-3  # s
STALL_VOLTAGE, STALL_SPEED = (
    5.0,
    1.0,
)  # V, rad/s; above and below: stalled (the voltage is the board's documentation's)
STALL_WARNING, STALL_ERROR = 0.05, 3.0  # s that it lasts


class Counter:
    """An encoder with its counter: it can be set, wraps at its width, and counts one to four edges of each line."""

    def __init__(self, counts_per_rev: float, bits: Literal[16, 24, 32]) -> None:
        self._whole = Encoder(counts_per_rev=counts_per_rev, counter_bits=bits)
        self._half = 1 << (bits - 1)
        self._offset = 0
        self._encoder = self._whole

    @property
    def half_range(self) -> int:
        """Half of the numbers that the counter can show."""
        return self._half

    def counts(self, angle: float) -> int:
        """Return what the counter shows at an angle [rad]."""
        return (self._encoder.counts(angle) - self._offset + self._half) % (2 * self._half) - self._half

    def set(self, counts: int, angle: float) -> None:
        """Let the counter show that number at the present angle [rad]."""
        self._offset = self._encoder.counts(angle) - counts

    def count_edges(self, edges: int, angle: float) -> None:
        """Count 1, 2 or 4 edges of each line from now on, the counter as it is at the present angle [rad]."""
        shown = self.counts(angle)
        self._encoder = self._whole.model_copy(
            update={"counts_per_rev": self._whole.counts_per_rev * edges / 4}
        )
        self.set(shown, angle)


class Motion:
    """The motor with its load, carried forward in time; angles in rad, voltages in V, currents in A, times in s.

    `settings` are those of the twin that differ from the board's data sheet.
    """

    def __init__(
        self, layout: Layout, mounted: Mounted, settings: Mapping[str, Any], seed: int | None
    ) -> None:
        twin = TwinSettings.model_validate({"motor": layout.data_sheet, **settings})
        sheet = twin.data_sheet
        self._random = np.random.default_rng(seed)
        self._dead_band = sheet.dead_band if twin.dead_band is None else twin.dead_band
        self.compensation = self._dead_band
        self.limit = layout.largest_voltage if twin.amplifier_limit is None else twin.amplifier_limit
        self._current = CurrentSensor(noise=twin.current_noise)
        per_rev = twin.counts_per_rev or sheet.counts_per_rev
        bits = twin.counter_bits or sheet.counter_bits
        self.counts_per_rev = float(per_rev)
        self.counters = tuple(Counter(per_rev, bits) for _ in range(layout.encoders))  # type: ignore[arg-type]
        self.plant, self.hand = _plant(twin, mounted, self._random)
        if mounted == "upright":
            self.counters[1].set(0, -math.pi)  # the board was switched on while it was held
        self.voltage, self.enabled = 0.0, False
        self.stalled_for, self.stall_error = 0.0, False
        self._now = 0.0
        self._began: float | None = None

    @property
    def angles(self) -> tuple[float, float]:
        """Angles of motor and pendulum as their encoders count them [rad]; that of a pendulum that isn't mounted is 0.

        On a real QUBE both encoders count up where the pendulum swings ahead of the arm: balance programs that work there,
        Quanser's own among them, have gains of one sign for both angles. So the second one counts against the textbook's angle.
        """
        rod = self.plant.pendulum.rod if isinstance(self.plant, RotaryPendulum) else 0.0
        return self.plant.state.angle, -rod

    @property
    def speeds(self) -> tuple[float, float]:
        """Speeds of motor and pendulum, as their tachometers show them, in whole counts a second."""
        rod = self.plant.pendulum.rod_speed if isinstance(self.plant, RotaryPendulum) else 0.0
        scale = self.counts_per_rev / (2 * math.pi)
        return float(round(self.plant.state.speed * scale)), float(round(-rod * scale))

    @property
    def current(self) -> float:
        """The current as its channel shows it [A]."""
        return self._current.read(self.plant.state.current if self.drives else 0.0, self._random)

    @property
    def current_step(self) -> float:
        """The smallest step of the current's channel [A]."""
        return self._current.resolution

    @property
    def drives(self) -> bool:
        """Whether the amplifier is on."""
        return self.enabled and not self.stall_error

    @property
    def stall_warning(self) -> bool:
        """Whether the motor has stood still for long under a voltage that should turn it."""
        return self.stalled_for >= STALL_WARNING

    def put(self, voltage: float, enabled: bool) -> None:
        """Put a voltage out from now on, and turn the amplifier on or off; off clears the error of a stall."""
        self.voltage, self.enabled = max(-self.limit, min(self.limit, voltage)), enabled
        if not enabled:
            self.stalled_for, self.stall_error = 0.0, False
        self._act()

    def advance_to(self, moment: float) -> None:
        """Carry everything forward to a time [s]; the first one is where it begins, at rest."""
        if self._began is None:
            self._began = moment
        time = moment - self._began
        while self._now < time:
            watched = self.drives and abs(self.voltage) > STALL_VOLTAGE
            step = min(time, self._now + LOOK_AT_STALL) if watched or self.hand else time
            if self.hand is not None and isinstance(self.plant, RotaryPendulum):
                self.hand.move(self.plant, self._now, self.voltage if self.drives else 0.0)
            self.plant.advance_to(step)
            self._watch(step - self._now, watched)
            self._now = step

    def _watch(self, duration: float, watched: bool) -> None:
        """Notice a motor that stands still under a voltage."""
        stands = watched and abs(self.plant.state.speed) < STALL_SPEED
        self.stalled_for = self.stalled_for + duration if stands else 0.0
        if self.stalled_for >= STALL_ERROR - 1e-9:
            self.stall_error, self.stalled_for = True, 0.0
            self._act()

    def _act(self) -> None:
        net = max(0.0, self._dead_band - self.compensation)
        amplifier = Amplifier(limit=self.limit, dead_band=net)
        self.plant.act(amplifier.output(self.voltage) if self.drives else 0.0, self._now)


def _plant(
    twin: TwinSettings, mounted: Mounted, random: np.random.Generator
) -> tuple[Plant | RotaryPendulum, Hand | None]:
    """The plant that the amplifier turns, and the hand that holds it."""
    motor = twin.parameters
    if mounted != "disc":
        bare = Physics.of(replace(motor, disc_inertia=0.0), twin.amplifier_resistance)
        pendulum = RotaryPendulum(bare, Rod(), rod_angle=TOP if mounted == "upright" else 0.0)
        return pendulum, None if mounted == "hanging" else Hand(lifts=mounted == "lifted")
    physics = Physics.of(motor, twin.amplifier_resistance)
    solver = SOLVERS[twin.solver].prepare(physics, TICK, twin.solver_step)
    plant = Plant(physics, solver, TICK, twin.torque_noise, twin.start_angle, random)
    for duration in (TICK, TICK / 3):  # compiles or loads the kernels, which takes longer than many a tick
        solver.advance(plant.state, 1.0, duration)
    return plant, None
