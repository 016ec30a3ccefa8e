"""The verb identify: what it chooses, what it says, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.errors import UnknownName, UsageError
from servobench.core.finding import Severity, Verdict, warning
from servobench.identification.identify import _without_consequences, identify
from servobench.identification.models.nominal import nominal_values
from servobench.identification.result import Result
from servobench.identification.trust.missing_terms import TERMS
from servobench.identification.uncertainty.identifiability import State
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.rig.devices.base import connect
from servobench.rig.experiment.experiment import Experiment
from servobench.rig.loop.run import run
from servobench.rig.motor.parameters import QUBE_SERVO_2
from servobench.systems.signals.prbs import PRBS
from tests.datasets import QUANTUM, dataset, prbs
from tests.rig.motor.reference import Truth


def codes(result: Result) -> set[str]:
    return {finding.code for finding in result.findings}


def test_a_motor_that_turned_one_way_gets_one_voltage_for_friction_and_offset() -> None:
    result = identify(dataset(seed=1))
    assert result.verdict == Verdict.TRUSTED
    assert result.fit is not None
    assert set(result.fit.estimates) == {"gain", "time_constant", "coulomb_voltage", "delay"}
    assert {"friction-and-offset-together", "offset-found", "residual-is-rounding"} <= codes(result)


def test_friction_is_found_where_there_is_some_and_not_where_there_is_none() -> None:
    with_friction = identify(dataset(seed=1, kind="prbs"))
    without = identify(dataset(seed=1, kind="prbs", truth=Truth(coulomb_torque=0.0)))
    assert "friction-found" in codes(with_friction)
    (about,) = [each for each in without.findings if each.code == "friction-not-found"]
    assert "Under one level both ways" in about.sentence
    assert about.parameters == ("gain",)
    assert without.fit is not None
    assert "coulomb_voltage" not in without.fit.estimates


def test_an_input_that_never_changes_is_refused() -> None:
    data = dataset(seed=1)
    result = identify(replace(data, u=np.full_like(data.u, 2.0), input_before=2.0))
    assert result.verdict == Verdict.REFUSED
    assert result.fit is None
    assert "input-constant" in codes(result)


def test_a_start_under_one_level_is_seen_though_the_wheel_wobbles_at_speed() -> None:
    """A robot's wheel under 7 V from its first row on: 19 rad/s, reached in 0.15 s, give or take an eighth as it turns.

    The wobble of 0.7 rad (one deviation) about the line of the second half hid that the position begins 2.9 rad ahead of it: five
    times as much was asked for. The mean of the second half is what the speed under that level is.
    """
    t = 0.05 * np.arange(88)
    angle = 19.0 * (t - 0.15 * (1.0 - np.exp(-t / 0.15))) + 1.0 * np.sin(2.4 * t) * (1.0 - np.exp(-t / 0.5))
    count = 2 * np.pi / 1440
    data = dataset(
        seed=1, samples=88, sample_time=0.05, u=np.full(88, 7.0), y=np.round(angle / count) * count
    )
    result = identify(replace(data, input_before=7.0, quantum=count))
    assert "input-constant" not in codes(result)
    (speed,) = result.combinations
    assert speed.name == "speed_at_level"
    low, high = speed.estimate.interval
    assert low < (angle[-1] - angle[44]) / (t[-1] - t[44]) < high


def test_a_motor_that_coasts_shows_its_time_constant_beside_one_that_is_driven() -> None:
    """A motor of 24 rad/s for a volt and half a second loses a third of a volt to friction: 2 V drive it, or it is left alone."""
    t = 0.01 * np.arange(300)
    driven = 40.0 * (1.0 - np.exp(-t / 0.5))  # 24 rad/s for each of 2 V less a third
    coasting = np.maximum((40.0 + 8.0) * np.exp(-t / 0.5) - 8.0, 0.0)
    noise = 0.1 * np.random.default_rng(3).standard_normal((2, len(t)))
    base = dataset(seed=1, samples=len(t), sample_time=0.01, u=np.zeros(len(t)))
    base = replace(base, kind="speed", output_unit="rad/s", quantum=None)
    coast = replace(base, y=coasting + noise[0])
    step = replace(base, u=np.full(len(t), 2.0), y=driven + noise[1])

    alone, together = identify(coast), identify([coast, step])

    assert [each.sentence for each in alone.findings if "If the motor was coasting here" in each.sentence]
    assert together.verdict == Verdict.TRUSTED
    assert together.fit is not None
    for name, true in (("gain", 24.0), ("time_constant", 0.5), ("coulomb_voltage", 1 / 3)):
        low, high = together.fit[name].interval
        assert low < true < high


def test_an_output_that_never_moves_is_refused_with_a_sentence() -> None:
    data = dataset(seed=1)
    result = identify(replace(data, y=np.full_like(data.y, 0.5)))
    assert result.verdict == Verdict.REFUSED
    assert any("blocked" in finding.sentence for finding in result.findings)


def test_noise_in_place_of_a_motor_is_not_trusted() -> None:
    data = dataset(seed=1)
    noise = np.random.default_rng(1).normal(size=len(data.y))
    assert identify(replace(data, y=noise)).verdict != Verdict.TRUSTED


def test_a_wandering_position_is_in_the_intervals() -> None:
    """A random walk of the position, as white torque makes it, a hundred times the encoder's rounding."""
    data = dataset(seed=1)
    walk = np.cumsum(np.random.default_rng(1).normal(size=len(data.y))) * QUANTUM
    result = identify(replace(data, y=data.y + walk))
    assert result.verdict == Verdict.TRUSTED
    assert {"residual-coloured", "residual-above-rounding"} <= codes(result)
    ideal = identify(data)
    assert result.fit is not None
    assert ideal.fit is not None
    for name in ("gain", "time_constant"):
        low, high = result.fit[name].interval
        assert low < ideal.fit[name].value < high
        assert result.fit[name].sd > 10 * ideal.fit[name].sd


