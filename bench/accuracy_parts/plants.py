"""The plants of the benches: each draws a motor and an input, and returns what an encoder says of it, with the truth.

Each plant says in `truth` what an estimate is compared with. Speeds and angles are those of the motor's shaft.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np

from accuracy_parts import bounds, kernels
from accuracy_parts.inputs import INPUTS, SAMPLE_TIME, SAMPLES, Array, delayed
from accuracy_parts.motor import STRIBECK_SPEED, Motor, Truth

QUANTUM = 2 * np.pi / 2048
_SUBSTEPS = 100  # 20 µs
_CONTACT_SUBSTEPS = 200  # 10 µs
_TURNING = 0.16  # V of Coulomb friction: 8e-4 N·m, as a small servo motor has

Bound = dict[str, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """One record: input u (N,) [V], what it was before, counts (N,), the truth, and the bound where there is one."""

    u: Array
    before: float
    counts: Array
    truth: Truth
    bound: Bound | None = None


class Plant(Protocol):
    """Something to identify."""

    truth: ClassVar[str]

    def case(self, random: np.random.Generator) -> Case:
        """Draw one record."""
        ...


def counts(angle: Array, random: np.random.Generator, noise: float = 0.0) -> Array:
    """An encoder's counts for an angle (N,) [rad], with noise of so many counts before the rounding."""
    jitter = noise * random.standard_normal(len(angle)) if noise else 0.0
    return np.asarray(np.floor(angle / QUANTUM + jitter))


@dataclass(frozen=True)
class Reference:
    """The motor of the published bounds, turning one way: exact, with white torque [N·m/√Hz], noise [counts], delay [samples]."""

    torque: float = 0.0
    noise: float = 0.0
    delay: float = 0.0
    interval: bool = False  # the bound is that of the interval likelihood
    truth: ClassVar[str] = "K = k/(R b + k²), τ = J R/(R b + k²), the delay"

    def case(self, random: np.random.Generator) -> Case:
        motor = Motor().drawn(random)
        u = INPUTS["square 1-3 V"](random)
        start = (random.uniform(0.0, QUANTUM), random.uniform(20.0, 70.0))
        late = self.delay * SAMPLE_TIME
        p = bounds.FirstOrder(
            gain=motor.gain, tau=motor.time_constant, angle=start[0], speed=start[1], delay=late
        )
        intensity = (self.torque / motor.inertia) ** 2
        angle = bounds.position(p, u, float(u[0])) + bounds.wander(p, intensity, random)
        variance = QUANTUM**2 * (1 / 12 + self.noise**2)
        if self.interval:
            variance = 1 / bounds.interval_information(self.noise * QUANTUM, QUANTUM)
        return Case(
            u=u,
            before=float(u[0]),
            counts=counts(angle, random, self.noise),
            truth=Truth.of(motor.gain, motor.time_constant, late),
            bound=bounds.bound(p, u, float(u[0]), variance, intensity),
        )


@dataclass(frozen=True)
class Friction:
    """A first-order motor with Coulomb friction [V], from rest: exact between events."""

    voltage: float
    input: str
    delay: float = 0.0  # samples
    truth: ClassVar[str] = "K = k/(R b + k²), τ = J R/(R b + k²), the delay"

    def case(self, random: np.random.Generator) -> Case:
        motor = Motor().drawn(random)
        u = INPUTS[self.input](random)
        late = self.delay * SAMPLE_TIME
        p = bounds.FirstOrder(
            gain=motor.gain,
            tau=motor.time_constant,
            angle=random.uniform(0.0, 2 * np.pi),
            coulomb=self.voltage,
            delay=late,
        )
        both = bool(u.min() < 0)
        return Case(
            u=u,
            before=0.0,
            counts=counts(bounds.position(p, u, 0.0), random),
            truth=Truth.of(motor.gain, motor.time_constant, late),
            bound=bounds.bound(p, u, 0.0, QUANTUM**2 / 12, reversing=both),
        )


def _with_friction(random: np.random.Generator, volt: float = _TURNING, inductance: float = 0.0) -> Motor:
    """A motor drawn, whose Coulomb friction takes so many volts of the motor that isn't drawn."""
    plain = Motor(inductance=inductance)
    return replace(plain, coulomb=volt * plain.constant / plain.resistance).drawn(random)


