"""The simulated twin of a servo motor: amplifier, motor, encoder and sensors, in virtual time or beside the wall clock."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from types import TracebackType
from typing import Any, ClassVar, Literal, Self

import numpy as np

from servobench.core.channels import Channel, DeviceInfo, Sample
from servobench.core.errors import DeviceError, UsageError
from servobench.core.settings import (
    Angle,
    CountsPerRev,
    Current,
    Damping,
    Inductance,
    Inertia,
    MotorConstant,
    PositiveTime,
    Resistance,
    Settings,
    Speed,
    Time,
    Torque,
    TorqueNoise,
    Voltage,
)
from servobench.rig.devices import handover as at
from servobench.rig.devices.base import DEVICES, finite_voltage
from servobench.rig.devices.handover import Handing, Handover
from servobench.rig.motor.amplifier import Amplifier
from servobench.rig.motor.encoder import CurrentSensor, Encoder, Tachometer
from servobench.rig.motor.parameters import DataSheet, MotorParameters, data_sheet
from servobench.rig.motor.physics import MotorState, Physics
from servobench.rig.motor.plant import Course, Plant
from servobench.rig.motor.solvers.base import SOLVERS
from servobench.rig.motor.solvers.exact import Exact


class TwinSettings(Settings):
    """The hidden truths of a simulated motor; what is left out comes from the data sheet `motor`."""

    motor: str = "qube_servo_2"
    """Name of the data sheet."""
    resistance: Resistance | None = None
    """Winding resistance [Ω]."""
    inductance: Inductance | None = None
    """Winding inductance; 0 leaves the electrical pole out [H]."""
    motor_constant: MotorConstant | None = None
    """Torque and back-emf constant [V·s/rad]."""
    rotor_inertia: Inertia | None = None
    """Inertia of the rotor [kg·m²]."""
    hub_inertia: Inertia | None = None
    """Inertia of the hub [kg·m²]."""
    disc_inertia: Inertia | None = None
    """Inertia of the disc [kg·m²]."""
    viscous_friction: Damping = 1e-6
    """Viscous friction; a data sheet has none, so this is assumed [N·m·s/rad]."""
    coulomb_torque: Torque = 8e-4
    """Coulomb friction; a data sheet has none, so this is assumed [N·m]."""
    torque_noise: TorqueNoise = 0.0
    """Intensity of a white disturbance torque, two-sided [N·m/√Hz]."""
    amplifier_limit: Voltage | None = None
    """Largest voltage of the amplifier [V]."""
    amplifier_resistance: Resistance = 0.0
    """Resistance of the amplifier, in series with the winding [Ω]."""
    dead_band: Voltage | None = None
    """Dead band of the amplifier [V]."""
    counts_per_rev: CountsPerRev | None = None
    """Counts of the encoder in a revolution."""
    counter_bits: Literal[16, 24, 32] | None = None
    """Width of the encoder's counter."""
    start_angle: Angle = 0.0
    """Angle of the shaft at the start; the counter isn't reset there [rad]."""
    delay: Time = 0.0
    """Time from a write to its effect on the motor, unknown to the device itself [s]."""
    current_sensor: bool = True
    """Whether there is a current channel."""
    current_noise: Current = 0.0
    """Standard deviation of the noise of the current channel [A]."""
    tachometer: bool = False
    """Whether there is a speed channel."""
    tachometer_noise: Speed = 0.0
    """Standard deviation of the noise of the speed channel [rad/s]."""
    solver: str = "exact"
    """The solver of the equations: exact, euler, rk4 or adaptive."""
    solver_step: Time | None = None
    """Longest step of the solver; without it a tick is one step [s]."""
    watchdog: PositiveTime | None = None
    """Time without a voltage after which the twin lets the motor go by itself; without it, never [s]."""
    timing: Literal["virtual", "host"] = "virtual"
    """Whether time is computed, as fast as can be, or waited for."""

    @property
    def data_sheet(self) -> DataSheet:
        """The data sheet that values come from where they aren't set; raises `UnknownName`."""
        return data_sheet(self.motor)

    @property
    def parameters(self) -> MotorParameters:
        """The motor's true parameters."""
        names = ("resistance", "inductance", "motor_constant", "rotor_inertia", "hub_inertia", "disc_inertia")
        overrides = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return replace(
            self.data_sheet.motor,
            **overrides,
            viscous_friction=self.viscous_friction,
            coulomb_torque=self.coulomb_torque,
        )