def test_a_speed_without_its_chain_is_told_what_that_may_cost() -> None:
    data = dataset(seed=1, chain="derivative")
    unsaid = replace(data, applied=type(data.applied)())
    assert "chain-unknown" in codes(identify(unsaid, estimator="output_error"))  # where it is taken as it is
    assert "counts-restored" in codes(identify(unsaid))  # differences of counts give themselves away
    found = codes(identify(data))
    assert "chain-unknown" not in found
    # Speeds that differ by a float's last digit are one speed of a coarse grid, and no sensor at the end of its range.
    assert "output-clipped" not in found


def test_a_missing_pole_shows_in_the_residual() -> None:
    """The signal is filtered by 50/(s+50) and nobody says so: what is left over follows the input.

    The lag is then that of motor and filter together, 98.6 and 20 ms, and the intervals hold it.
    """
    data = dataset(seed=1, kind="prbs", chain="derivative | lowpass 50 rad/s")
    result = identify(replace(data, applied=type(data.applied)()))
    assert {"chain-unknown", "residual-follows-input"} <= codes(result)
    assert result.fit is not None
    lag = result.fit["time_constant"].value + result.fit["delay"].value
    assert lag == pytest.approx(0.0992 + 0.02, rel=0.05)


def test_a_gain_from_one_operating_point_is_called_local() -> None:
    data = dataset(seed=1)
    u = np.where(data.u > 2, 2.2, 2.0)
    from tests.rig.motor.reference import march

    angle = march(Truth(), u, 0.002)[:, 2]
    result = identify(replace(data, u=u, y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM))
    assert "gain-local" in codes(result)


def test_nominal_values_stand_beside_the_estimates() -> None:
    result = identify(dataset(seed=1), nominal="qube_servo_2")
    nominal = {comparison.name: comparison.nominal for comparison in result.nominal}
    assert nominal == pytest.approx(nominal_values(QUBE_SERVO_2.motor))
    gain = next(comparison for comparison in result.nominal if comparison.name == "gain")
    assert gain.z < -100  # the sheet knows no friction: it promises half a per cent more gain


