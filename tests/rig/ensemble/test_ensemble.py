"""Ensembles: truth from algebra, the same motors whatever the threads and the number, and sentences for what can't be."""

from typing import Any

import numpy as np
import pytest

import servobench as sb
from servobench.core.errors import UnknownName, UsageError
from servobench.rig.devices.twin import TwinSettings
from servobench.rig.ensemble.ensemble import ensemble
from servobench.rig.ensemble.motors import Motors
from servobench.rig.ensemble.outcomes import phase_margins
from servobench.rig.ensemble.simulation import simulate
from servobench.rig.ensemble.tolerances import PARAMETERS, draw_motors, tolerances_of
from servobench.systems.control.pid import Pid
from servobench.systems.control.sampled_law import sampled_law
from servobench.systems.sampled_loop import sampled_loop, sampled_margins
from servobench.systems.transfer_function import TransferFunction

SHORT = sb.Experiment(duration=0.1)
PLAIN = TwinSettings(viscous_friction=0.0, coulomb_torque=0.0, inductance=0.0)
FIVE = {"resistance": "5%", "motor_constant": "5%", "inertia": "5%"}


def test_without_friction_gain_and_time_constant_are_those_of_the_text_books() -> None:
    motors = ensemble(PLAIN, SHORT, 50, FIVE)

    r, k, j = (motors.parameters[name] for name in FIVE)
    assert np.allclose(motors.outcomes["gain"], 1 / k, rtol=1e-12)
    assert np.allclose(motors.outcomes["time_constant"], r * j / k**2, rtol=1e-12)


def test_the_time_constant_is_that_of_the_slow_eigenvalue() -> None:
    twin = TwinSettings()
    motors = Motors(parameters=draw_motors(twin, tolerances_of(twin, {**FIVE, "inductance": "50%"}), 20, 2))

    for number in range(20):
        assert motors.time_constant[number] == pytest.approx(motors.one(number).time_constant, rel=1e-9)
        assert motors.gain[number] == pytest.approx(motors.one(number).gain, rel=1e-12)


def test_the_speed_that_a_motor_ends_at_is_its_gain_times_the_voltage() -> None:
    rest = sb.Experiment(signal=sb.Constant(value="2 V"), duration=5.0)
    motors = ensemble(PLAIN, rest, 20, FIVE)

    # After 50 time constants of 0.1 s nothing is left of the beginning: e^-50 = 2e-22.
    assert np.allclose(motors.final[1], 2.0 * motors.outcomes["gain"], rtol=1e-9)


def test_shares_of_the_variance_are_those_of_calculus() -> None:
    """τ = R J/k²: relative derivatives 1, 1 and -2, so 1 % of each makes shares of 1/6, 1/6 and 4/6."""
    motors = ensemble(PLAIN, SHORT, 4000, dict.fromkeys(FIVE, "1%"))
    shares = {each.parameter: each.share for each in motors.sensitivities if each.outcome == "time_constant"}
    effects = {
        each.parameter: each.effect for each in motors.sensitivities if each.outcome == "time_constant"
    }
    tau = motors.nominal["time_constant"]

    # Of k⁻² the two ends of 1 % differ from a straight line by the cubic term, 4 (0.01)² of the effect.
    assert shares == pytest.approx({"resistance": 1 / 6, "inertia": 1 / 6, "motor_constant": 4 / 6}, rel=1e-3)
    assert effects == pytest.approx(
        {"resistance": 0.01 * tau, "inertia": 0.01 * tau, "motor_constant": -0.02 * tau}, rel=1e-3
    )
    assert {
        each.parameter: each.share for each in motors.sensitivities if each.outcome == "gain"
    } == pytest.approx({"motor_constant": 1.0, "resistance": 0.0, "inertia": 0.0}, abs=1e-12)
    # A sample variance of 4000 has a standard deviation of at most √(2/4000) = 2.2 % of itself; three of them.
    assert motors.linear_share("time_constant") == pytest.approx(1.0, abs=0.067)


def test_the_draws_fill_the_tolerance_evenly_and_leave_the_rest_alone() -> None:
    motors = ensemble(TwinSettings(), SHORT, 3000, {"resistance": "10%", "coulomb_torque": "2e-4 N*m"})

    r, tc = motors.parameters["resistance"], motors.parameters["coulomb_torque"]
    assert 7.56 <= r.min() < 7.57
    assert 9.23 < r.max() <= 9.24
    assert 6e-4 <= tc.min() < tc.max() <= 1e-3
    # An even distribution of ±0.84 Ω has a standard deviation of 0.84/√3; that of 3000 is known to 1 % (√(0.2/3000)); three.
    assert r.std() == pytest.approx(0.84 / np.sqrt(3), rel=0.03)
    assert abs(np.corrcoef(r, tc)[0, 1]) < 3 / np.sqrt(3000)
    assert np.ptp(motors.parameters["inertia"]) == 0.0


