"""Solvers: each against the others, and all against a finely stepped reference that isn't part of the package."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.errors import SimulationDiverged
from servobench.rig.motor import kernels
from servobench.rig.motor.parameters import MotorParameters
from servobench.rig.motor.physics import MotorState, Physics, disturbance_factor
from servobench.rig.motor.solvers.base import SOLVERS, Solver
from servobench.rig.motor.solvers.exact import Exact, coefficients
from tests.rig.motor.reference import Truth, march

H = 0.002
TRUTH = Truth()
PHYSICS = Physics.of(
    MotorParameters(
        resistance=TRUTH.resistance,
        inductance=TRUTH.inductance,
        motor_constant=TRUTH.motor_constant,
        rotor_inertia=TRUTH.inertia,
        viscous_friction=TRUTH.viscous_friction,
        coulomb_torque=TRUTH.coulomb_torque,
    )
)


def voltages(seed: int = 1) -> NDArray[np.float64]:
    """Reversals, voltages below friction, rest, and slow ramps through zero: all that friction can do, over 1.2 s."""
    u = np.repeat(np.where(np.random.default_rng(seed).random(30) < 0.5, -3.0, 3.0), 20)
    u[150:210] = 0.1
    u[250:350] = 0.0
    u[400:500] = np.linspace(-0.3, 0.3, 100)
    return u


def followed(solver: Solver, u: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    state = MotorState(0.0, 0.0, 0.0)
    states = [state]
    for value in u:
        state = solver.advance(state, float(value), H)
        states.append(state)
    return np.array(states)


def test_the_exact_solver_agrees_with_a_reference_of_a_microsecond_step() -> None:
    u = voltages()
    expected = march(TRUTH, u, H, step=1e-6)
    found = Exact.prepare(PHYSICS, H, None).simulate(MotorState(0.0, 0.0, 0.0), u)[:-1]
    # The reference's step of 1 µs leaves an error of the order of 1 µs x the largest acceleration (800 rad/s²) in the speed.
    assert np.abs(found[:, 1] - expected[:, 1]).max() < 1e-3
    # A hundredth of a count of the encoder.
    assert np.abs(found[:, 2] - expected[:, 2]).max() < 0.01 * 2 * np.pi / 2048


@pytest.mark.parametrize("inductance", [1.16e-3, 0.0, 0.5])
def test_the_exact_solver_agrees_with_the_adaptive_one(inductance: float) -> None:
    """With the data sheet's inductance, with none, and with so much that the poles are complex."""
    physics = replace(PHYSICS, inductance=inductance)
    u = voltages()
    exact = followed(SOLVERS["exact"].prepare(physics, H, None), u)
    adaptive = followed(SOLVERS["adaptive"].prepare(physics, H, None), u)
    # The adaptive solver's tolerance is 1e-10 relative a step; 600 ticks of a speed up to 70 rad/s.
    assert np.abs(exact - adaptive)[:, 1].max() < 1e-5
    assert np.abs(exact - adaptive)[:, 2].max() < 1e-5


MOTORS = {
    "as it is": PHYSICS,
    "no inductance": replace(PHYSICS, inductance=0.0),
    "complex poles": replace(PHYSICS, inductance=0.5),
    "much friction": replace(PHYSICS, coulomb_torque=8e-3),
    "no friction": replace(PHYSICS, coulomb_torque=0.0),
    "time constant below a tick": replace(PHYSICS, inertia=2e-7),
}


@pytest.mark.parametrize("motor", MOTORS)
@pytest.mark.parametrize("tick", [1e-4, 2e-3, 2e-2])
def test_a_tick_without_a_switch_is_the_one_that_is_cut_at_its_switches(motor: str, tick: float) -> None:
    """Also near standstill, where the cheap test decides which of the two it is."""
    c = coefficients(MOTORS[motor], tick)
    random = np.random.default_rng(4)
    size = 20_000
    v = random.uniform(-10.0, 10.0, size)
    w = random.uniform(-1.0, 1.0, size) * 10.0 ** random.uniform(-3.0, 2.3, size)
    i = random.uniform(-1.2, 1.2, size)
    if motor == "no inductance":
        i = (v - PHYSICS.motor_constant * w) / PHYSICS.resistance
    found = np.array([kernels.tick(c, *each) for each in zip(i, w, np.zeros(size), v, strict=True)])
    cut = np.array(
        [kernels.advance_switching(c, *each, tick) for each in zip(i, w, np.zeros(size), v, strict=True)]
    )
    p = MOTORS[motor]
    damping = tick * (p.viscous_friction + p.motor_constant**2 / p.resistance) / p.inertia
    assert np.any(found != cut) == (damping < 1.0)  # otherwise each tick is cut
    # The matrix exponential is good to 2e-14 of its largest entry, c₀₁ up to L/(2 J), and each sum has a few roundings more.
    np.testing.assert_allclose(found, cut, rtol=0.0, atol=1e-12 * np.abs(cut).max())


@pytest.mark.parametrize("motor", MOTORS)
def test_many_ticks_at_once_are_one_after_the_other(motor: str) -> None:
    exact, u = Exact.prepare(MOTORS[motor], H, None), voltages()
    expected = followed(exact, u)
    found = exact.simulate(MotorState(0.0, 0.0, 0.0), u)
    # A product and sum may be rounded once or twice: an eps of the largest value a tick.
    atol = len(u) * np.finfo(float).eps * np.abs(expected).max(axis=0)
    assert np.all(np.abs(found - expected).max(axis=0) <= atol)


