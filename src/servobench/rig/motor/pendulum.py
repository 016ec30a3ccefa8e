"""The rotary pendulum: a rod that swings freely at the end of an arm, which the motor turns.

The arm's tip runs on a circle of radius r about the motor's axis. The rod, of mass m, length 2 l and inertia J about its middle,
swings in the vertical plane that touches the circle there. With the arm's angle θ, and the rod's angle α from hanging down, both
counted anticlockwise, the rod's middle has, along the arm, across it and upwards, the velocity

    (-l θ' sin α,  r θ' + l α' cos α,  l α' sin α)

so that the Lagrangian, kinetic minus potential energy, is

    ½ (J_a + m r² + (m l² + J) sin² α) θ'² + m r l cos α θ' α' + ½ (m l² + J) α'² + m g l cos α

(by definition of the two energies; a thin rod has no inertia about its own length, so J sin² α is its share in the turning of the
arm). Lagrange's equations, with the motor's torque T, the friction of both bearings and P = m l² + J, are

    (J_a + m r² + P sin² α) θ'' + m r l cos α α'' = T - b_a θ' - T_c sgn θ' - 2 P sin α cos α θ' α' + m r l sin α α'²
    m r l cos α θ'' + P α'' = P sin α cos α θ'² - m g l sin α - b_p α'

The motor gives T = k (v - k θ') / R: the winding's inductance, whose time constant is 0.14 ms, is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from servobench.rig.motor.physics import MotorState, Physics

GRAVITY = 9.81  # m/s²
STEP = 5e-4  # s; the fastest time constant of the arm without the rod is 25 ms, of the swinging rod 90 ms
_STICKS_BELOW = 1e-3  # rad/s; below this speed the arm's Coulomb friction is a stiff damper instead of a jump


@dataclass(frozen=True, kw_only=True)
class Rod:
    """The module that is mounted in the disc's place, in SI units, from the public manual of the QUBE-Servo 3.

    `arm_mass` and `mass` of the rod in kg, `arm_length` and `length` of the rod in m, `damping` in N·m·s/rad. The damping of the
    rod's bearing isn't in the manual: 5e-5 is what Quanser's own scripts assume.
    """

    arm_mass: float = 0.095
    arm_length: float = 0.085
    mass: float = 0.024
    length: float = 0.129
    damping: float = 5e-5

    @property
    def middle(self) -> float:
        """From the bearing to the middle, l [m]."""
        return self.length / 2

    @property
    def inertia(self) -> float:
        """About the bearing, P = m l² + J = m (2 l)²/3 [kg·m²]."""
        return self.mass * self.length**2 / 3

    @property
    def coupling(self) -> float:
        """m r l [kg·m²]."""
        return self.mass * self.arm_length * self.middle

    @property
    def weight(self) -> float:
        """m g l [N·m]."""
        return self.mass * GRAVITY * self.middle

    def arm_inertia(self, rotor: float) -> float:
        """Return J_a + m r² [kg·m²] with an inertia of rotor and hub [kg·m²].

        The arm's own is that of a rod about its middle, as in the maker's models: much of its mass sits at the hub. With that of
        a rod about its end, gains that balance real pendulums (2, 30, 2 and 2.5 of arm, rod and their speeds) wouldn't.
        """
        return rotor + self.arm_mass * self.arm_length**2 / 12 + self.mass * self.arm_length**2


class PendulumState(NamedTuple):
    """Angle [rad] and speed [rad/s] of the arm (`arm`, `arm_speed`), then of the rod (`rod`, `rod_speed`); 0 is hanging down."""

    arm: float
    arm_speed: float
    rod: float
    rod_speed: float


class RotaryPendulum:
    """A motor with an arm and a rod, carried forward in time as a `Plant` is.

    `physics` is the motor's, with the inertia of rotor and hub alone. `rod_angle` is where the rod starts [rad]. While it is
    `held`, a hand keeps the rod at an angle and speed.
    """

    def __init__(self, physics: Physics, rod: Rod, *, rod_angle: float = 0.0) -> None:
        self.physics, self.rod = physics, rod
        self.pendulum = PendulumState(0.0, 0.0, rod_angle, 0.0)
        self.blocked = False
        self.held = False
        self._arm_inertia = rod.arm_inertia(physics.inertia)
        self._now, self._voltage = 0.0, 0.0

    @property
    def state(self) -> MotorState:
        """Current [A], speed [rad/s] and angle [rad] of the motor's shaft."""
        return MotorState(self._current(self.pendulum.arm_speed), self.pendulum.arm_speed, self.pendulum.arm)

    @property
    def energy(self) -> float:
        """Kinetic and potential energy [J]; 0 is hanging down at rest."""
        _, w, alpha, v = self.pendulum
        inertia = self._arm_inertia + self.rod.inertia * math.sin(alpha) ** 2
        kinetic = (
            0.5 * inertia * w * w
            + self.rod.coupling * math.cos(alpha) * w * v
            + 0.5 * self.rod.inertia * v * v
        )
        return kinetic + self.rod.weight * (1.0 - math.cos(alpha))

    def act(self, voltage: float, at: float) -> None:
        """Let a voltage at the winding [V] act from a time [s] on, which may not lie before the present one."""
        self.advance_to(at)
        self._voltage = voltage

    def hold(self, angle: float, speed: float) -> None:
        """Take the rod in the hand: put it to an angle [rad] and move it with a speed [rad/s]."""
        self.held = True
        self.pendulum = self.pendulum._replace(rod=angle, rod_speed=speed)

    def release(self) -> None:
        """Let the rod go, from where it is."""
        self.held = False

    def advance_to(self, time: float) -> MotorState:
        """Carry everything forward to a time [s] and return the state of the motor's shaft."""
        left = time - self._now
        if left > 0.0:
            count = math.ceil(left / STEP - 1e-9)
            for _ in range(count):
                self.pendulum = self._step(left / count)
            self._now = time
        return self.state

    def _current(self, speed: float) -> float:
        return (self._voltage - self.physics.motor_constant * speed) / self.physics.resistance

    def _step(self, h: float) -> PendulumState:
        """One step of the classical Runge-Kutta method (Kutta 1901)."""
        x = self.pendulum
        k1 = self._rates(x)
        k2 = self._rates(_step_along(x, k1, h / 2))
        k3 = self._rates(_step_along(x, k2, h / 2))
        k4 = self._rates(_step_along(x, k3, h))
        return PendulumState(
            *(a + h / 6 * (p + 2 * q + 2 * r + s) for a, p, q, r, s in zip(x, k1, k2, k3, k4, strict=True))
        )

    def _rates(self, x: PendulumState) -> PendulumState:
        """The rates of change of the state."""
        _, w, alpha, v = x
        p, rod = self.physics, self.rod
        sine, cosine = math.sin(alpha), math.cos(alpha)
        friction = p.viscous_friction * w + p.coulomb_torque * max(-1.0, min(1.0, w / _STICKS_BELOW))
        arm = (
            p.motor_constant * self._current(w)
            - friction
            - 2 * rod.inertia * sine * cosine * w * v
            + rod.coupling * sine * v * v
        )
        swing = rod.inertia * sine * cosine * w * w - rod.weight * sine - rod.damping * v
        m11, m12, m22 = self._arm_inertia + rod.inertia * sine * sine, rod.coupling * cosine, rod.inertia
        if self.blocked:
            return PendulumState(0.0, 0.0, v, 0.0 if self.held else swing / m22)
        if self.held:
            return PendulumState(w, arm / m11, v, 0.0)
        determinant = m11 * m22 - m12 * m12
        return PendulumState(
            w, (m22 * arm - m12 * swing) / determinant, v, (m11 * swing - m12 * arm) / determinant
        )


def _step_along(x: PendulumState, rates: PendulumState, h: float) -> PendulumState:
    return PendulumState(*(a + h * b for a, b in zip(x, rates, strict=True)))