def test_held_out_data_are_simulated_and_reported() -> None:
    result = identify(dataset(seed=1))
    assert result.validation is not None
    assert result.validation.fit_percent > 99.9
    other = identify(dataset(seed=1), validate_on=[dataset(seed=2, kind="square")])
    assert other.validation is not None
    assert other.validation.records[0].samples == 5000


def test_what_cannot_be_fitted_together_is_said() -> None:
    data = dataset(seed=1, samples=500)
    with pytest.raises(UsageError, match=r"input unit is % in b and V in reference motor; choose columns"):
        identify([data, replace(data, name="b", input_unit="%")])
    with pytest.raises(UsageError, match="data is an empty list"):
        identify([])


@pytest.mark.parametrize("what", ["structure", "estimator", "nominal"])
def test_an_unknown_name_is_refused_with_the_known_ones(what: str) -> None:
    with pytest.raises(UnknownName, match="known"):
        identify(dataset(seed=1, samples=500), **{what: "nothing"})  # type: ignore[arg-type]


def test_a_result_has_no_number_that_json_does_not_know() -> None:
    import json

    data = dataset(seed=1)
    for result in (identify(data), identify(replace(data, y=np.full_like(data.y, 0.5)))):
        json.dumps(result.to_dict(), allow_nan=False)


def test_sixty_milliseconds_of_a_step_tell_the_acceleration_alone() -> None:
    """K (u - u_c) / τ is 23.7 · 0.84 V / 0.0998 s."""
    result = identify(dataset(seed=1, samples=30))

    assert {each.state for name, each in result.answers.items() if name != "delay"} == {State.COMBINATION}
    (acceleration,) = result.combinations
    assert acceleration.name == "acceleration_at_level"
    assert acceleration.estimate.interval[0] < 23.6967 * 0.84 / 0.0998 < acceleration.estimate.interval[1]


@pytest.mark.parametrize("samples", [2, 5, 9, 15, 25])
def test_a_record_that_is_too_short_is_a_result_and_no_crash(samples: int) -> None:
    result = identify(dataset(seed=1, samples=samples))
    assert isinstance(result, Result)
    assert result.verdict != Verdict.TRUSTED


def test_a_negative_gain_is_found_with_its_sign() -> None:
    data = dataset(seed=1, kind="prbs")
    result = identify(replace(data, y=-data.y))
    assert result.fit is not None
    assert result.fit["gain"].value == pytest.approx(-23.6967, rel=1e-3)
    assert "sign-negative" in codes(result)


def test_counts_and_metres_keep_their_units() -> None:
    data: Dataset = replace(dataset(seed=1), output_unit="counts", quantum=QUANTUM)
    result = identify(data)
    assert result.fit is not None
    assert result.fit["gain"].unit == "counts/(s·V)"
    assert result.transfer_function is not None
    assert result.transfer_function.unit == "counts/(s·V)"


def test_friction_is_found_behind_a_long_delay_too() -> None:
    """30 ms are 15 samples: without friction the gain would be 10 % wrong, and trusted."""
    data = dataset(seed=1, kind="prbs", hold=20)
    late = replace(data, t_output=data.t_output + 0.03)
    result = identify(late)
    assert "friction-found" in codes(result)
    assert result.fit is not None
    assert result.fit["gain"].value == pytest.approx(23.6967, rel=2e-3)
    assert result.fit["delay"].value == pytest.approx(0.03, rel=0.02)


def test_friction_that_would_help_is_doubted() -> None:
    """A motor that saturates above 2 V, driven at 1 and 3 V: the line through two levels has a negative offset."""
    from tests.rig.motor.reference import march

    data = dataset(seed=1)
    angle = march(Truth(), np.minimum(data.u, 2.5), 0.002)[:, 2]
    result = identify(replace(data, y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM))
    assert "offset-negative" in codes(result)
    assert result.verdict == Verdict.DOUBTFUL