@DEVICES.member("twin")
class Twin:
    """A simulated motor that behaves as a device: what is written acts from the tick of the sample before it.

    In virtual time the same settings and seed give the same samples, bit for bit. Beside the wall clock the motor moves on with
    it, whether or not somebody reads in time. Raises `UsageError` for settings that no motor has.
    """

    Settings: ClassVar[type[TwinSettings]] = TwinSettings

    def __init__(self, settings: TwinSettings | None = None) -> None:
        self.settings = settings or TwinSettings()
        sheet = self.settings.data_sheet
        chosen: dict[str, Any] = {
            "limit": self.settings.amplifier_limit,
            "dead_band": self.settings.dead_band,
        }
        nominal = {"limit": sheet.voltage_limit, "dead_band": sheet.dead_band}
        self._amplifier = Amplifier(
            **{name: nominal[name] if value is None else value for name, value in chosen.items()},
            resistance=self.settings.amplifier_resistance,
        )
        self._encoder = Encoder(
            counts_per_rev=self.settings.counts_per_rev or sheet.counts_per_rev,
            counter_bits=self.settings.counter_bits or sheet.counter_bits,  # type: ignore[arg-type]
        )
        self._current = (
            CurrentSensor(noise=self.settings.current_noise) if self.settings.current_sensor else None
        )
        self._tachometer = (
            Tachometer(noise=self.settings.tachometer_noise) if self.settings.tachometer else None
        )
        self._physics = Physics.of(self.settings.parameters, self.settings.amplifier_resistance)
        if self.settings.solver_step is not None and self.settings.solver_step <= 0:
            raise UsageError(f"twin: solver_step is {self.settings.solver_step:g} s; expected more than 0")
        if self.settings.counts_per_rev is not None and self.settings.counts_per_rev <= 0:
            raise UsageError(
                f"twin: counts_per_rev is {self.settings.counts_per_rev:g}; expected more than 0"
            )
        if self.settings.delay < 0:
            raise UsageError(f"twin: delay is {self.settings.delay:g} s; expected 0 or more")
        self._open = False
        self.lit = (0.0, 0.0, 0.0)  # red, green and blue of its lamp; for tests and pictures
        self._plant: Plant | None = None
        self._clock = time.perf_counter
        self._index, self._sample_time, self._started, self._coasted = -1, math.nan, 0.0, 0.0
        self._fed = math.inf  # s; when the last voltage was written, for its watchdog
        if self.settings.timing == "host":
            self._load_kernels()

    def _load_kernels(self) -> None:
        """Compile or load what a run computes with: within a call it would look like a device that doesn't answer."""
        step = 1e-3
        solver = SOLVERS[self.settings.solver].prepare(self._physics, step, self.settings.solver_step)
        plant = Plant(self._physics, solver, step, self.settings.torque_noise, 0.0, np.random.default_rng(0))
        for voltage, now in ((1.0, 0.5 * step), (0.0, 1.2 * step), (-1.0, 3.0 * step)):
            plant.act(voltage, now)
            plant.advance_to(now)

    @property
    def info(self) -> DeviceInfo:
        """The twin's description: like a real device, it doesn't reveal its parameters."""
        counts = Channel(
            name="counts",
            unit="counts",
            resolution=1.0,
            counter_bits=self._encoder.counter_bits,
            counts_per_rev=self._encoder.counts_per_rev,
        )
        voltage = Channel(
            name="voltage", unit="V", minimum=-self._amplifier.limit, maximum=self._amplifier.limit
        )
        channels = [voltage, counts]
        if self._current:
            limit = self._current.range
            channels.append(
                Channel(
                    name="current",
                    unit="A",
                    minimum=-limit,
                    maximum=limit,
                    resolution=self._current.resolution,
                )
            )
        if self._tachometer:
            channels.append(Channel(name="tachometer", unit="rad/s", resolution=self._tachometer.resolution))
        settings = self.settings.model_dump(exclude_defaults=True)
        return DeviceInfo(
            name="twin",
            serial="simulated",
            channels=tuple(channels),
            timing=self.settings.timing,
            settings=(
                ("motor", self.settings.motor),
                *((n, str(v)) for n, v in settings.items() if n != "motor"),
            ),
        )

    def __enter__(self) -> Self:
        """Connect; the shaft is at rest."""
        self._open = True
        self._plant = None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop and close."""
        self.stop()
        self._open = False

    def start(self, sample_time: float, seed: int | None) -> None:
        """Prepare a run with that sample time [s]; the shaft is at rest at its start angle. Raises `UsageError` for none."""
        self._needs_open()
        if not (math.isfinite(sample_time) and sample_time > 0):
            raise UsageError(f"twin: the sample time is {sample_time!r}; expected a finite time above 0 s")
        solver = SOLVERS[self.settings.solver].prepare(self._physics, sample_time, self.settings.solver_step)
        # The first call compiles or loads the kernels, which takes longer than many a tick; it is thrown away.
        solver.advance(MotorState(0.0, 0.0, 0.0), 1.0, sample_time)
        self._random = np.random.default_rng(seed)
        self._plant = Plant(
            self._physics,
            solver,
            sample_time,
            self.settings.torque_noise,
            self.settings.start_angle,
            self._random,
        )
        self._sample_time, self._index, self._coasted = sample_time, -1, 0.0
        self._fed = math.inf
        self._started = self._clock()
        if self.settings.timing == "host":
            self._plant.advance_to(self._now())  # the first one loads what the next ones need

    def read(self) -> Sample:
        """Let the time since the last sample pass, then latch counts, current and speed."""
        return self.read_after(0.0)

    def read_after(self, delay: float) -> Sample:
        """Latch the next sample a time [s] after its tick; what is written then acts from that time on.

        Raises `UsageError` beside the wall clock, where each sample is latched when it is requested.
        """
        plant = self._require_plant()
        if delay and self.settings.timing == "host":
            raise UsageError("twin: on the wall clock a sample can't be taken later than it is requested")
        self._index += 1
        now = self._now() + delay
        if self._has_expired(now):
            plant.cut(self._fed + (self.own_watchdog or 0.0))
        i, w, theta = plant.advance_to(now)
        return Sample(
            index=self._index,
            time=now,
            counts=self._encoder.counts(theta),
            tachometer=self._tachometer.read(w, self._random) if self._tachometer else None,
            current=self._current.read(i, self._random) if self._current else None,
        )

    def write(self, voltage: float) -> float:
        """Hold a voltage [V] from now on, and return it within the amplifier's limits."""
        plant = self._require_plant()
        requested = finite_voltage("twin", voltage)
        if self._has_expired(self._now()):
            return 0.0
        self._fed = self._now()
        plant.act(self._amplifier.output(requested), self._now() + self.settings.delay)
        return self._amplifier.saturate(requested)

    def stop(self) -> None:
        """Put zero volts on the motor, at once."""
        if self._plant is not None:
            self._plant.cut(self._now())

    @property
    def in_blocks(self) -> Handing | None:
        """The twin itself in virtual time, by the exact solver, without a watchdog; not a subclass, whose reads may differ."""
        plain = SOLVERS[self.settings.solver] is Exact and self.own_watchdog is None
        return self if type(self) is Twin and plain and self.settings.timing == "virtual" else None

    def hand_over(self, to: Handover) -> None:
        """Write the motor's, the amplifier's and the sensors' numbers, and the state after the last tick."""
        to.p[at.TICK], to.p[at.DELAY] = self._sample_time, self.settings.delay
        to.p[at.LIMIT], to.p[at.DEAD_BAND] = self._amplifier.limit, self._amplifier.dead_band
        to.p[at.COUNTS_PER_REV] = self._encoder.counts_per_rev
        to.p[at.HALF_RANGE] = 1 << (self._encoder.counter_bits - 1)
        if self._current:
            to.p[at.CURRENT_RANGE], to.p[at.CURRENT_STEP] = self._current.range, self._current.resolution
            to.p[at.CURRENT_NOISE] = self._current.noise
        if self._tachometer:
            to.p[at.SPEED_STEP], to.p[at.SPEED_NOISE] = self._tachometer.resolution, self._tachometer.noise
        plant = self._require_plant()
        to.p[at.BLOCKED] = plant.blocked
        to.s[at.INDEX] = self._index
        state, now, voltage, coming = plant.course
        to.s[at.CURRENT : at.VOLTAGE + 1] = (*state, now, voltage)
        to.coming = np.array(coming, dtype=np.float64).reshape(-1, 2)
        to.random = self._random
        to.parts, to.factors = plant.factors(self.settings.delay)
        if isinstance(plant.solver, Exact):
            to.coefficients = plant.solver.coefficients

    def take_back(self, block: Handover) -> None:
        """Read the state after the last tick."""
        self._index = int(block.s[at.INDEX])
        *state, now, voltage = block.s[at.CURRENT : at.VOLTAGE + 1].tolist()
        coming = tuple((when, value) for when, value in block.coming.tolist())
        self._require_plant().resume(Course(MotorState(*state), now, voltage, coming))

    def light(self, red: float, green: float, blue: float) -> None:
        """Light the lamp, each colour from 0 to 1."""
        self._needs_open()
        self.lit = (red, green, blue)

    def block(self, blocked: bool) -> None:
        """Hold the shaft where it is, from the last sample on, or let it go."""
        self._require_plant().blocked = blocked

    @property
    def own_watchdog(self) -> float | None:
        """Time without a voltage after which it lets the motor go by itself [s]; until the next start it stays so."""
        return self.settings.watchdog

    @property
    def state(self) -> MotorState:
        """The hidden truth: current [A], speed [rad/s] and angle [rad] at the last sample; for tests and pictures."""
        return self._require_plant().state

    def coast(self, duration: float) -> MotorState:
        """Let time pass with the voltages that were written, without sampling; proves a stop by the shaft's own motion.

        Returns the hidden state after the duration [s], counted from the last sample.
        """
        plant = self._require_plant()
        self._coasted += duration
        return plant.advance_to(self._now() + self._coasted)

    def _has_expired(self, now: float) -> bool:
        """Whether its watchdog has cut the motor off."""
        # A tick later than the time itself is a rounding error, not a silence.
        return self.own_watchdog is not None and now - self._fed > self.own_watchdog * (1 + 1e-9)

    def _needs_open(self) -> None:
        if not self._open:
            raise DeviceError("the twin isn't connected: use it inside a with statement")

    def _require_plant(self) -> Plant:
        """The motor of the run that was started; raises `DeviceError` or `UsageError` where there is none."""
        self._needs_open()
        if self._plant is None:
            raise UsageError("twin: no run was started; call start() first")
        return self._plant

    def _now(self) -> float:
        """The time since the start of the run [s]: computed from the tick, or the host's own."""
        if self.settings.timing == "host":
            return self._clock() - self._started
        return max(self._index, 0) * self._sample_time