NOISY = TwinSettings(torque_noise=2e-5)
CLOSED = sb.Experiment(
    signal=sb.Step(final=1.0, start=0.1), duration=0.6, controller=Pid(kp=10.0, ki=5.0, kd=0.3)
)


@pytest.mark.parametrize("experiment", [SHORT, CLOSED], ids=["open loop", "closed loop"])
def test_the_result_is_the_same_to_the_last_bit_for_any_number_of_threads(experiment: sb.Experiment) -> None:
    one, three = (ensemble(NOISY, experiment, 100, FIVE, seed=4, threads=threads) for threads in (1, 3))

    assert np.array_equal(one.final, three.final)
    assert all(np.array_equal(a.values, b.values) for a, b in zip(one.bands, three.bands, strict=True))


@pytest.mark.parametrize("n", [1, 16, 17])
def test_a_motor_is_the_same_in_a_small_ensemble_and_in_a_large_one(n: int) -> None:
    few, many = (ensemble(NOISY, SHORT, count, FIVE, seed=4) for count in (n, 50))

    assert len(few) == n
    assert np.array_equal(few.final, many.final[:, :n])
    assert np.array_equal(few.parameters["inertia"], many.parameters["inertia"][:n])


def test_motors_from_the_middle_of_an_ensemble_are_those_of_the_whole() -> None:
    tolerances = tolerances_of(NOISY, FIVE)
    drawn = draw_motors(NOISY, tolerances, 40, 4)
    whole = simulate(Motors(parameters=drawn), SHORT, NOISY, seed=4, looks=np.array([50]), recorded=True)
    part = Motors(parameters={name: values[19:30] for name, values in drawn.items()})
    some = simulate(part, SHORT, NOISY, seed=4, looks=np.array([50]), recorded=True, offset=19)

    assert np.array_equal(some.states, whole.states[:, :, 19:30])
    assert np.array_equal(some.counts, whole.counts[19:30])


def test_another_seed_draws_other_motors_and_other_torques() -> None:
    one, other = (ensemble(NOISY, SHORT, 20, FIVE, seed=seed) for seed in (1, 2))
    alike = [ensemble(NOISY, SHORT, 2, {}, seed=seed).final[1] for seed in (1, 2)]

    assert not np.array_equal(one.parameters["resistance"], other.parameters["resistance"])
    assert len({float(value) for value in np.concatenate(alike)}) == 4


def test_a_random_torque_moves_the_speed_as_much_as_theory_says() -> None:
    """White torque of intensity s: τ dω = -ω dt + s τ/J dW, so var ω = s² τ/(2 J²) once it has settled."""
    twin = PLAIN.model_copy(update={"torque_noise": 2e-5})
    still = sb.Experiment(signal=sb.Constant(value="0 V"), duration=1.5)
    motors = ensemble(twin, still, 4000, {}, seed=11)

    inertia, tau = motors.parameters["inertia"][0], motors.nominal["time_constant"]
    speed = motors.final[1]
    # Three standard deviations of a mean and of a variance of 4000; held over a tick it is less by (h/2τ)²/3 = 3e-5.
    sd = 2e-5 / inertia * np.sqrt(tau / 2)
    assert abs(speed.mean()) < 3 * sd / np.sqrt(4000)
    assert speed.var() == pytest.approx(sd**2, rel=3 * np.sqrt(2 / 4000))


def test_the_normal_numbers_are_normal_and_independent() -> None:
    from scipy.stats import kstest

    from servobench.rig.ensemble import kernels

    keys = np.empty(100, np.uint64)
    kernels.keys_of(np.uint64(5), keys)
    numbers = np.array([np.ravel([kernels.normal_pair(key, pair) for pair in range(100)]) for key in keys])

    assert kstest(numbers.ravel(), "norm").pvalue > 1e-3
    for one, other in ((numbers[:, :-1], numbers[:, 1:]), (numbers[:-1], numbers[1:])):
        assert abs(np.corrcoef(one.ravel(), other.ravel())[0, 1]) < 4 / np.sqrt(one.size)