def test_a_time_column_in_milliseconds_that_nobody_named_is_doubted() -> None:
    from servobench.core.finding import info

    data = dataset(seed=1, kind="prbs")
    slow = replace(
        data,
        t_input=data.t_input * 1000,
        t_output=data.t_output * 1000,
        findings=(info("time-recognised", "`t` is used as the time, in s."),),
    )
    assert "time-unit-doubtful" in codes(identify(slow))
    assert "time-unit-doubtful" not in codes(identify(replace(slow, findings=())))


def test_two_levels_of_the_input_are_reported() -> None:
    assert "two-levels" in codes(identify(dataset(seed=1)))


@pytest.mark.parametrize(
    ("levels", "unit", "hidden"),
    [
        ((-3.0, 3.0), "V", {"drops a part of the input", "limits the current"}),
        ((0.0, 3.0), "V", {"drops a part of the input", "limits the current"}),
        ((-3.0, 2.0), "V", {"limits the current"}),
        ((-3.0, 3.0), "A", set()),
    ],
)
def test_what_two_levels_hide_of_the_driver_is_said(
    levels: tuple[float, float], unit: str, hidden: set[str]
) -> None:
    """A dead band takes the same of levels that differ in sign alone, and a driver of currents keeps its own limit."""
    u = np.where(prbs(3000, 50, np.random.default_rng(1)) < 0, *levels)

    result = identify(replace(dataset(seed=1, u=u, samples=3000), input_unit=unit))

    (sentence,) = [each.sentence for each in result.findings if each.code == "two-levels"]
    assert {
        each for each in ("drops a part of the input", "limits the current") if each in sentence
    } == hidden


def test_a_rest_without_input_is_no_third_level() -> None:
    """What the driver drops is the same at both: of a motor that rests at first it shows no more."""
    data = dataset(seed=1, kind="prbs")
    rest = np.arange(5000) < 500

    result = identify(dataset(seed=1, u=np.where(rest, 0.0, data.u)))

    (sentence,) = [each.sentence for each in result.findings if each.code == "two-levels"]
    assert "linear there, and whether the driver drops a part of the input or limits the current" in sentence
    assert "drives the motor at two levels only" in sentence
    coasts = identify(dataset(seed=1, u=np.where(rest, 0.0, data.u)[::-1].copy()))
    assert "two-levels" not in codes(coasts)


def test_a_model_that_fails_on_another_motor_is_doubted() -> None:
    """Another motor, 20 % slower to turn: its position runs away from the model's."""
    other = dataset(seed=2, kind="prbs", truth=Truth(inertia=3e-5))
    result = identify(dataset(seed=1, kind="prbs"), validate_on=[other])
    assert {"validation-worse", "validation-poor"} & codes(result)
    assert result.verdict == Verdict.DOUBTFUL


def test_a_recording_given_twice_is_reported() -> None:
    """Its samples are what counts: a copy of the file under another name is the same recording."""
    from servobench.recordings.recording import Source

    data = replace(dataset(seed=1), source=Source(name="a.csv", sha256="ab"))
    copy = replace(data, name="a copy", source=Source(name="b.csv", sha256="cd"))
    assert "data-repeated" in codes(identify([data, data]))
    assert "data-repeated" in codes(identify([data, copy]))
    assert "data-repeated" not in codes(identify([data, dataset(seed=2)]))


def test_every_copy_of_a_recording_is_named() -> None:
    from servobench.identification.trust.doubts.base import about_data

    data, other = dataset(seed=1, samples=500), dataset(seed=2, samples=500)
    records = [
        *(replace(data, name=name) for name in ("a", "b", "c")),
        *(replace(other, name=name) for name in ("d", "e", "e")),
        dataset(seed=3, samples=500),
    ]
    (found,) = (f.sentence for f in about_data(records) if f.code == "data-repeated")
    assert found.startswith("a, b and c hold the same samples; d and e hold the same samples: a copy adds")
    (twice,) = (f.sentence for f in about_data([data, data]) if f.code == "data-repeated")
    assert twice.startswith(f"{data.name} is given twice: ")


