"""The random motors of the bench against closed forms, its bound against a Monte Carlo, and its judge on made-up rows."""

import json
import math
import time
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import population
import pytest
from numpy.typing import NDArray
from population_parts import bound, judge, kernels, motors, runs, simulator
from population_parts.departures import DEPARTURES, Departure
from population_parts.inputs import INPUTS
from population_parts.motors import Case, Motor, drawn
from scipy.linalg import expm
from scipy.optimize import least_squares

Array = NDArray[np.float64]

DT = 0.004
MOTOR = Motor(
    gain=23.7,
    tau=0.099,
    delay=0.3 * DT,
    coulomb=0.0,
    sample_time=DT,
    counts=2048,
    noise=0.0,
    torque=0.0,
)


def case(
    motor: Motor, u: Array, *, output: str = "counts", amplitude: float = 2.0, kind: str = "steps"
) -> Case:
    """A record from rest, without an input before."""
    t = motor.sample_time * np.arange(len(u))
    return Case(motor=motor, input=kind, amplitude=amplitude, output=output, start="cold", chain="", angle=0.3, t=t, u=u,
                first=0, seed=(1,))  # fmt: skip


def edges(u: Array) -> list[tuple[float, float]]:
    """When the input changes, and by how much; it was zero before."""
    change = np.diff(u, prepend=0.0)
    return [(DT * k, change[k]) for k in np.flatnonzero(change)]


def superposed(p: Array, u: Array) -> Array:
    """The angle (N,) by superposition of step responses; p = (K, τ, d, u₀, θ₀, ω₀). No other friction than that of the slope."""
    gain, tau, delay, offset, angle, speed = p
    t = DT * np.arange(len(u))

    def ramped(s: Array) -> Array:
        s = np.maximum(s, 0.0)
        return np.asarray(s - tau * -np.expm1(-s / tau))

    theta = angle + speed * tau * -np.expm1(-t / tau) - gain * offset * ramped(t)
    for at, change in edges(u):
        theta = theta + gain * change * ramped(t - at - delay)
    return np.asarray(theta)


