"""Gains against the poles that were wished, margins against python-control's sampled loop, predictions against the twin."""

import math
import re
from functools import cache
from typing import Any

import control as ct
import numpy as np
import pytest
from scipy.optimize import brentq

import servobench as sb
from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.export.first_order import first_order_motor
from servobench.export.summary import ResultSummary
from servobench.rig.experiment import Experiment, read_experiment
from servobench.systems.control.lead import Lead
from servobench.systems.control.pid import Pid
from servobench.systems.signals.square import Square
from servobench.systems.tuning.base import METHODS, Wish
from servobench.systems.tuning.loop import least_margins, loop_margins, nominal_margins, open_loop
from servobench.systems.tuning.response import unit_step
from servobench.systems.tuning.tune import LEAST_FACTOR, LEAST_PHASE, TuningResult
from servobench.systems.tuning.tune import tune as tune_motor
from tests.export.conftest import COULOMB, DELAY, GAIN, TAU, document

H = 0.002


def wish(**changed: Any) -> Wish:
    return Wish(**{"controller": "pid", "output": "position", "sample_time": H, **changed})


def answered(**changed: Any) -> ResultSummary:
    return ResultSummary.from_document(document(**changed), "the result")


def tune(answer: ResultSummary, method: str, wish: Wish) -> TuningResult:
    return tune_motor(first_order_motor(answer, "tune", "rad"), method, wish)


@cache
def tuned(method: str = "pole_placement", **changed: Any) -> TuningResult:
    return tune(answered(), method, wish(**changed))


# ---- what is wished; that the poles are there is held in test_placement


@pytest.mark.parametrize("output", ["position", "speed"])
def test_lambda_tuning_rises_with_the_wished_time_constant(output: Any) -> None:
    wished = 0.08
    made = tuned("lambda_tuning", output=output, closed_loop=wished)

    # 1/(λs + 1) rises from 10 to 90 % in ln 9 · λ. Dead time and filter, θ = 18 ms in all, add poles that are so far out: what
    # they change of the rise is of second order, (θ/λ)² = 5 %, and no more than twice that.
    assert made.response["rise_time"].value == pytest.approx(math.log(9) * wished, rel=0.1)
    assert made.response["overshoot"].value < 0.01


# ---- margins


def sampled_loop(controller: Any) -> Any:
    """The loop as it is computed, tick by tick, by python-control: hold, whole ticks of delay, difference, trapezoid filter."""
    whole, part = divmod(DELAY, H)
    assert whole == 0
    # An input that acts after a part of a tick: the rest of the tick of this one, and that part of the one before.
    motor = ct.ss(ct.tf([GAIN], [TAU, 1, 0]))
    a, b, c = np.asarray(motor.A), np.asarray(motor.B), np.asarray(motor.C)

    def held(length: float) -> tuple[Array, Array]:
        both = ct.sample_system(ct.ss(a, b, c, 0), length, method="zoh")
        return np.asarray(both.A), np.asarray(both.B)

    # u[k-1] acts for `part`, then u[k] for the rest.
    (rest_a, late), (part_a, early) = held(H - part), held(part)
    whole_a, held_before = rest_a @ part_a, rest_a @ early
    plant = ct.ss(
        np.block([[whole_a, held_before], [np.zeros((1, 3))]]),
        np.vstack([late, [[1.0]]]),
        np.hstack([c, [[0.0]]]),
        0,
        H,
    )
    filtered = ct.ss(
        ct.sample_system(ct.tf([controller.cutoff], [1, controller.cutoff]), H, method="bilinear")
    )
    speed = ct.ss(ct.tf([1, -1], [H, 0], H)) * filtered
    total = ct.ss(ct.tf([H, 0], [1, -1], H))
    if isinstance(controller, Lead):
        law = ct.tf([controller.gain / controller.zero, controller.gain], [1 / controller.pole, 1])
        return plant * ct.ss(ct.sample_system(law, H, method="bilinear"))
    if controller.output == "speed":
        return plant * speed * (controller.kp + controller.ki * total)
    return plant * (controller.kp + controller.ki * total + controller.kd * speed)