def test_a_part_of_a_recording_is_no_other_one() -> None:
    """One row less, or an angle that counts from elsewhere in fewer digits, is the same run under another hash."""
    data = dataset(seed=1, kind="prbs", samples=1000)
    part = replace(data.part(0.0, 1.2), name="part")
    moved = replace(data, name="moved", y=np.array([float(f"{y + 1:.9g}") for y in data.y]))
    (found,) = (f.sentence for f in identify([data, part, moved]).findings if f.code == "data-repeated")
    assert found.startswith("reference motor, part and moved hold mainly the same samples: ")
    for copy in (part, moved):
        with pytest.raises(
            UsageError, match=f"{copy.name} can't validate the model, which is fitted to the same"
        ):
            identify(data, validate_on=[copy])
    # The same input again, and a motor that starts within the same count, is another run.
    again = replace(dataset(seed=2, kind="prbs", samples=1000, u=data.u), name="again")
    assert "data-repeated" not in codes(identify([data, again]))


def test_an_angle_that_wraps_is_refused_for_that_and_nothing_is_fitted() -> None:
    """The twin drawn within ±180°: the reason stands alone, beside no table of noise."""
    from servobench.recordings.measurement.measure import measure
    from tests.recordings.measurement.test_measure import recording

    data = dataset(seed=1, kind="prbs")
    wrapped = (data.y + np.pi) % (2 * np.pi) - np.pi
    result = identify(measure(recording(wrapped, "rad", t=data.t_output, u=data.u)))

    assert result.verdict == Verdict.REFUSED
    assert result.fit is None
    assert [f.code for f in result.findings if f.severity == Severity.REFUSAL] == ["angle-wraps"]


@pytest.mark.parametrize(("input_sign", "output_sign"), [(-1, 1), (1, -1), (-1, -1)])
def test_friction_that_brakes_isnt_doubted_whichever_way_the_wires_are(
    input_sign: int, output_sign: int
) -> None:
    data = dataset(seed=1)
    result = identify(replace(data, u=input_sign * data.u, y=output_sign * data.y))

    assert result.verdict == Verdict.TRUSTED
    assert "offset-found" in codes(result)
    assert result.fit is not None
    assert result.fit["coulomb_voltage"].value == pytest.approx(input_sign * 0.16, rel=0.01)


def test_a_model_of_one_way_tried_on_reversals_says_that() -> None:
    result = identify(dataset(seed=1), validate_on=[dataset(seed=2, kind="prbs", hold=20)])

    warned = [f.code for f in result.findings if f.severity == Severity.WARNING]
    assert warned == ["validation-reverses"]
    assert result.validation is not None
    assert result.validation.fit_percent < 50


def test_friction_that_turns_with_the_shaft_may_be_tried_on_reversals() -> None:
    """A motor that rested while it turned one way shows friction that brakes whichever way it turns."""
    from tests.identification.test_one_level import stepped

    result = identify(stepped(0.0, 2.0, 0.0, 1.0), validate_on=[dataset(seed=2, kind="prbs", hold=20)])

    assert result.validation is not None
    assert result.validation.fit_percent > 50
    assert "validation-reverses" not in codes(result)


def test_an_input_of_volts_that_were_taken_for_millivolts_is_asked_for_that() -> None:
    data = dataset(seed=1)
    result = identify(replace(data, u=data.u / 1000))

    [asked] = [f.sentence for f in result.findings if f.code == "size-absurd"]
    assert "V read as mV?" in asked


@pytest.mark.parametrize(
    ("cause", "consequence"),
    [("kind-mistaken", "nothing-known"), ("motion-stopped", "output-stops"), ("output-stops", "delay-negative"),
     ("gain-falls", "speed-levels-off"), ("speed-levels-off", "structure-wrong"), ("speed-levels-off", "fit-by-chance"),
     ("shaft-runs-back", "structure-reverses")],
)  # fmt: skip
def test_what_follows_from_a_finding_that_says_more_is_not_told_beside_it(
    cause: str, consequence: str
) -> None:
    more, less, other = (warning(code, f"{code}.") for code in (cause, consequence, "residual-coloured"))

    assert _without_consequences([less, more, other]) == [more, other]
    assert _without_consequences([less, other]) == [less, other]