def two_way_square(rows: int = 600, half: int = 60) -> Array:
    return np.where((np.arange(rows) // half) % 2 == 0, 2.0, -2.0)


def test_without_friction_the_angle_is_the_sum_of_step_responses() -> None:
    u = two_way_square()

    motion = simulator.moved(case(MOTOR, u))

    expected = superposed(np.array([23.7, 0.099, 0.3 * DT, 0.0, 0.3, 0.0]), u)
    assert np.abs(motion.angle - expected).max() < 1e-11  # rounding of 10 rad, 600 times


def test_a_coasting_shaft_stops_when_and_where_algebra_says() -> None:
    """ω = (ω₀ + K u_c) e^(-t/τ) - K u_c until t* = τ ln(1 + ω₀/(K u_c)); the way is τ ω₀ - K u_c t*."""
    lost, speed = 0.16, 30.0
    motor = replace(MOTOR, coulomb=lost)
    t = DT * np.arange(400)

    w, theta = simulator.plain(motor, t, np.zeros(400), 0.0, (speed, 0.0)).T

    brake = motor.gain * lost
    stop = motor.tau * math.log1p(speed / brake)
    assert 0.05 < stop < 1.0
    expected = np.where(t < stop, (speed + brake) * np.exp(-t / motor.tau) - brake, 0.0)
    assert np.abs(w - expected).max() < 1e-12 * speed * len(t)
    assert theta[-1] == pytest.approx(motor.tau * speed - brake * stop, rel=1e-12)


def test_a_reversal_with_friction_is_two_arcs_that_meet_at_standstill() -> None:
    """Down with end speed K (-V - u_c), then on from zero with K (-V + u_c), each in closed form."""
    volt, lost, speed = 2.0, 0.5, 20.0
    motor = replace(MOTOR, coulomb=lost, delay=0.0)
    t = DT * np.arange(500)

    w, theta = simulator.plain(motor, t, np.full(500, -volt), 0.0, (speed, 0.0)).T

    down, on = motor.gain * (-volt - lost), motor.gain * (-volt + lost)
    stop = motor.tau * math.log1p(-speed / down)
    late = t[-1] - stop
    way = motor.tau * speed + down * stop + on * (late + motor.tau * math.expm1(-late / motor.tau))
    assert theta[-1] == pytest.approx(way, rel=1e-12)
    assert w[-1] == pytest.approx(-on * math.expm1(-late / motor.tau), rel=1e-12)


@pytest.mark.parametrize(("volt", "turns"), [(0.499, False), (-0.499, False), (0.501, True), (-0.501, True)])
def test_a_shaft_at_rest_stays_so_below_its_coulomb_voltage(volt: float, turns: bool) -> None:
    motor = replace(MOTOR, coulomb=0.5)

    w = simulator.plain(motor, DT * np.arange(50), np.full(50, volt), 0.0, (0.0, 0.0))[:, 0]

    assert bool(np.any(w != 0.0)) == turns


@pytest.mark.parametrize("coulomb", [0.0, 0.5])
def test_the_short_steps_are_the_exact_motion_where_nothing_departs(coulomb: float) -> None:
    """The midpoint rule at τ/1000: (h/τ)²/6 of each change of speed, times τ; a reversal is met to its curvature, half (h/τ)²."""
    u = two_way_square()
    t = DT * np.arange(len(u))
    out, exact = np.empty((len(u), 2)), np.empty((len(u), 2))
    q = (23.7, 0.099, coulomb, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0)

    kernels.march(q, t, u, 0.0, t, (0.0, 0.0), 0.099 / 1000, out)
    kernels.turn((23.7, 0.099, coulomb), t, u, 0.0, t, (0.0, 0.0), exact)

    changes = len(edges(u))
    assert np.abs(out[:, 1] - exact[:, 1]).max() < changes * 1e-6 * 23.7 * 4.0 * 0.099


def test_a_winding_is_the_matrix_exponential_of_current_speed_and_angle() -> None:
    """L/R of 5 % of τ. The midpoint rule errs by (h/(L/R))²/6 = 7e-5 of what the fast pole does, 0.05 τ of a change of speed."""
    share = DEPARTURES["winding"].winding
    motor = replace(MOTOR, departure=replace(DEPARTURES["winding"], amplitude=2.0), delay=0.0)
    u = two_way_square()

    motion = simulator.moved(case(motor, u))

    a = np.array([[-1.0, -1.0 / 23.7, 0.0], [23.7 * share, 0.0, 0.0], [0.0, 0.0, 0.0]]) / (share * 0.099)
    a[2, 1] = 1.0
    joint = np.zeros((4, 4))
    joint[:3, :3], joint[0, 3] = a, 1.0 / (share * 0.099)
    e = expm(joint * DT)
    x, expected = np.array([0.0, 0.0, 0.3]), []
    for v in u:
        expected.append(x[2])
        x = e[:3, :3] @ x + e[:3, 3] * v
    bound_on_error = len(edges(u)) * 7e-5 * 0.05 * 0.099 * 23.7 * 4.0
    assert np.abs(motion.angle - np.array(expected)).max() < bound_on_error


def test_the_slow_pole_of_a_winding_and_its_delay_add_up_to_the_time_constant() -> None:
    true = DEPARTURES["winding"].true(0.099, 0.001, 0.0)

    slow = -1.0 / max(np.roots([0.05 * 0.099**2, 0.099, 1.0]))
    assert true["time_constant"] == pytest.approx((slow, slow))
    assert true["lag"][0] == pytest.approx(0.1)


def test_a_dead_band_under_voltages_of_one_size_is_a_lower_gain_and_under_two_it_is_not() -> None:
    departure = replace(DEPARTURES["dead-band"], amplitude=2.0)
    one = case(replace(MOTOR, departure=departure), two_way_square())
    two = case(one.motor, np.where(np.arange(600) < 300, one.u, 0.5 * one.u))

    assert runs.true(one, simulator.moved(one))["gain"] == pytest.approx((0.97 * 23.7, 23.7))
    assert runs.true(two, simulator.moved(two))["gain"] == pytest.approx((23.7, 23.7))


def test_sag_and_warming_change_what_friction_costs_and_not_what_an_ideal_motor_reaches() -> None:
    """At a steady speed (u - ω/K)/r = u_c, so that ω = K (u - r u_c)."""
    for departure, r in ((DEPARTURES["sag"], 1.05), (DEPARTURES["warming"], 1.05)):
        motor = replace(MOTOR, coulomb=0.4, departure=replace(departure, amplitude=2.0))

        motion = simulator.moved(case(motor, np.full(2000, 2.0)))

        # Warming goes on in the last time constant by 0.05 τ/T of u_c.
        assert motion.speed[-1] == pytest.approx(23.7 * (2.0 - r * 0.4), rel=3e-4)


def test_the_gain_between_two_voltages_behind_a_sagging_supply_is_one_that_counts_as_right() -> None:
    """Friction costs more at the larger voltage: the slope between the speeds is below the gain."""
    departure = replace(DEPARTURES["sag"], amplitude=2.0)
    motor = replace(MOTOR, coulomb=0.4, departure=departure)
    low, high = departure.gains(23.7, 0.4, one_size=False)

    ends = [simulator.moved(case(motor, np.full(1000, volt))).speed[-1] for volt in (1.0, 2.0)]

    assert low < ends[1] - ends[0] < high
    assert ends[1] - ends[0] < 0.99 * high


def test_friction_at_rest_is_larger_by_the_stribeck_share() -> None:
    departure = replace(DEPARTURES["stribeck"], slow=1.0)
    motor = replace(MOTOR, coulomb=0.4, departure=departure)

    assert np.ptp(simulator.moved(case(motor, np.full(300, 0.519))).angle) == 0.0
    assert np.ptp(simulator.moved(case(motor, np.full(300, 0.521))).angle) > 0.0


def test_teeth_hold_a_shaft_until_the_voltage_exceeds_them() -> None:
    """0.5 % of 2 V: 10 mV at the worst angle, past which it creeps the slower the closer that is."""
    departure = replace(DEPARTURES["cogging"], amplitude=2.0, teeth=7, phase=0.4)
    motor = replace(MOTOR, departure=departure)

    held = simulator.moved(case(motor, np.full(5000, 0.0099)))
    freed = simulator.moved(case(motor, np.full(5000, 0.0115)))

    assert np.ptp(held.angle) < 2 * np.pi / 7
    assert np.ptp(freed.angle) > 2 * np.pi / 7


def test_play_is_lost_at_each_turn() -> None:
    angle = np.concatenate([np.linspace(0.0, 1.0, 101), np.linspace(1.0, 0.0, 101)[1:]])

    seen = simulator.played(angle, 0.1)

    assert seen.max() == pytest.approx(0.95)
    assert seen[110] == pytest.approx(0.95)  # back by all of the gap, and not a bit further
    assert seen[-1] == pytest.approx(0.05)


def test_a_dead_band_is_missing_from_each_voltage() -> None:
    motor = replace(MOTOR, departure=replace(DEPARTURES["dead-band"], amplitude=2.0))

    _, volts = simulator.acting(motor, np.arange(4.0), np.array([2.0, -1.0, 0.05, 0.0]))

    assert volts.tolist() == pytest.approx([1.94, -0.94, 0.0, 0.0])


def test_the_random_torque_moves_the_speed_by_what_it_is_drawn_for() -> None:
    """K √(intensity/(2 τ)), 1 % of the top speed; 400 time constants know a standard deviation to √(1/400) = 5 %, 4 of these."""
    wander, tau = 0.01 * 2.0, 0.04
    motor = replace(MOTOR, tau=tau, torque=2 * tau * wander**2)

    motion = simulator.moved(case(motor, np.zeros(4000)))

    assert np.std(motion.speed[100:]) == pytest.approx(23.7 * wander, rel=0.2)


def test_the_filter_whitens_as_the_dense_covariance_of_all_kicks_does() -> None:
    """J'S⁻¹J, with S summed over the responses to each kick in closed form."""
    n, noise = 30, 1e-3
    motor = replace(MOTOR, torque=1e-5, noise=noise)
    step, t = DT / simulator.KICKS, DT * np.arange(n)
    begin = step * np.arange(simulator.KICKS * n)

    def ramped(s: Array) -> Array:
        s = np.maximum(s, 0.0)
        return np.asarray(s + motor.tau * np.expm1(-s / motor.tau))

    since = t[:, None] - begin
    response = motor.gain * (ramped(since) - ramped(since - step))
    variance = noise**2 + motor.quantum**2 / 12
    dense = motor.torque / step * response @ response.T + variance * np.eye(n)
    columns = np.column_stack([np.ones(n), t, np.sin(50 * t)])

    whitened = columns.copy()
    each, kicked = bound.transition(motor)
    every = np.tile(each, (n, 1, 1))
    kernels.whiten(every, kicked, np.ones(n, dtype=bool), False, np.full(n, variance), whitened)

    assert whitened.T @ whitened == pytest.approx(columns.T @ np.linalg.solve(dense, columns), rel=1e-9)


def test_the_bound_is_what_least_squares_scatters_by() -> None:
    """200 fits of the superposed step responses know a standard deviation to √(1/400) = 5 %; four of these."""
    u, random = two_way_square(400, 50), np.random.default_rng(4)
    noise = 0.02
    motor = replace(MOTOR, noise=noise, counts=10_000_000)
    true = np.array([23.7, 0.099, 0.3 * DT, 0.0, 0.3, 0.0])
    clean = superposed(true, u)
    scale = np.array([10.0, 0.1, DT, 0.1, 1.0, 1.0])

    found = np.array(
        [
            least_squares(
                lambda x, y: (superposed(x * scale, u) - y) / noise,
                true / scale,
                args=(clean + noise * random.standard_normal(len(u)),),
            ).x
            * scale
            for _ in range(200)
        ]
    )
    one = case(motor, u)
    least = bound.bound(one, simulator.moved(one))

    lag = found[:, 1] + found[:, 2]
    assert found[:, 0].std() / 23.7 == pytest.approx(least["gain"], rel=0.2)
    assert found[:, 1].std() / 0.099 == pytest.approx(least["time_constant"], rel=0.2)
    assert found[:, 2].std() == pytest.approx(least["delay"], rel=0.2)
    assert lag.std() == pytest.approx(least["lag"], rel=0.2)


def test_who_can_rule_out_nothing_knows_less() -> None:
    """A motor without friction may have some, and a delay may be a lag."""
    u = two_way_square(400, 50)
    for coulomb, delay in ((0.0, 0.0), (0.3, 0.0), (0.3, 2.0 * DT)):
        one = case(replace(MOTOR, coulomb=coulomb, delay=delay, noise=0.02), u)
        motion = simulator.moved(one)

        least, more = bound.bound(one, motion), bound.cautious(one, motion)

        assert all(more[name] >= (1 - 1e-6) * least[name] for name in ("gain", "time_constant", "lag"))
        assert more["gain"] > least["gain"]


def test_a_delay_of_next_to_nothing_is_no_lag(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its lag would be marched in parts of it: a billion steps a second."""
    one = case(replace(MOTOR, delay=1e-4 * DT, noise=0.02), two_way_square(400, 50))
    motion = simulator.moved(one)

    def no_lag(*_: object) -> None:
        raise AssertionError("the lag of next to nothing was marched")

    monkeypatch.setattr(bound, "_by_lag", no_lag)

    assert bound.cautious(one, motion)["gain"] >= (1 - 1e-6) * bound.bound(one, motion)["gain"]


def test_a_delay_that_is_all_lag_is_a_second_pole() -> None:
    """K (1 - (τ e^(-t/τ) - d e^(-t/d))/(τ - d)) less what the delay makes, to the square of a sixteenth of d over 24."""
    tau, d = 0.099, 2.0 * DT
    motor = replace(MOTOR, delay=d)
    one = replace(case(motor, np.full(300, 1.0)), output="speed")
    motion = simulator.Motion(speed=np.zeros(300), angle=np.zeros(300), before=0.0)
    t = simulator.rows(one)[0]

    both = bound._by_lag(one, motor, motion).sum(axis=1)

    lagged = 1.0 - (tau * np.exp(-t / tau) - d * np.exp(-t / d)) / (tau - d)
    late = np.where(t > d, 1.0 - np.exp(-np.maximum(t - d, 0.0) / tau), 0.0)
    assert np.abs(both - motor.gain * (lagged - late)).max() < motor.gain * d / tau / 16**2


def test_one_level_from_rest_bounds_the_time_constant_and_not_the_gain() -> None:
    one = case(replace(MOTOR, coulomb=0.3), np.full(400, 2.0))

    least = bound.bound(one, simulator.moved(one))

    assert least["gain"] > 1.0
    assert least["time_constant"] < 1e-3


def test_the_draws_are_those_of_the_population() -> None:
    """500 draws; a share of p is known to √(p (1 - p)/500), 2.2 % for 0.45: four of these."""
    cases = [drawn((16, n)) for n in range(500)]

    outputs = Counter(each.output for each in cases)
    for name, share in (("counts", 0.45), ("rad", 0.2), ("differentiated", 0.2), ("speed", 0.15)):
        assert outputs[name] / 500 == pytest.approx(share, abs=4 * math.sqrt(share * (1 - share) / 500))
    assert {each.input for each in cases} == set(INPUTS)
    assert {each.start for each in cases} == {"lead", "running", "cold"}
    for each in cases:
        motor = each.motor
        assert 3e-3 <= motor.tau <= 3.0
        assert 0.5 <= motor.gain <= 500.0
        assert 1.999 <= motor.tau / motor.sample_time <= 500.001
        assert 1e-4 <= motor.sample_time <= 0.05
        assert 12 <= motor.counts <= 65536
        assert 0.0 <= motor.coulomb <= 0.4 * each.amplitude
        assert 0.0 <= motor.delay <= 3.0 * motor.sample_time
        assert np.abs(each.u).max() <= each.amplitude * (1 + 1e-12)


def test_a_motor_of_a_number_is_always_the_same_one() -> None:
    one, other = (runs.dataset(7) for _ in range(2))

    assert np.array_equal(one.y, other.y)
    assert not np.array_equal(one.y[:20], runs.dataset(8).y[:20])


@pytest.mark.parametrize("output", ["counts", "rad", "differentiated", "speed"])
def test_a_record_shows_the_shaft(output: str) -> None:
    """Counts and angles to half a count each way, a speed to the noise that was drawn; differences add up to the angle."""
    n = next(n for n in range(200) if (c := drawn((16, n))).output == output and c.input == "prbs_two")
    one = drawn((16, n))
    motion, data = simulator.moved(one), runs.dataset(n)
    # The first rows of a record that begins in motion are left out, as nobody knows which input they answer.
    angles, speeds = motion.angle[-len(data.y) :], motion.speed[-len(data.y) :]
    assert len(data.y) > 0.9 * len(motion.angle)
    slack = motors.TURN / one.motor.counts + (5.0 * one.motor.noise if output != "speed" else 0.0)

    if output == "speed":
        assert np.std(data.y - speeds) == pytest.approx(one.motor.noise, rel=5 / math.sqrt(2 * len(data.y)))
    elif output == "differentiated":
        angle = np.cumsum(data.y) * one.motor.sample_time
        assert np.abs((angle - angle[0]) - (angles - angles[0])).max() <= 2 * slack
    else:
        assert np.abs(data.y - angles).max() <= slack


def row(
    number: int = 0, *, verdict: str = "trusted", gain: float = 10.0, sd: float = 0.1, **more: Any
) -> dict[str, Any]:
    true = {"gain": (10.0, 10.0), "coulomb_voltage": (0.0, 0.0)}
    estimates = {"gain": (gain, sd, gain - 1.96 * sd, gain + 1.96 * sd)}
    bounds = {"gain": 0.01, "time_constant": 0.01}
    return {"number": number, "verdict": verdict, "true": true, "estimates": estimates, "bound": bounds, "cautious": bounds,
            "events": 9, "seconds": 0.1, "findings": {}, **more}  # fmt: skip


def test_an_interval_is_widened_towards_the_truth_by_what_it_misses() -> None:
    assert judge.widening((10.0, 0.5, 9.0, 11.0), (12.0, 12.0)) == pytest.approx(2.0)
    assert judge.widening((10.0, 0.5, 9.0, 11.0), (9.5, 12.0)) == 0.0
    assert judge.widening((10.0, 0.5, 6.0, 11.0), (8.0, 8.0)) == pytest.approx(0.5)
    assert judge.widening((0.0, 0.5, 0.0, 1.0), (-1.0, -1.0)) == math.inf


def test_who_is_far_off_is_named_and_what_is_refused_states_nothing() -> None:
    rows = [
        row(3, gain=10.2),
        row(5, gain=10.4),
        row(6, gain=99.0, verdict="refused"),
        row(7, gain=10.4, verdict="doubtful"),
    ]

    (figure,) = (f for f in population.figures(rows) if "3 sd off" in f.what)

    assert "(numbers 5)" in figure.what
    assert figure.value == 50.0
    assert judge.coverage(rows, "gain") == (0, 3)
    assert judge.off(rows[1])["gain"] == pytest.approx(4.0, rel=1e-4)


def test_a_lag_that_follows_from_its_parts_does_not_count_twice_and_one_that_is_stated_does() -> None:
    interval = (0.2, 0.01, 0.18, 0.22)
    true = {"time_constant": (0.1, 0.1), "delay": (0.0, 0.0), "lag": (0.1, 0.1)}
    derived = row(true=true, estimates={"time_constant": interval, "lag": interval})
    together = row(true=true, estimates={"lag": interval}, combinations=["lag"])

    assert set(judge.off(derived)) == {"time_constant"}
    assert set(judge.off(together)) == {"lag"}


def test_what_is_bounded_holds_where_the_truth_is_below() -> None:
    rows = [
        row(bounds={"coulomb_voltage": [-0.1, 0.2]}),
        row(bounds={"coulomb_voltage": [-0.3, -0.1]}),
        row(verdict="refused"),
    ]

    assert judge.bounded(rows) == (1, 2)


def test_a_combination_is_true_where_its_parts_are() -> None:
    """K (|u| - u_c) in the sense of u, and K/τ; what is nowhere exact goes from its least to its most."""
    values = {"gain": (10.0, 10.0), "time_constant": (0.1, 0.2), "coulomb_voltage": (0.5, 0.6)}

    found = runs.together(values, -2.0)

    assert found["acceleration"] == (50.0, 100.0)
    assert found["speed_at_level"] == pytest.approx((-15.0, -14.0))


def test_the_voltage_of_a_stated_speed_is_known_exactly() -> None:
    """A step from rest: its speed is stated, gain and friction aren't."""
    n = next(
        n
        for n in range(100)
        if (c := drawn((16, n))).input == "step" and c.start == "cold" and c.motor.coulomb
    )

    found = runs.outcome(n)

    assert "speed_at_level" in found["combinations"]
    assert found["level"] == pytest.approx(drawn((16, n)).amplitude, rel=1e-9)
    assert "gain" not in found["estimates"]


@pytest.mark.parametrize(
    ("u", "count"),
    [
        (np.repeat([2.0, -2.0, 2.0], 10), 3),
        (np.repeat([0.0, 2.0], 10), 1),
        (np.linspace(0.0, 2.0, 50), 1),
        (np.sin(2 * np.pi * np.linspace(0.0, 3.0, 301)), 7),  # up, and six turning points
    ],
)
def test_events_are_jumps_or_turning_points(u: Array, count: int) -> None:
    assert runs.events(u, 0.0) == count


def test_a_cause_counts_whatever_its_severity_and_a_symptom_does_not() -> None:
    told = row(findings={"info": ["ripple", "offset-found"], "warning": ["residual-coloured"]})

    assert judge.causes(told) == ["ripple"]


def test_widths_are_those_of_records_that_could_be_known() -> None:
    vague = row(bound={"gain": 0.5, "time_constant": 0.01})

    assert judge.ratios([row(sd=0.2), vague], "gain") == pytest.approx([2.0])


def test_a_record_over_its_time_is_given_up_and_no_handler_of_errors_keeps_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def endless(data: object) -> None:
        while True:
            try:
                time.sleep(0.0)
            except Exception:
                continue

    monkeypatch.setattr(runs, "identify", endless)
    monkeypatch.setattr(runs, "LIMIT", 0.05)

    assert runs.outcome(4)["verdict"] == "over time"


def test_a_crash_is_reported_with_its_words(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(data: object) -> None:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(runs, "identify", broken)

    found = runs.outcome(4)

    assert (found["verdict"], found["error"]) == ("crashed", "ZeroDivisionError: by nothing")


def test_what_is_kept_in_a_table_is_judged_again(tmp_path: Any, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "table.json"
    path.write_text(json.dumps([row(1), row(2, gain=10.4)]), encoding="utf-8")

    assert population.command(["--from-table", str(path)]) == 0
    assert "(numbers 2)" in capsys.readouterr().out


@pytest.mark.parametrize("departure", DEPARTURES.values(), ids=lambda d: d.name)
def test_a_departure_departs_and_none_does_not(departure: Departure) -> None:
    """The same motor and input with and without it: the readings differ by more than rounding does."""
    n = next(
        n
        for n in range(100)
        if (c := drawn((16, n))).input == "steps" and c.output == "rad" and c.motor.coulomb
    )
    none = drawn((16, n))
    departed = departure.drawn(np.random.default_rng(1), none.amplitude, none.motor.gain)
    one = replace(none, motor=replace(none.motor, departure=departed))

    seen, plain = (simulator.read(each, simulator.moved(each)) for each in (one, none))

    assert np.abs(seen - plain).max() > 0.0


def test_a_rest_tells_an_encoder_once_where_the_shaft_is() -> None:
    case = replace(
        next(each for each in map(drawn, ((18, n) for n in range(400))) if each.output == "counts"),
        input="steps",
    )
    quiet = replace(case, motor=replace(case.motor, noise=0.0))
    sliding = np.array([True, False, False, False, False, True, True, False, False])

    found = bound._variances(quiet, sliding) / (quiet.motor.quantum**2 / 12)

    assert found == pytest.approx([1, 4, 4, 4, 4, 1, 1, 2, 2])


def test_a_turn_keeps_of_a_deviation_what_friction_leaves() -> None:
    """(2 - 0.5)/(2 + 0.5) of it in a tick in which the shaft turns back under 2 V, nothing in one in which it stops."""
    motor, u = replace(MOTOR, coulomb=0.5, delay=0.0), two_way_square()
    one = case(motor, u)
    motion = simulator.moved(one)
    each, _ = bound.transition(motor)
    transitions = np.tile(each, (len(u), 1, 1))

    bound._turn_back(one, motion, transitions)

    turned = np.flatnonzero(motion.speed[:-1] * motion.speed[1:] < 0)
    assert len(turned) == 9  # ten half-periods
    # Of a deviation of 1e-5 of the speed the differences keep five digits at least.
    assert transitions[turned, 0, 0] == pytest.approx(0.6 * each[0, 0], rel=1e-4)
    still = np.ones(len(u), dtype=bool)
    still[turned] = False
    assert (transitions[still][1:] == each).all()