def test_the_bands_enclose_the_shares_that_they_say() -> None:
    motors = ensemble("qube_servo_2", SHORT, 400, FIVE)

    speed = motors.bands[0]
    assert speed.values.shape == (5, 51)
    assert (np.diff(speed.values, axis=0) >= 0).all()
    below = [(motors.final[1] < line).mean() for line in speed.values[:, -1]]
    assert below == pytest.approx([0.05, 0.25, 0.5, 0.75, 0.95], abs=1 / 400)


def test_overshoot_and_settling_time_are_those_of_a_second_order_loop() -> None:
    """P control of a motor without friction: overshoot e^(-π ζ/√(1-ζ²)) (Franklin, Powell and Workman 1998, section 2.2)."""
    fast = sb.Experiment(signal=sb.Step(final=1.0), duration=3.0, sample_time=2e-4, controller=Pid(kp=1.0))
    twin = PLAIN.model_copy(update={"counts_per_rev": 2_000_000.0, "counter_bits": 32})
    motors = ensemble(twin, fast, 8, FIVE)

    k, tau = motors.outcomes["gain"], motors.outcomes["time_constant"]
    natural = np.sqrt(k / tau)
    damping = 1 / (2 * natural * tau)
    # The sampled loop lags by half a tick, 1e-4 s, against which the phase margin loses ω/1e4, 1.5e-3 rad: a half per cent.
    expected = np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    assert np.allclose(motors.outcomes["overshoot"], expected, rtol=0.01)
    # The envelope e^(-ζ ω t)/√(1-ζ²) leaves 2 % at this time; the response itself does so at most half a period before.
    latest = -np.log(0.02 * np.sqrt(1 - damping**2)) / (damping * natural)
    half_period = np.pi / (natural * np.sqrt(1 - damping**2))
    assert (motors.outcomes["settling_time"] < latest + 1e-3).all()
    assert (motors.outcomes["settling_time"] > latest - half_period).all()


def test_phase_margins_are_those_of_the_sampled_loop() -> None:
    twin = TwinSettings()
    motors = Motors(parameters=draw_motors(twin, tolerances_of(twin, FIVE), 5, 1))
    found = phase_margins(motors, CLOSED)

    law = sampled_law(CLOSED.controller, CLOSED.sample_time)
    for number in range(5):
        r, l, k, j, b, _ = motors.physics[:, number]
        motor = TransferFunction(
            numerator=(k,),
            denominator=(l * j, r * j + l * b, r * b + k * k, 0.0),
            output="position",
            unit="rad/V",
        )
        expected = sampled_margins(sampled_loop(law, motor, CLOSED.sample_time)).phase_margin
        # Cells of 2.3 % in frequency, and a phase that bends by less than 1 rad per factor e²: (0.023)²/8 = 7e-5 rad.
        assert found[number] == pytest.approx(expected, abs=1e-4)


def test_a_dead_band_beyond_the_limit_leaves_nothing() -> None:
    motors = ensemble(TwinSettings(dead_band=3.0, amplifier_limit=2.0), SHORT, 3, FIVE)

    assert not motors.final[1].any()


def test_a_step_that_comes_after_the_end_has_no_overshoot() -> None:
    late = CLOSED.model_copy(update={"signal": sb.Step(final=1.0, start=2.0)})

    assert "overshoot" not in ensemble("qube_servo_2", late, 3, FIVE).outcomes


def test_counts_are_kept_where_they_are_asked_for() -> None:
    spread = {"amplifier_limit": "20%"}
    plain, kept, limited = (
        ensemble("qube_servo_2", SHORT, 3, {}, counts=False),
        ensemble("qube_servo_2", SHORT, 3, {}, counts=True),
        ensemble(TwinSettings(amplifier_limit=1.0), SHORT, 3, spread, counts=True),
    )

    assert plain.counts is None
    assert plain.applied is None
    assert kept.counts is not None
    assert kept.counts.shape == (3, 50)
    assert kept.applied is not None
    assert kept.applied.shape == (50,)
    assert limited.applied is not None
    assert np.array_equal(limited.applied[:, 0], limited.parameters["amplifier_limit"])


def test_a_loop_that_never_settles_has_no_settling_time() -> None:
    weak = CLOSED.model_copy(update={"controller": Pid(kp=0.01)})
    motors = ensemble("qube_servo_2", weak, 4, FIVE)

    assert np.isnan(motors.outcomes["settling_time"]).all()
    assert motors.to_dict()["outcomes"]["settling_time"]["known"] == 0


