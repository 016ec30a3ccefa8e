"""The benches' simulators against algebra: exact linear responses, energies, poles; and the bound against published figures."""

from dataclasses import replace

import numpy as np
import pytest
from accuracy_parts import bounds, kernels  # type: ignore[import-not-found]
from accuracy_parts.inputs import (  # type: ignore[import-not-found]
    INPUTS,
    SAMPLE_TIME,
    SAMPLES,
    Array,
    delayed,
    prbs,
)
from accuracy_parts.motor import Motor  # type: ignore[import-not-found]
from accuracy_parts.plants import (  # type: ignore[import-not-found]
    QUANTUM,
    TwoMass,
    held_response,
    poles,
    two_mass,
)
from accuracy_parts.rows import rows  # type: ignore[import-not-found]

U = prbs(np.random.default_rng(1))


def marched(
    motor: Motor, u: Array, *, substeps: int = 100, speed: float = 0.0, more: tuple[float, ...] = ()
) -> Array:
    """Speed and angle (N, 2) in short steps; `more` is (excess, Stribeck speed, ripple, cycles, phase)."""
    out = np.empty((len(u), 2))
    p = (motor.inductance, motor.constant, motor.inertia, motor.viscous, motor.coulomb)
    r = np.full(len(u), motor.resistance)
    kernels.march(
        (*p, *(more or (0.0, 1.0, 0.0, 0.0, 0.0))), u, r, SAMPLE_TIME, substeps, (0.0, speed, 0.0), out
    )
    return out  # fmt: skip


def exactly(motor: Motor, u: Array) -> Array:
    """The angle (N,) of a motor without friction from the matrix exponential of (i, ω, θ), or of (ω, θ) without inductance."""
    r, l, k, j, b = motor.resistance, motor.inductance, motor.constant, motor.inertia, motor.viscous
    if l == 0.0:
        a, drive = np.array([[-(b + k * k / r) / j, 0.0], [1.0, 0.0]]), np.array([k / r / j, 0.0])
    else:
        a = np.array([[-r / l, -k / l, 0.0], [k / j, -b / j, 0.0], [0.0, 1.0, 0.0]])
        drive = np.array([1 / l, 0.0, 0.0])
    states: Array = held_response(a, drive, u, 0.0, 0.0, np.zeros(len(drive)))
    return states[:, -1]


@pytest.mark.parametrize("inductance", [0.0, 8.4e-3])
def test_the_marched_motor_is_the_exact_one_where_it_is_linear(inductance: float) -> None:
    """To a hundredth of a count, a thirtieth of what the rounding scatters by."""
    motor = Motor(inductance=inductance)

    error = np.abs(marched(motor, U)[:, 1] - exactly(motor, U)).max()

    assert error < 0.01 * QUANTUM


@pytest.mark.parametrize("coulomb", [0.0, 8e-4])
def test_the_marching_is_of_second_order(coulomb: float) -> None:
    """A quarter of the step makes a sixteenth of the error, on the average over the places where reversals fall in a step."""
    motor = Motor(inductance=8.4e-3, coulomb=coulomb)
    fine = marched(motor, U, substeps=1600)[:, 1]

    errors = [np.abs(marched(motor, U, substeps=n)[:, 1] - fine).max() for n in (25, 100)]

    assert errors[1] < errors[0] / 10


def test_friction_from_event_to_event_is_that_of_short_steps() -> None:
    """Two ways to the same equations. A reversal is met to within the curvature of the speed over 20 µs, (h/τ)² of 70 rad/s."""
    motor = Motor(coulomb=8e-4)
    p = bounds.FirstOrder(gain=motor.gain, tau=motor.time_constant, coulomb=motor.coulomb_voltage)

    error = np.abs(bounds.position(p, U, 0.0) - marched(motor, U)[:, 1]).max()

    reversals = 50
    assert error < reversals * (20e-6 / motor.time_constant) ** 2 * 70 * motor.time_constant