@pytest.mark.parametrize(
    "asked",
    [
        {"damping": 0.8, "bandwidth": 20.0},
        {"damping": 0.8, "bandwidth": 60.0},
        {"poles": (-20, -15 + 10j)},
        {"output": "speed", "damping": 0.8, "bandwidth": 20.0},
        {"controller": "lead", "damping": 0.8, "bandwidth": 20.0},
    ],
    ids=str,
)
def test_margins_are_those_of_the_sampled_loop(asked: dict[str, Any]) -> None:
    made = tuned(**asked)
    omega = made.margins["gain_crossover"].value
    loop = sampled_loop(made.controller)

    def at(frequency: float) -> complex:
        return complex(loop(np.exp(1j * frequency * H)))

    crossover = brentq(lambda w: abs(at(w)) - 1, 0.5 * omega, 2 * omega, xtol=1e-12)
    phase = math.pi + np.angle(at(crossover))
    closed = ct.feedback(made.margins["gain_margin"].value * loop).poles()

    # The same loop by other routes. Matrices of a motor that is sampled 50 times in its time constant, with two integrators near
    # each other, leave python-control eight digits; a pole next to the circle moves by less than the gain in proportion.
    assert omega == pytest.approx(crossover, rel=1e-7)
    assert made.margins["phase_margin"].value == pytest.approx(phase, abs=1e-7)
    assert made.margins["delay_margin"].value == pytest.approx(phase / crossover, rel=1e-6)
    # A difference of the position has its pole at 1 cancelled, and there it stays.
    assert min(abs(abs(closed[abs(closed - 1) > 1e-6]) - 1)) < 1e-6


@pytest.mark.parametrize(
    "controller",
    [
        Pid(kp=0.05, ki=4.0, output="speed", cutoff=500.0),
        Pid(kp=0.0, ki=4.0, output="speed", cutoff=500.0),
        Pid(kp=4.0, ki=10.0, kd=0.2, cutoff=300.0),
        Lead(gain=3.0, zero=10.0, pole=300.0),
    ],
    ids=str,
)
def test_the_loop_is_what_is_computed_at_all_frequencies(controller: Any) -> None:
    omega = np.geomspace(0.5, 0.999 * math.pi / H, 50)
    ours = open_loop(controller, GAIN, TAU, DELAY, H).frequency_response(omega)
    theirs = np.array([complex(sampled_loop(controller)(np.exp(1j * w * H))) for w in omega])

    # As above; near π/h the zero of the trapezoid rule makes both small.
    np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-9)


def test_margins_have_intervals_that_grow_with_what_is_not_known_of_the_motor() -> None:
    vague = document()
    vague["covariance"]["matrix"] = (100 * np.array(vague["covariance"]["matrix"])).tolist()

    known = tuned(damping=0.8, bandwidth=40.0).margins
    unsure = tune(
        ResultSummary.from_document(vague, "the result"), "pole_placement", wish(damping=0.8, bandwidth=40.0)
    ).margins

    for name in ("phase_margin", "delay_margin", "gain_crossover"):
        low, high = known[name].interval
        assert low < known[name].value < high
        # Ten times the standard deviation; the delay can't become negative, so not quite ten times the width.
        assert np.ptp(unsure[name].interval) > 4 * (high - low)


# ---- the twin


SHEET = {"resistance": 8.4, "inductance": 1.16e-3, "k": 0.042, "inertia": 2.0952e-5, "damping": 1e-6}