def test_what_it_says_of_itself_is_plain_json() -> None:
    import json

    motors = ensemble("qube_servo_2", CLOSED, 5, FIVE)
    told = json.loads(json.dumps(motors.to_dict(), allow_nan=False))

    assert told["schema"] == "servobench.ensemble/1"
    assert told["tolerances"]["resistance"] == {"value": 8.4, "half": pytest.approx(0.42), "unit": "Ω"}
    assert "5 motors" in repr(motors)


@pytest.mark.parametrize(
    ("name", "given", "half"),
    [
        ("inertia", "1e-6 kg*m^2", 1e-6),
        ("inertia", "1 g·m²", 1e-3),
        ("resistance", "0.42 ohm", 0.42),
        ("resistance", " 5 % ", 0.42),
        ("resistance", 0.05, 0.42),
        ("coulomb_torque", "0.2 mN*m", 2e-4),
        ("inductance", "0.1mH", 1e-4),
    ],
)
def test_a_tolerance_may_have_a_unit(name: str, given: object, half: float) -> None:
    heavy = TwinSettings(rotor_inertia=1.0)
    (found,) = tolerances_of(heavy, {name: given})

    assert found.half == pytest.approx(half, rel=1e-12)


WRONG: dict[str, tuple[dict[str, Any], type[UsageError], str]] = {
    "no motors": ({"n": 0}, UsageError, "n is 0 .*from 1 to"),
    "half a motor": ({"n": 2.5}, UsageError, "n is 2.5"),
    "too many": ({"n": 10**9}, UsageError, "from 1 to 200000"),
    "a seed below zero": ({"seed": -1}, UsageError, "seed is -1"),
    "no threads": ({"threads": 0}, UsageError, "threads is 0"),
    "below zero": ({"spread": {"resistance": "-5%"}}, UsageError, "resistance=-5%.*0 or more"),
    "all of it": ({"spread": {"resistance": "100%"}}, UsageError, "less than 100%"),
    "more friction than there is": ({"spread": {"coulomb_torque": "101%"}}, UsageError, "at most 100%"),
    "more than all": ({"spread": {"inertia": 1.2}}, UsageError, "less than 100%"),
    "no number": ({"spread": {"resistance": float("nan")}}, UsageError, "0 or more"),
    "words": ({"spread": {"resistance": "much%"}}, UsageError, "expected a number before the %"),
    "a bare number": ({"spread": {"resistance": "5"}}, UsageError, "percentage such as 10%"),
    "another unit": ({"spread": {"resistance": "5 V"}}, UsageError, "Ω"),
    "a list": ({"spread": ["resistance"]}, UsageError, "expected a dict"),
    "an array": ({"spread": {"resistance": [0.1]}}, UsageError, "resistance is"),
    "a name": ({"spread": {"resistanse": "5%"}}, UnknownName, "resistance"),
    "a part of nothing": (
        {"motor": PLAIN, "spread": {"coulomb_torque": "5%"}},
        UsageError,
        "Coulomb torque is 0",
    ),
    "a motor": ({"motor": "qube_servo_9"}, UnknownName, "qube_servo_2"),
    "a number for a motor": ({"motor": 3.0}, UsageError, "motor is 3.0"),
    "no experiment": ({"experiment": "paper"}, UsageError, r"such as servobench\.Experiment\("),
    "endless": ({"experiment": sb.Experiment(duration=None)}, UsageError, "endless"),
    "a delay": ({"motor": TwinSettings(delay=0.001)}, UsageError, "delay"),
    "another solver": ({"motor": TwinSettings(solver="rk4")}, UsageError, "solver"),
    "counts beyond 32 bits": (
        {"motor": TwinSettings(counts_per_rev=1e9)},
        UsageError,
        "the encoder may count",
    ),
    "a torque beyond numbers": (
        {"motor": TwinSettings(torque_noise=1e200)},
        UsageError,
        "the encoder may count",
    ),
    "a motor beyond numbers": ({"motor": TwinSettings(inductance=1e-320)}, UsageError, "motor 0"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_cannot_be_is_reported_in_a_sentence(wrong: str) -> None:
    changed, kind, told = WRONG[wrong]
    given: dict[str, Any] = {"motor": "qube_servo_2", "experiment": SHORT, "n": 3, "spread": FIVE}

    with pytest.raises(kind, match=told):
        ensemble(**{**given, **changed})


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_parameter_may_have_a_tolerance(name: str) -> None:
    motors = ensemble("qube_servo_2", SHORT, 3, {name: "10%"})

    assert np.ptp(motors.parameters[name]) > 0
    assert motors.tolerances[0].relative == pytest.approx(0.1)