def test_without_friction_the_events_are_the_matrix_exponential() -> None:
    motor = Motor()
    p = bounds.FirstOrder(gain=motor.gain, tau=motor.time_constant)

    assert np.abs(bounds.position(p, U, 0.0) - exactly(motor, U)).max() < 1e-9


def test_a_delayed_input_is_the_input_later() -> None:
    """From rest, a delay of 2.3 samples in 500 Hz is one of 23 samples in 5 kHz."""
    motor = Motor()
    a, b = (
        np.array([[-1 / motor.time_constant, 0.0], [1.0, 0.0]]),
        np.array([motor.gain / motor.time_constant, 0]),
    )

    coarse = held_response(a, b, U, 0.0, 2.3 * SAMPLE_TIME, np.zeros(2))[:, 1]

    late = np.concatenate([np.zeros(23), np.repeat(U, 10)])[: 10 * SAMPLES]
    phi, gamma = bounds.held(a, b, SAMPLE_TIME / 10)
    fine, none = np.empty((10 * SAMPLES, 2)), np.zeros(2)
    kernels.linear(np.eye(2), none, phi, gamma, late, late, none, np.empty((0, 2)), fine)
    assert np.abs(coarse - fine[::10, 1]).max() < 1e-9  # fmt: skip


def test_a_shaft_rests_below_its_static_friction_and_turns_above() -> None:
    """Coulomb 0.16 V and half as much again at rest: 0.24 V."""
    motor = Motor(coulomb=8e-4)
    excess = (0.5, 2.0, 0.0, 0.0, 0.0)

    assert np.ptp(marched(motor, np.full(500, 0.239), more=excess)[:, 1]) == 0.0
    assert np.ptp(marched(motor, np.full(500, 0.241), more=excess)[:, 1]) > 0.0


def test_a_ripple_without_losses_keeps_its_energy() -> None:
    """½ J ω² - (T/n) cos(nθ + φ) stays; the midpoint rule loses (ω h)² of it a radian, ω = 90 rad/s here."""
    lossless = Motor(constant=0.0, viscous=0.0)
    torque, cycles, phase = 1e-3, 3.0, 0.4

    w, theta = marched(lossless, np.zeros(500), speed=30.0, more=(0.0, 1.0, torque, cycles, phase)).T

    energy = 0.5 * lossless.inertia * w**2 - torque / cycles * np.cos(cycles * theta + phase)
    swing = 2 * torque / cycles
    assert np.ptp(w) > 0.5  # it does act
    assert np.ptp(energy) < (cycles * 30.0 * 20e-6) ** 2 * swing * 30.0


def geared(
    motor: Motor, u: Array, *, gap: float, damping: float, speed: float = 0.0, hertz: float = 300.0
) -> Array:
    """Speeds and angles (N, 4) of a motor and a load of half its inertia each, across a gap."""
    j, natural = 0.5 * motor.inertia, 2 * np.pi * hertz
    p = (motor.resistance, motor.constant, j, motor.viscous, motor.coulomb)
    load = (j, 0.0, 0.5 * gap, natural**2 * j / 2, 2 * damping * natural * j / 2)
    out = np.empty((len(u), 4))
    kernels.backlash((*p, *load), u, SAMPLE_TIME, 200, (speed, 0.0, 0.0, 0.0), out)
    return out  # fmt: skip


def test_masses_that_bounce_without_losses_keep_energy_and_momentum() -> None:
    """A leapfrog's energy swings by a part of (ω h)², 3.6e-4 at 300 Hz and 10 µs, while they touch, and doesn't drift."""
    lossless = Motor(constant=0.0, viscous=0.0)

    w, theta, w_l, theta_l = geared(lossless, np.zeros(2000), gap=0.1, damping=0.0, speed=40.0).T

    j, natural = 0.5 * lossless.inertia, 2 * np.pi * 300.0
    twist = np.maximum(np.abs(theta - theta_l) - 0.05, 0.0)
    energy = 0.5 * j * (w**2 + w_l**2) + 0.25 * natural**2 * j * twist**2
    assert np.count_nonzero(np.diff(np.sign(w - w_l))) > 100  # bounces
    assert np.ptp(w + w_l) < 1e-9 * 40
    assert np.ptp(energy) < 1e-3 * energy[0]