def of_the_twin(sd: float) -> ResultSummary:
    """Return a result whose gain and time constant are the twin's own, by its equations, with a relative deviation."""
    r, k, j, b = SHEET["resistance"], SHEET["k"], SHEET["inertia"], SHEET["damping"]
    gain, tau = k / (r * b + k * k), r * j / (r * b + k * k)
    told = document()
    delay = SHEET["inductance"] / r
    for name, value in (("gain", gain), ("time_constant", tau), ("delay", delay)):
        told["parameters"][name]["value"] = value
    names = told["covariance"]["parameters"]
    spread = {"gain": sd * gain, "time_constant": sd * tau, "coulomb_voltage": 0.0, "delay": 0.0}
    told["covariance"]["matrix"] = np.diag([spread[name] ** 2 for name in names]).tolist()
    told["transfer_function"] |= {"numerator": [gain], "denominator": [tau, 1.0], "delay": delay}
    return ResultSummary.from_document(told, "the result")


def twin_step(controller: Any, size: float, **changed: str) -> Array:
    """Return the angle [rad] of a twin without friction after a step of the reference."""
    asked = Experiment(
        signal=Square(low=0.0, high=size, frequency=0.1, start=0.1),
        duration=1.5,
        sample_time=H,
        controller=controller,
    )
    with sb.connect("twin", coulomb_torque="0 N·m", **changed) as motor:
        recording = sb.run(asked, motor)
    counts = next(series.values for series in recording.series if series.channel.name == "counts")
    return np.asarray(counts * 2 * math.pi / 2048, dtype=np.float64)


@pytest.mark.parametrize("damping", [0.5, 0.7, 1.0])
def test_the_predicted_overshoot_is_that_of_the_damping_where_nothing_delays(damping: float) -> None:
    fast = 1e-4
    motor = first_order_motor(answered(), "tune", "rad")
    # What `tune` predicts itself has the motor's delay in it, and 41 such motors: it would take ten times as long.
    controller = METHODS["pole_placement"](
        motor, wish(damping=damping, bandwidth=15.0, sample_time=fast, cutoff=5000.0)
    )

    predicted = unit_step(controller, GAIN, TAU, 0.0, fast, 10_000).overshoot

    # What is left of delay: a sample time and a half and the filter, 0.35 ms; ω times that is 0.5 % of the damping, and the
    # overshoot falls by no more than half of a change of the damping.
    designed = math.exp(-math.pi * damping / math.sqrt(1 - damping**2)) if damping < 1 else 0.0
    assert predicted == pytest.approx(designed, abs=0.5 * 15.0 * (1.5 * fast + 1 / 5000))


@pytest.mark.parametrize("damping", [0.5, 0.7, 1.0])
def test_the_twin_settles_as_predicted(damping: float) -> None:
    made = tune(of_the_twin(0.001), "pole_placement", wish(damping=damping, bandwidth=15.0))
    size, count = 4.0, 2 * math.pi / 2048

    theta = twin_step(made.controller, size)

    # Rounding of a few counts, and a motor of first order with a delay in the place of the winding's lag.
    predicted = made.response["overshoot"].value
    assert (theta.max() - size) / size == pytest.approx(predicted, abs=3 * count / size + 0.002)
    assert abs(theta[-1] - size) <= 3 * count


def test_over_the_interval_of_the_motor_the_twin_overshoots_by_what_is_predicted() -> None:
    sd = 0.05
    made = tune(of_the_twin(sd), "pole_placement", wish(damping=0.6, bandwidth=20.0))
    low, high = made.response["overshoot"].interval
    size, count = 4.0, 2 * math.pi / 2048

    found = []
    for time_constant in (1 - 1.5 * sd, 1.0, 1 + 1.5 * sd):
        inertia = SHEET["inertia"] * time_constant  # the time constant alone, in proportion
        disc = inertia - SHEET["inertia"] + 0.5 * 0.053 * 0.0248**2
        theta = twin_step(made.controller, size, disc_inertia=f"{disc} kg·m²")
        found.append((theta.max() - size) / size)

    slack = 3 * count / size + 0.002
    assert low - slack <= min(found)
    assert max(found) <= high + slack
    assert np.ptp(found) > 0.2 * (
        high - low
    )  # the motors do differ, and the interval is no wider than it has to be
    assert high - low > 0.01