def test_the_size_of_an_input_is_looked_at_beside_a_doubt_of_the_outputs_unit() -> None:
    """A doubt of the input's own unit says more than its size does."""
    data = dataset(seed=1)

    def asks(*figures: str) -> bool:
        doubt = warning("unit-contradicted", "Its name says another unit.", parameters=figures)
        return "size-absurd" in codes(identify(replace(data, u=data.u / 1000, findings=(doubt,))))

    assert asks("gain")
    assert not asks("gain", "coulomb_voltage")


@pytest.mark.parametrize(("largest", "is_doubted"), [(60, False), (200, True)])
def test_volts_in_whole_numbers_beyond_any_usual_supply_are_doubted(largest: int, is_doubted: bool) -> None:
    data = dataset(seed=1, kind="prbs")
    result = identify(replace(data, u=largest / 3.0 * data.u))

    [*asked] = [f.sentence for f in result.findings if f.code == "size-absurd"]
    assert bool(asked) is is_doubted
    assert not asked or "reaches 200 V in whole numbers only, like raw counts" in asked[0]


def test_the_sign_of_a_gain_that_nobody_knows_is_not_reported() -> None:
    from servobench.identification.trust.doubts.base import about_fit

    data = dataset(seed=1, kind="prbs")
    fit = identify(replace(data, y=-data.y)).fit
    assert fit is not None
    vague = replace(fit, covariance=fit.covariance + np.eye(len(fit.covariance)) * fit["gain"].value ** 2)

    assert "sign-negative" in {f.code for f in about_fit(fit)}
    assert "sign-negative" not in {f.code for f in about_fit(vague)}


@pytest.mark.parametrize("torque_noise", [0.0, 2e-4])
def test_a_position_that_was_unwrapped_is_judged_as_one_that_never_wrapped(torque_noise: float) -> None:
    """Nothing of the motor passes through `unwrap`: the sample is a plain count of the encoder before and after it."""
    plain = dataset(seed=3, torque_noise=torque_noise)
    unwrapped = replace(plain, applied=Chain.parse("unwrap 360 deg"))

    one, other = identify(plain), identify(unwrapped)

    assert one.fit is not None
    assert other.fit is not None
    assert one.fit.estimator == ("prediction_error" if torque_noise else "output_error")
    assert (other.fit.estimator, other.verdict) == (one.fit.estimator, one.verdict)
    sd = np.sqrt(np.diag(one.fit.covariance))
    # Another order of additions, and no more: far below what the search itself leaves open.
    np.testing.assert_allclose((other.fit.model.theta - one.fit.model.theta) / sd, 0.0, atol=1e-3)
    assert [finding.code for finding in other.findings] == [finding.code for finding in one.findings]


def test_what_an_untold_filter_may_feign_is_no_doubt_of_its_own() -> None:
    """The tutorial's logger filters the speed of the simulated motor, whose friction is the same at all speeds."""
    steps = PRBS(low=-3, high=3, order=7, bit_time="80 ms")
    with connect("twin", disc_inertia="40 g*cm^2") as motor:
        speed = measure(
            run(Experiment(signal=steps, duration="10 s"), motor), "derivative | lowpass 50 rad/s"
        )
    untold = identify(replace(speed, applied=Chain(), chain_known=False))
    missing = {term.code for term in TERMS}
    feigned = [finding for finding in untold.findings if finding.code in missing]

    assert feigned
    assert {finding.severity for finding in feigned} == {Severity.INFO}
    assert all("A filter may cause all of this" in finding.sentence for finding in feigned)
    assert "chain-unknown" in codes(untold)


def test_a_duty_beyond_the_whole_is_doubted() -> None:
    sound = dataset(seed=1)
    usual, timer = (identify(replace(sound, u=factor * sound.u, input_unit="%")) for factor in (30.0, 85.0))

    assert "size-absurd" not in {finding.code for finding in usual.findings}
    [asked] = [f.sentence for f in timer.findings if f.code == "size-absurd"]
    assert "the duty reaches 255 %" in asked
    assert "PWM/255" in asked