def test_without_a_gap_motor_and_load_are_the_two_mass_system() -> None:
    """The exact linear response; a leapfrog takes the resonance for 1 + (ω h)²/24 of it, 1.5e-5 at 300 Hz."""
    motor = Motor()
    a, b = two_mass(motor, 300.0, 0.2)
    exact = held_response(a, b, U, 0.0, 0.0, np.zeros(4))

    found = geared(motor, U, gap=0.0, damping=0.2)

    # The damper acts on the speeds of the step before: half a step late, 5 µs of a twist that is 1e-3 rad at most.
    assert np.abs(found[:, [1, 3]] - exact[:, 2:]).max() < 1e-4


def test_a_load_in_the_gap_isnt_touched() -> None:
    """0.1 rad of gap, a push that ends before it is used up: the load rests, the motor is one with half the inertia."""
    motor = Motor()
    u = np.zeros(10)
    u[0] = 1.0

    found = geared(motor, u, gap=0.1, damping=0.2)

    assert np.all(found[:, 3] == 0.0)
    assert found[-1, 1] == pytest.approx(
        exactly(replace(motor, inertia=0.5 * motor.inertia), u)[-1], rel=1e-6
    )


def test_the_poles_of_a_free_pair_are_its_resonance() -> None:
    """Without a motor: 0 twice, and -ζω ± jω √(1 - ζ²) with ω = 2π f."""
    a, _ = two_mass(Motor(constant=0.0, viscous=0.0), 60.0, 0.02)

    resonant = max(np.linalg.eigvals(a), key=lambda pole: pole.imag)

    natural = 2 * np.pi * 60
    assert resonant == pytest.approx(complex(-0.02 * natural, natural * np.sqrt(1 - 0.02**2)), rel=1e-6)


def test_the_slow_pole_of_a_stiff_shaft_is_that_of_the_whole_inertia() -> None:
    """The load behind a shaft of resonance ω weighs 1 + (s/ω)² of itself at s = -1/τ: 3e-6 at 1 kHz."""
    motor = Motor()
    a, _ = two_mass(motor, 1000.0, 0.02)

    slow = sorted(np.linalg.eigvals(a), key=abs)[1].real

    assert -1 / slow == pytest.approx(motor.time_constant, rel=1e-5)


def test_two_masses_run_at_the_gain_whatever_their_shaft() -> None:
    motor = Motor()
    a, b = two_mass(motor, 20.0, 0.02)

    w, w_l, *_ = held_response(a, b, np.ones(SAMPLES), 0.0, 0.0, np.zeros(4))[-1]

    # The resonance dies away with 2 1/s, the slow pole with 10 1/s: after 10 s e^-25 of 23 rad/s is left.
    assert [w, w_l] == pytest.approx([motor.gain, motor.gain], rel=1e-9)


def test_the_poles_of_a_winding_are_the_roots_of_its_polynomial() -> None:
    motor = Motor(inductance=8.4e-3)
    r, l, k, j, b = motor.resistance, motor.inductance, motor.constant, motor.inertia, motor.viscous

    assert poles(motor) == pytest.approx(
        sorted(np.roots([l * j, r * j + l * b, r * b + k * k]), reverse=True)
    )


@pytest.mark.parametrize(("delay", "gain", "time_constant"), [(0.0006, 2.555e-6, 3.346e-5)])
def test_the_bound_is_the_published_one(delay: float, gain: float, time_constant: float) -> None:
    """The reference set-up with offset and delay unknown, from analytic sensitivities: four digits."""
    t = np.arange(SAMPLES) * SAMPLE_TIME
    u = np.where((0.4 * t + 1e-9) % 1.0 < 0.5, 3.0, 1.0)
    motor = Motor()
    p = bounds.FirstOrder(gain=motor.gain, tau=motor.time_constant, delay=delay)

    found = bounds.bound(p, u, 3.0, QUANTUM**2 / 12)

    assert found["gain"] == pytest.approx(gain, rel=3e-4)
    assert found["time_constant"] == pytest.approx(time_constant, rel=3e-4)
    assert found["delay"] == pytest.approx(3.012e-6, rel=3e-4)