# ---- what can't be had


@pytest.mark.parametrize(
    ("asked", "because"),
    [
        ({"damping": 0.8, "bandwidth": 300.0}, "the slowest poles of the loop would be"),
        ({"damping": 0.8, "bandwidth": 5000.0}, "poles may go up to 500 rad/s, and 5000 rad/s is requested"),
        ({"damping": 0.3, "bandwidth": 100.0}, "too fast for 0.0024 s of delay and sample time"),
        (
            {"damping": 0.8, "bandwidth": 20.0, "step": 10.0},
            "a step of 10 rad would need 14.1 V, and the limit is 10 V",
        ),
        ({"poles": (-200, -100 + 100j)}, "the slowest poles of the loop would be"),
    ],
    ids=str,
)
def test_a_wish_that_is_too_fast_is_refused_and_the_fastest_that_is_reported_can_be_had(
    asked: dict[str, Any], because: str
) -> None:
    with pytest.raises(UsageError, match=because) as caught:
        tuned(**asked)

    told = re.search(r"the fastest possible is about (.*?)(?:;|$|, )", str(caught.value))
    assert told is not None
    given = dict(re.findall(r"`(\w+)=([^`]*)`", told[1]))
    slower: dict[str, Any] = {}
    if "poles" in given:
        slower = {"poles": tuple(complex(each) for each in given["poles"].split(","))}
    else:
        slower = {"damping": float(given["damping"]), "bandwidth": float(given["bandwidth"])}
    made = tuned(**(asked | slower))
    assert made.margins["phase_margin"].interval[0] >= LEAST_PHASE
    assert made.margins["gain_margin"].interval[0] >= LEAST_FACTOR


@pytest.mark.parametrize("bandwidth", [10.0, 20.0, 25.0])
def test_intervals_over_some_of_the_motors_lie_within_those_over_all(bandwidth: float) -> None:
    """So that a wish that is refused by the few is refused by all."""
    motor = first_order_motor(answered(), "tune", "rad")
    found = tuned(bandwidth=bandwidth, damping=0.8).controller
    few, every = (margins(found, motor, H) for margins in (least_margins, loop_margins))

    for name, value in every.items():
        (low, high), (outer_low, outer_high) = few[name].interval, value.interval
        assert outer_low <= low
        assert high <= outer_high


def test_lambda_below_the_dead_time_is_refused() -> None:
    with pytest.raises(UsageError, match=r"`closed_loop=0.0021`: a loop can't be faster than the 0.0024 s"):
        tuned("lambda_tuning", closed_loop=0.0021)


@pytest.mark.parametrize(
    ("method", "asked", "because"),
    [
        ("pole_placement", {"damping": 0.8, "bandwidth": 2.0}, "more than 1/time constant = 10.1 rad/s"),
        ("pole_placement", {"damping": 0.8}, "needs `damping=...` and `bandwidth=...`"),
        ("pole_placement", {"closed_loop": 0.1}, "is for lambda_tuning"),
        ("pole_placement", {"poles": (-1, 2)}, "left of zero"),
        ("pole_placement", {"poles": (-10, -20, -30, -40)}, "4 poles; expected two, or three"),
        ("pole_placement", {"output": "speed", "poles": (-10, -20, -30)}, "a speed loop has two poles"),
        ("pole_placement", {"output": "speed", "controller": "lead", "damping": 1, "bandwidth": 20}, "finds no gains of 'lead'"),
        ("pole_placement", {"poles": (-20, -30), "damping": 0.8}, "give one or the other"),
        ("lambda_tuning", {}, "needs `closed_loop=...`"),
        ("lambda_tuning", {"closed_loop": 0.1, "damping": 0.8}, "are for pole_placement"),
        ("lambda_tuning", {"closed_loop": 0.1, "controller": "lead"}, "finds no gains of 'lead'"),
        ("lambda_tuning", {"closed_loop": 0.1, "controller": "open_loop"}, "no controller that can be tuned"),
        ("lamda_tuning", {"closed_loop": 0.1}, "did you mean 'lambda_tuning'"),
    ],
)  # fmt: skip
def test_a_wish_that_says_too_little_too_much_or_nonsense_is_reported(
    method: str, asked: dict[str, Any], because: str
) -> None:
    with pytest.raises(UsageError, match=because):
        tuned(method, **asked)