@pytest.mark.parametrize("motor", MOTORS)
def test_the_shaft_is_cut_where_its_speed_first_reaches_zero(motor: str) -> None:
    """Against the speed on 200 points of the tick, and its sign just before and after."""
    c = coefficients(MOTORS[motor], H)
    random = np.random.default_rng(5)
    times = np.linspace(0.0, H, 201)[1:]
    stops = 0
    for _ in range(2000):
        w, i, v = random.uniform(-5.0, 5.0), random.uniform(-1.2, 1.2), random.uniform(-10.0, 10.0)
        s = np.copysign(1.0, w)
        seen = np.array([s * kernels.slide(c, i, w, 0.0, v, s, t)[1] for t in times])
        i_end, w_end, _ = kernels.slide(c, i, w, 0.0, v, s, H)
        found = kernels.stop_time(c, i, w, v, s, H, i_end, w_end)
        if found < 0.0:
            # Between two points it may dip below zero by a parabola of the largest acceleration at most.
            assert seen.min() > -0.125 * np.abs(np.diff(seen, 2)).max()
            continue
        stops += 1
        assert np.all(seen[times < found * (1 - 1e-9)] > 0.0)
        before, after = (s * kernels.slide(c, i, w, 0.0, v, s, found + dt)[1] for dt in (-1e-9 * H, 1e-9 * H))
        assert before > 0.0 > after
    assert stops > 100


@pytest.mark.parametrize(("name", "order"), [("euler", 1), ("rk4", 4)])
def test_a_fixed_step_solver_converges_with_its_order_without_friction(name: str, order: int) -> None:
    physics = replace(PHYSICS, coulomb_torque=0.0)
    u = np.array([3.0, -2.0])  # two ticks, as the fast error dies out later
    expected = followed(SOLVERS["exact"].prepare(physics, H, None), u)[-1, 1]
    errors = [
        abs(followed(SOLVERS[name].prepare(physics, H, H / steps), u)[-1, 1] - expected) for steps in (40, 80)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.35)


@pytest.mark.parametrize("name", SOLVERS.names())
@pytest.mark.parametrize("inductance", [1.16e-3, 0.0])
def test_every_solver_comes_near_the_exact_one_through_reversals(name: str, inductance: float) -> None:
    physics = replace(PHYSICS, inductance=inductance)
    u = voltages()[:150]
    expected = followed(SOLVERS["exact"].prepare(physics, H, None), u)
    found = followed(SOLVERS[name].prepare(physics, H, 2e-5), u)
    # A step of 20 µs misplaces a reversal by a step at most: 16 mrad/s of friction's speed jump a reversal.
    assert np.abs(found - expected)[:, 1].max() < 0.05


@pytest.mark.parametrize("name", SOLVERS.names())
@pytest.mark.parametrize("inductance", [1.16e-3, 0.0])
def test_a_shaft_at_rest_stays_at_rest_below_the_coulomb_voltage(name: str, inductance: float) -> None:
    solver = SOLVERS[name].prepare(replace(PHYSICS, inductance=inductance), H, 1e-4)
    held = followed(solver, np.full(20, 0.99 * PHYSICS.coulomb_voltage))
    assert np.all(held[:, 1:] == 0.0)
    moved = followed(solver, np.full(20, 1.05 * PHYSICS.coulomb_voltage))
    assert moved[-1, 1] > 0.0


@pytest.mark.parametrize("name", ["euler", "rk4"])
def test_a_step_that_is_too_long_is_refused_with_the_electrical_time_constant(name: str) -> None:
    with pytest.raises(SimulationDiverged, match=r"L/R = 0\.138 ms"):
        SOLVERS[name].prepare(PHYSICS, H, None)


def test_the_stability_limit_is_that_of_the_motor_itself() -> None:
    """Just below the limit the solver settles, and just above it, forced, it doesn't."""
    limit = 2.0 / max(abs(value) for value in PHYSICS.eigenvalues)
    below = SOLVERS["euler"].prepare(PHYSICS, 0.95 * limit, None)
    state = MotorState(0.0, 0.0, 0.0)
    for _ in range(4000):
        state = below.advance(state, 3.0, 0.95 * limit)
    assert state.speed == pytest.approx(PHYSICS.gain * (3.0 - PHYSICS.coulomb_voltage), rel=1e-2)
    with pytest.raises(SimulationDiverged):
        SOLVERS["euler"].prepare(PHYSICS, 1.05 * limit, None)


def test_the_time_constant_is_where_a_step_covers_632_per_mille() -> None:
    physics = replace(PHYSICS, inductance=0.0, coulomb_torque=0.0)
    solver = SOLVERS["exact"].prepare(physics, physics.time_constant, None)
    state = solver.advance(MotorState(0.0, 0.0, 0.0), 1.0, physics.time_constant)
    assert state.speed / physics.gain == pytest.approx(1 - np.exp(-1), rel=1e-12)


@pytest.mark.parametrize("inductance", [1.16e-3, 0.0])
def test_the_disturbance_has_the_covariance_of_its_integral(inductance: float) -> None:
    """F F' against the integral of the impulse responses, which the exact solver itself computes."""
    noise, steps = 1e-6, 2000
    physics = replace(PHYSICS, coulomb_torque=0.0, inductance=inductance)
    factor = disturbance_factor(physics, noise, H)
    middle = (np.arange(steps) + 0.5) * H / steps
    kick = MotorState(0.0, 1.0, 0.0)
    responses = np.array([SOLVERS["exact"].prepare(physics, t, None).advance(kick, 0.0, t) for t in middle])
    expected = responses.T @ responses * (H / steps) * (noise / physics.inertia) ** 2
    # The midpoint rule with 2000 steps of 1 µs is good to (step / fastest time constant)²/24 ~ 2e-6.
    np.testing.assert_allclose(factor @ factor.T, expected, rtol=1e-4, atol=1e-9 * expected.max())
