"""Motors of an ensemble, identified; their report and their table."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

import servobench as sb
from servobench.core.errors import UsageError
from servobench.fleet.ensemble import IdentifiedMotor, coverages, identify_ensemble, truths_of
from servobench.fleet.ensemble_page import coverage_text, html_of, remark, sentences, write_table
from servobench.rig.devices.twin import TwinSettings
from servobench.rig.ensemble.ensemble import Ensemble
from servobench.systems.control.pid import Pid

SPREAD = {"resistance": "5%", "motor_constant": "5%", "inertia": "5%"}


@pytest.fixture(scope="module")
def motors() -> Ensemble:
    steps = sb.PRBS(low=-3, high=3, order=5, bit_time="60 ms")
    return sb.ensemble("qube_servo_2", sb.Experiment(signal=steps, duration=2.0), 6, SPREAD, seed=2)


@pytest.fixture(scope="module")
def found(motors: Ensemble) -> list[IdentifiedMotor]:
    return list(identify_ensemble(motors, 1))


def test_every_motor_is_identified_and_comes_out_as_it_is(
    motors: Ensemble, found: list[IdentifiedMotor]
) -> None:
    truth = truths_of(motors)

    assert [each.number for each in found] == list(range(6))
    for each in found:
        assert each.verdict in ("trusted", "doubtful")
        for name in ("gain", "time_constant"):
            value, sd, low, high = each.values[name]
            # Five of the stated standard deviations: a chance of 6e-7 each.
            assert abs(value - truth[name][each.number]) < 5 * sd
            assert low < value < high


def test_what_is_found_doesn_t_hang_on_the_number_of_workers(
    motors: Ensemble, found: list[IdentifiedMotor]
) -> None:
    assert list(identify_ensemble(motors, 2)) == found


def test_a_motor_s_recording_is_a_run_of_it(motors: Ensemble) -> None:
    smooth = TwinSettings(coulomb_torque=0.0, counter_bits=16)
    exact = sb.ensemble(smooth, motors.experiment, 4, SPREAD, counts=True)
    run = exact.recording(3)

    assert run.name == "motor 3"
    assert run.experiment
    # Without Coulomb friction the lanes are the twin, to the last count.
    assert exact.counts is not None
    assert np.array_equal(exact.counts[3], run["counts"].values)
    for wrong in (4, -1, 1.5, "3"):
        with pytest.raises(UsageError, match=r"number is .*; expected a whole number from 0 to 3"):
            exact.recording(wrong)  # type: ignore[arg-type]


def test_the_noise_of_each_recording_is_its_own() -> None:
    noisy = TwinSettings(torque_noise=2e-5)
    alike = sb.ensemble(noisy, sb.Experiment(duration=0.5), 2, {})

    one, other = (alike.recording(number)["counts"].values for number in (0, 1))
    assert not np.array_equal(one, other)
    assert np.array_equal(one, alike.recording(0)["counts"].values)


def test_coverage_counts_the_intervals_that_hold_the_truth(motors: Ensemble) -> None:
    gain = motors.outcomes["gain"]
    off = [0.0, 0.1, -0.1, 0.3, 0.0, 0.0]
    made = [
        IdentifiedMotor(
            number=n,
            verdict="refused" if n == 4 else "trusted",
            reason="",
            values={} if n == 5 else {"gain": (gain[n] + d, 0.1, gain[n] + d - 0.196, gain[n] + d + 0.196)},
        )
        for n, d in enumerate(off)
    ]

    (told,) = coverages(motors, made)
    assert (told.parameter, told.known, told.covered, told.share) == ("gain", 4, 3, 0.75)
    assert told.bias == pytest.approx(0.75)
    assert told.scatter == pytest.approx(np.std([0.0, 1.0, -1.0, 3.0]))
    assert told.sd == pytest.approx(math.sqrt(0.95 * 0.05 / 4))
    assert coverages(motors, []) == ()
    (single,) = coverages(motors, made[:1])
    assert "1 of 1 interval contains the true value" in coverage_text(single)
    assert "3 of 4 intervals contain the true value" in coverage_text(told)


def test_the_sentences_say_what_a_tolerance_does() -> None:
    plain = TwinSettings(viscous_friction=0.0, coulomb_torque=0.0, inductance=0.0)
    motors = sb.ensemble(plain, sb.Experiment(duration=0.1), 3, {"resistance": "5%", "motor_constant": "1%"})

    # K = 1/k and τ = R J/k²
    assert [each.replace("\u00a0", " ") for each in sentences(motors)] == [
        "±5 % of the resistance moves the time constant by ±5 %.",
        "±1 % of the torque constant moves the gain by ∓1 % and the time constant by ∓2 %.",
    ]


def test_a_tolerance_that_does_nothing_is_told_so() -> None:
    motors = sb.ensemble("qube_servo_2", sb.Experiment(duration=0.1), 3, {"coulomb_torque": "5%"})

    assert sentences(motors)[0].endswith("moves none of these by as much as 0.1 %.")


def test_motors_that_never_settle_are_counted() -> None:
    weak = sb.Experiment(signal=sb.Step(final=1.0), duration=0.3, controller=Pid(kp=0.02))
    motors = sb.ensemble("qube_servo_2", weak, 4, SPREAD)

    assert remark(motors, "settling_time") == "4 motors didn't settle within the experiment."
    assert html_of(motors, [], "").count("none") >= 1


def test_the_page_needs_no_network_and_shows_everything(
    motors: Ensemble, found: list[IdentifiedMotor]
) -> None:
    page = html_of(motors, found, "servobench ensemble")

    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")
    for name in ("bands-speed", "bands-position", "spread-gain", "tornado-time-constant"):
        assert f'id="figure-{name}"' in page
    assert "Identified" in page
    assert page == html_of(motors, found, "servobench ensemble")


def test_the_page_of_one_motor_and_of_motors_alike(motors: Ensemble) -> None:
    one = sb.ensemble("qube_servo_2", motors.experiment, 1, SPREAD)
    alike = sb.ensemble("qube_servo_2", motors.experiment, 3, {})

    assert "1 motor, simulated" in html_of(one, [], "")
    assert "3 motors, simulated." in html_of(alike, [], "")


def test_the_table_has_a_row_for_each_motor(
    motors: Ensemble, found: list[IdentifiedMotor], tmp_path: Path
) -> None:
    path = write_table(motors, found[:4], tmp_path)

    rows = list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))
    assert [row["motor"] for row in rows] == list("012345")
    assert float(rows[2]["resistance"]) == motors.parameters["resistance"][2]
    assert float(rows[3]["identified_gain"]) == found[3].values["gain"][0]
    assert rows[5]["identified_gain"] == rows[5]["verdict"] == ""


def test_a_million_ticks_of_many_motors_are_refused_before_memory_is_used() -> None:
    long = sb.Experiment(duration=2000.0)

    with pytest.raises(UsageError, match="counts of 5000 motors at 1000000 ticks"):
        sb.ensemble("qube_servo_2", long, 5000, SPREAD, counts=True)