def test_a_refused_result_tunes_nothing_and_a_doubtful_one_says_so() -> None:
    with pytest.raises(NotIdentifiable, match="refused"):
        answered(verdict="refused")
    made = tune(answered(verdict="doubtful"), "pole_placement", wish(damping=0.8, bandwidth=20.0))
    assert "motor-doubtful" in {finding.code for finding in made.findings}


def test_without_an_integral_part_friction_is_said_to_leave_an_error() -> None:
    codes = {finding.code: finding.sentence for finding in tuned(damping=0.8, bandwidth=20.0).findings}
    kp = tuned(damping=0.8, bandwidth=20.0).controller.kp  # type: ignore[union-attr]

    assert f"{COULOMB / kp:.2g} rad" in codes["friction-leaves-error"]
    third = tuned(poles=(-20, -15 + 10j)).findings
    assert "friction-leaves-error" not in {finding.code for finding in third}


def test_a_small_margin_is_a_warning() -> None:
    codes = {finding.code for finding in tuned(damping=0.4, bandwidth=60.0).findings}
    assert "margin-small" in codes


# ---- what comes out


@pytest.mark.parametrize("controller", ["pid", "state_feedback", "lead"])
def test_the_table_can_be_pasted_into_an_experiment(controller: str) -> None:
    made = tuned(controller=controller, damping=0.8, bandwidth=20.0)

    read = read_experiment(f'[signal]\ntype = "square"\n{made.toml}')

    assert read.controller == made.controller


def test_wires_the_other_way_round_turn_the_gains_round() -> None:
    told = document()
    told["parameters"]["gain"] |= {"value": -GAIN, "interval": [-GAIN - 0.04, -GAIN + 0.04]}
    told["transfer_function"] |= {"numerator": [-GAIN]}

    made = tune(
        ResultSummary.from_document(told, "the result"), "pole_placement", wish(damping=0.8, bandwidth=20.0)
    )

    right = tuned(damping=0.8, bandwidth=20.0)
    assert isinstance(made.controller, Pid)
    assert isinstance(right.controller, Pid)
    assert (made.controller.kp, made.controller.kd) == (-right.controller.kp, -right.controller.kd)
    assert made.margins["phase_margin"].value == pytest.approx(right.margins["phase_margin"].value)
    assert made.response["overshoot"].value == pytest.approx(right.response["overshoot"].value)


def test_margins_without_intervals_are_the_same() -> None:
    made = tuned(damping=0.8, bandwidth=20.0)
    motor = first_order_motor(answered(), "tune", "rad")

    plain = nominal_margins(made.controller, motor, H)

    assert plain == {name: each.value for name, each in made.margins.items()}
    assert METHODS["pole_placement"](motor, wish(damping=0.8, bandwidth=20.0)) == made.controller


def test_a_response_is_reported_only_where_it_is_worked_out_as_far_as_its_overshoot() -> None:
    """At a tick of 5 µs the first 20 000 end before the loop has risen: it was told to have no overshoot."""
    with pytest.raises(UsageError, match="takes more than 20000 such ticks; expected") as refused:
        tuned(damping=0.5, bandwidth=20.0, sample_time=5e-6)

    enough = float(re.search(r"expected ([\d.e-]+) s at least", str(refused.value))[1])  # type: ignore[index]
    overshoot = tuned(damping=0.5, bandwidth=20.0, sample_time=enough).response["overshoot"].value
    # e^(-πζ/√(1 - ζ²)) = 16.3 %, with the poles where they were wished; what the filter at ten times the bandwidth adds is a pole
    # that far out, whose lag of a tenth changes the overshoot by no more than that part.
    assert overshoot == pytest.approx(math.exp(-math.pi * 0.5 / math.sqrt(0.75)), rel=0.1)