def test_the_filter_whitens_as_the_dense_covariance_does() -> None:
    """J'S⁻¹J from the innovations against the covariance matrix of all samples, by quadrature over the white acceleration."""
    n, tau, q, r = 40, 0.05, 40.0, 1e-6
    t = np.arange(n) * SAMPLE_TIME
    grid = np.linspace(0.0, t[-1], 8001)
    middle = 0.5 * (grid[1:] + grid[:-1])
    response = np.where(t[:, None] > middle, tau * -np.expm1(-(t[:, None] - middle) / tau), 0.0)
    dense = q * response @ response.T * (grid[1] - grid[0]) + r * np.eye(n)
    columns = np.column_stack([np.ones(n), t, np.sin(50 * t)])

    whitened = columns.copy()
    kernels.innovate(*bounds.transition(tau, q), r, whitened)

    expected = columns.T @ np.linalg.solve(dense, columns)
    # 200 midpoints in each tick are good to 1e-5 of the covariance.
    assert whitened.T @ whitened == pytest.approx(expected, rel=1e-4)


def test_the_random_torque_wanders_as_its_stationary_speed_says() -> None:
    """Var(θ(T)) of the integral of a speed of variance q τ/2: at 1e-5 N·m/√Hz 0.105 rad/s; 100 draws of one second each."""
    p = bounds.FirstOrder(gain=1.0, tau=Motor().time_constant)
    q = (1e-5 / Motor().inertia) ** 2
    random = np.random.default_rng(3)

    ends = np.array([bounds.wander(p, q, random)[500] for _ in range(100)])

    tau, late = p.tau, 500 * SAMPLE_TIME
    x = late / tau
    variance = q * tau**3 * (x - 2 * -np.expm1(-x) + 0.5 * -np.expm1(-2 * x))
    # 100 draws know a variance to √(2/100) = 14 %; 3.3 of these.
    assert np.mean(ends**2) == pytest.approx(variance, rel=0.47)


@pytest.mark.parametrize(("noise", "information"), [(0.02, 90.32), (0.05, 36.13), (0.2, 9.03), (1.0, 0.92)])
def test_the_information_of_a_count_is_the_published_one(noise: float, information: float) -> None:
    assert bounds.interval_information(noise, 1.0) == pytest.approx(information, abs=0.006)


def test_what_acts_first_in_a_tick_is_the_older_input() -> None:
    u = np.arange(1.0, 6.0)

    late, held, first = delayed(u, 0.0, 1.3 * SAMPLE_TIME)

    assert late.tolist() == [0.0, 0.0, 1.0, 2.0, 3.0]
    assert held.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert first == pytest.approx(0.3 * SAMPLE_TIME)


@pytest.mark.parametrize("name", INPUTS)
def test_an_input_uses_its_levels_about_equally(name: str) -> None:
    levels, count = np.unique(INPUTS[name](np.random.default_rng(5)), return_counts=True)

    assert len(levels) == 2
    assert count.min() > 0.3 * SAMPLES


def test_every_plant_gives_the_same_record_for_the_same_seed_and_whole_counts() -> None:
    """One row of each plant and each of its settings but the input."""
    for row in rows():
        if row.name.endswith(("square", "one_way")):
            continue
        one, other = (row.plant.case(np.random.default_rng(row.base)) for _ in range(2))
        assert np.array_equal(one.counts, other.counts), row.name
        assert np.array_equal(one.counts, np.round(one.counts)), row.name
        assert one.truth.gain[0] <= one.truth.gain[1], row.name


def test_a_two_mass_plant_holds_its_slow_pole_against_the_estimate_not_its_resonance() -> None:
    case = TwoMass(20, "motor", "PRBS ±3 V").case(np.random.default_rng(1))

    assert 0.08 < case.truth.time_constant[0] < 0.12