def _marched(
    motor: Motor,
    u: Array,
    random: np.random.Generator,
    resistance: Array | None = None,
    excess: float = 0.0,
    ripple: tuple[float, float] = (0.0, 0.0),
) -> Array:
    """The angle (N,) of one inertia in short steps, from rest anywhere; ripple is torque [N·m] and cycles a turn."""
    out = np.empty((len(u), 2))
    phase, angle = random.uniform(0.0, 2 * np.pi, 2)
    p = (motor.inductance, motor.constant, motor.inertia, motor.viscous, motor.coulomb)
    more = (excess, STRIBECK_SPEED, ripple[0], ripple[1], phase)
    r = np.full(len(u), motor.resistance) if resistance is None else resistance
    kernels.march((*p, *more), u, r, SAMPLE_TIME, _SUBSTEPS, (0.0, 0.0, angle), out)
    return out[:, 1]


@dataclass(frozen=True)
class Ripple:
    """A torque that goes round with the shaft, `share` of the stall torque at 3 V, 1 to 8 cycles a turn (drawn)."""

    share: float
    input: str
    truth: ClassVar[str] = "K and τ of the motor without the ripple"

    def case(self, random: np.random.Generator) -> Case:
        motor = _with_friction(random)
        u = INPUTS[self.input](random)
        torque = self.share * motor.constant * 3.0 / motor.resistance
        angle = _marched(motor, u, random, ripple=(torque, float(random.integers(1, 9))))
        truth = Truth.of(motor.gain, motor.time_constant)
        return Case(u=u, before=0.0, counts=counts(angle, random), truth=truth)


@dataclass(frozen=True)
class Stribeck:
    """Friction that is larger at standstill by `excess` of the Coulomb friction, e^(-(ω/2 rad/s)²)."""

    excess: float
    input: str
    truth: ClassVar[str] = "K and τ of the viscous part, k/(R b + k²) and J R/(R b + k²)"

    def case(self, random: np.random.Generator) -> Case:
        motor = _with_friction(random)
        u = INPUTS[self.input](random)
        angle = _marched(motor, u, random, excess=self.excess)
        truth = Truth.of(motor.gain, motor.time_constant)
        return Case(u=u, before=0.0, counts=counts(angle, random), truth=truth)


def linear_rise(t: Array) -> Array:
    """The part of a warming that is over at times t (N,), at an even rate."""
    return t / t[-1]


def saturating_rise(t: Array) -> Array:
    """The part of a warming that is over at times t (N,), with a time constant of a third of the record."""
    return -np.expm1(-3 * t / t[-1])


RISES: dict[str, Callable[[Array], Array]] = {"linear": linear_rise, "exponential": saturating_rise}


@dataclass(frozen=True)
class Warming:
    """A resistance that rises by 10 % during the record."""

    rise: str
    input: str
    truth: ClassVar[str] = "the range of K and τ from the first resistance to the last"

    def case(self, random: np.random.Generator) -> Case:
        motor = _with_friction(random)
        u = INPUTS[self.input](random)
        warm = 1 + 0.1 * RISES[self.rise](np.arange(SAMPLES) * SAMPLE_TIME)
        angle = _marched(motor, u, random, resistance=motor.resistance * warm)
        ends = [replace(motor, resistance=motor.resistance * part) for part in (warm[0], warm[-1])]
        gains = sorted(end.gain for end in ends)
        times = sorted(end.time_constant for end in ends)
        truth = Truth(gain=(gains[0], gains[1]), time_constant=(times[0], times[1]), delay=0.0)
        return Case(u=u, before=0.0, counts=counts(angle, random), truth=truth)


@dataclass(frozen=True)
class Inductance:
    """A winding with a time constant L/R [s] of half a sample time, with Coulomb friction [V] or without."""

    electrical: float
    coulomb: float
    input: str
    truth: ClassVar[str] = "K, τ = -1/(slow pole), delay = -1/(fast pole)"

    def case(self, random: np.random.Generator) -> Case:
        motor = _with_friction(random, self.coulomb, self.electrical * Motor().resistance)
        u = INPUTS[self.input](random)
        slow, fast = poles(motor)
        angle = _marched(motor, u, random)
        truth = Truth.of(motor.gain, -1 / slow, -1 / fast)
        return Case(u=u, before=0.0, counts=counts(angle, random), truth=truth)