@pytest.mark.parametrize(
    "asked",
    [
        {"damping": 0.8, "bandwidth": 1e300},
        {"damping": 1e300, "bandwidth": 20.0},
        {"poles": (-1e300 + 0j, -1e300 + 0j)},
    ],
)
def test_a_bandwidth_beyond_any_controller_is_reported(asked: dict[str, Any]) -> None:
    with pytest.raises(
        UsageError, match=r"no controller samples fast enough for a loop faster than 1e\+09 rad/s; expected"
    ):
        tuned(**asked)


@pytest.mark.parametrize("sample_time", [1e-6, 1e-7])
@pytest.mark.parametrize(
    ("method", "asked"),
    [("lambda_tuning", {"closed_loop": 0.1}), ("pole_placement", {"poles": (-6 + 0j, -4 + 3j)})],
)
def test_ticks_far_too_short_are_refused_before_anything_is_placed(
    monkeypatch: pytest.MonkeyPatch, method: str, asked: dict[str, Any], sample_time: float
) -> None:
    """At 1 µs a slower wish was named that doesn't work, at 0.1 µs there was no answer in a minute."""

    def fail(*_: Any, **__: Any) -> None:
        raise AssertionError("placed")

    monkeypatch.setattr(f"servobench.systems.tuning.{method}.place_poles", fail)

    with pytest.raises(UsageError, match="takes more than 20000 such ticks; expected") as refused:
        tuned(method, **asked, sample_time=sample_time)

    monkeypatch.undo()
    enough = float(re.search(r"expected ([\d.e-]+) s at least", str(refused.value))[1])  # type: ignore[index]
    assert tuned(method, **asked, sample_time=enough).poles


def test_ticks_of_which_the_delay_takes_thousands_are_refused() -> None:
    with pytest.raises(UsageError, match=r"the motor's delay of .* takes more than 500 such ticks; expected"):
        tuned(poles=(-20000 + 0j, -2 + 0j), sample_time=DELAY / 20_000)


def test_a_gain_margin_says_its_direction_and_the_loop_itself_bears_it() -> None:
    """With an integral part less gain is unstable, too: its factor was printed as that by which the gain may rise."""
    made = tuned(poles=(-40 + 0j, -35 + 26j))
    rise, fall = made.margins["gain_margin"].value, made.margins["gain_margin_downwards"].value

    assert 1 < fall < math.inf
    for factor, grows in ((0.9 * rise, False), (1.1 * rise, True), (1.1 / fall, False), (0.9 / fall, True)):
        poles = open_loop(made.controller, GAIN, TAU, DELAY, H).closed_poles(
            factor
        )  # eigenvalues, no frequencies
        assert (np.abs(poles).max() > 1) == grows
    assert made.to_dict()["margins"]["gain_margin_downwards"]["value"] == fall


def test_a_loop_that_less_gain_makes_slower_only_has_no_margin_downwards() -> None:
    margins = tuned(damping=0.8, bandwidth=20.0).to_dict()["margins"]

    assert margins["gain_margin_downwards"]["value"] is None


@pytest.mark.parametrize("controller", ["pid", "state_feedback", "lead"])
def test_damping_and_bandwidth_are_told_as_wished_and_as_the_loop_has_them(controller: str) -> None:
    quantities = tuned(controller=controller, damping=0.8, bandwidth=20.0).quantities

    for name, wished in (("damping", 0.8), ("bandwidth", 20.0)):
        told, obtained, _ = quantities[name]
        assert told == pytest.approx(wished, rel=1e-12)
        assert obtained == pytest.approx(wished, rel=5e-3)  # as the poles are in test_placement