def poles(motor: Motor) -> tuple[float, float]:
    """The slow and the fast pole [rad/s] of the speed of a motor with inductance: L J s² + (R J + L b) s + R b + k² = 0."""
    l, r, k, j, b = motor.inductance, motor.resistance, motor.constant, motor.inertia, motor.viscous
    middle, last = r * j + l * b, r * b + k * k
    fast = -(middle + np.sqrt(middle**2 - 4 * l * j * last)) / (2 * l * j)
    return float(last / (l * j * fast)), float(fast)


@dataclass(frozen=True)
class TwoMass:
    """Rotor and load of equal inertia on a shaft that twists; linear, and computed exactly."""

    hertz: float
    encoder: str  # "motor" or "load"
    input: str
    damping: float = 0.02  # of the resonance with the motor switched off
    truth: ClassVar[str] = "K, τ = -1/(slow pole of the linear system)"

    def case(self, random: np.random.Generator) -> Case:
        motor = Motor().drawn(random)
        u = INPUTS[self.input](random)
        a, b = two_mass(motor, self.hertz, self.damping)
        start = np.zeros(4)
        start[2:] = random.uniform(0.0, 2 * np.pi)
        states = held_response(a, b, u, 0.0, 0.0, start)
        # The integrator is the pole at zero, and the resonance, however little damped, is far from it.
        slow = sorted(np.linalg.eigvals(a), key=abs)[1].real
        angle = states[:, 2 if self.encoder == "motor" else 3]
        truth = Truth.of(motor.gain, -1 / slow)
        return Case(u=u, before=0.0, counts=counts(angle, random), truth=truth)


def two_mass(motor: Motor, hertz: float, damping: float) -> tuple[Array, Array]:
    """Return A (4, 4) and B (4,) of dx/dt = A x + B u, x = (ω, ω_l, θ, θ_l), both inertias half of the motor's.

    Stiffness c and damping d of the shaft from the resonance of the free pair: c (1/J₁ + 1/J₂) = (2π f)²,
    d (1/J₁ + 1/J₂) = 2 ζ 2π f.
    """
    j = 0.5 * motor.inertia
    natural = 2 * np.pi * hertz
    c, d = natural**2 * j / 2, 2 * damping * natural * j / 2
    loss = motor.viscous + motor.constant**2 / motor.resistance
    a = np.array(
        [
            [-(loss + d) / j, d / j, -c / j, c / j],
            [d / j, -d / j, c / j, -c / j],
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
        ]
    )
    return a, np.array([motor.constant / motor.resistance / j, 0.0, 0.0, 0.0])


def held_response(a: Array, b: Array, u: Array, before: float, delay: float, start: Array) -> Array:
    """Return the states (N, S) of dx/dt = A x + B u for a held input behind a delay [s], exactly."""
    late, held, first = delayed(u, before, delay)
    out = np.empty((len(u), len(start)))
    pieces = [*bounds.held(a, b, first), *bounds.held(a, b, SAMPLE_TIME - first)]
    kernels.linear(*pieces, late, held, start, np.empty((0, len(start))), out)
    return out


@dataclass(frozen=True)
class Backlash:
    """A gap [rad at the motor's shaft] between rotor and load, each half of the inertia; they meet at a stiff spring."""

    gap: float
    encoder: str  # "motor" or "load"
    input: str
    truth: ClassVar[str] = "K and τ of rotor and load turning together"
    contact: float = 300.0  # Hz, the resonance while they touch, with a damping of 0.2

    def case(self, random: np.random.Generator) -> Case:
        motor = _with_friction(random)
        u = INPUTS[self.input](random)
        j, natural = 0.5 * motor.inertia, 2 * np.pi * self.contact
        p = (motor.resistance, motor.constant, j, 0.5 * motor.viscous, motor.coulomb)
        load = (j, 0.5 * motor.viscous, 0.5 * self.gap, natural**2 * j / 2, 0.4 * natural * j / 2)
        out = np.empty((len(u), 4))
        angle = random.uniform(0.0, 2 * np.pi)
        start = (0.0, angle, 0.0, angle + self.gap * (random.random() - 0.5))
        kernels.backlash((*p, *load), u, SAMPLE_TIME, _CONTACT_SUBSTEPS, start, out)
        seen = out[:, 1 if self.encoder == "motor" else 3]
        truth = Truth.of(motor.gain, motor.time_constant)
        return Case(u=u, before=0.0, counts=counts(seen, random), truth=truth)
