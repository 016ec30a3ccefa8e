"""A closed loop's record is fitted where the shaft moves, one in open loop as it is."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.finding import Severity, Verdict
from servobench.identification.identify import identify
from servobench.identification.models.stretches import _set_off, stretches_of_motion
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.measure import measure
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.experiment import Experiment
from servobench.rig.loop.run import run
from servobench.systems.control.pid import Pid
from servobench.systems.signals.sine import Sine
from servobench.systems.signals.square import Square
from tests.datasets import QUANTUM, dataset

# k/(R b + k²), and the slow root of L J s² + (L b + R J) s + R b + k², of the twin's data sheet.
R, L, K, J, B = 8.4, 1.16e-3, 0.042, 2.0952e-5, 1e-6
GAIN = K / (R * B + K * K)
TIME_CONSTANT = -1 / max(np.roots([L * J, L * B + R * J, R * B + K * K]).real)
FOLLOWING = Pid(output="position", kp=5.1261, ki=39.23, kd=0.18795, b=0, cutoff=250)


def followed(signal: Square | Sine, torque_noise: float, seed: int) -> Dataset:
    """The twin that follows a signal [rad] for 10 s."""
    with Twin(TwinSettings(torque_noise=torque_noise)) as motor:
        return measure(run(Experiment(signal=signal, controller=FOLLOWING, seed=seed), motor))


def square(size: float) -> Square:
    return Square(low=-size, high=size, frequency=0.5)


@pytest.mark.parametrize("size", [1.0, 5.0])
@pytest.mark.parametrize("torque_noise", [0.0, 3e-6, 3e-5])
def test_a_loop_that_comes_to_rest_tells_the_motor_and_names_no_false_cause(
    size: float, torque_noise: float
) -> None:
    result = identify(followed(square(size), torque_noise, seed=1))

    # A torque decides when the shaft slips, and the controller responds to it.
    warnings = {each.code for each in result.findings if each.severity is Severity.WARNING}
    assert warnings == ({"rests-left-out"} if torque_noise > 0 else set())
    assert "rests-left-out" in {each.code for each in result.findings}
    assert result.fit is not None
    # Without a torque, rounding repeats with the steps, or it doesn't: output_error, or interval_likelihood.
    assert (result.fit.estimator == "prediction_error") == (torque_noise > 0)
    for name, true in (("gain", GAIN), ("time_constant", TIME_CONSTANT)):
        assert abs(result.fit[name].value - true) < 3.3 * result.fit[name].sd, name


@pytest.mark.parametrize("torque_noise", [0.0, 3e-5])
def test_rests_are_doubted_by_the_loop_that_has_them_and_not_by_another_record(torque_noise: float) -> None:
    """The other record's sensor has no counts, and its noise is no torque."""
    with Twin() as motor:
        other = measure(run(Experiment(signal=Sine(amplitude=5, frequency=0.7), seed=2), motor))
    noise = np.random.default_rng(3).normal(0.0, QUANTUM, len(other.y))

    result = identify(
        [followed(square(5), torque_noise, seed=1), replace(other, y=other.y + noise, quantum=None)]
    )

    (rests,) = [each for each in result.findings if each.code == "rests-left-out"]
    assert (rests.severity is Severity.WARNING) == (torque_noise > 0)


@pytest.mark.parametrize("torque_noise", [0.0, 3e-5])
def test_rests_of_a_sensor_without_counts_are_doubted_where_a_torque_is_found(torque_noise: float) -> None:
    data = followed(square(5), torque_noise, seed=1)
    noise = np.random.default_rng(3).normal(0.0, QUANTUM, len(data.y))

    result = identify(replace(data, y=data.y + noise, quantum=None))

    (rests,) = [each for each in result.findings if each.code == "rests-left-out"]
    assert (rests.severity is Severity.WARNING) == (torque_noise > 0)


def test_what_the_controller_answers_to_a_torque_is_not_taken_for_the_motors_time_constant() -> None:
    """A sine excites little: predicted over blocks of samples, τ came out 1.7 % low, 1.9 standard deviations, on average."""
    off = []
    for seed in range(6):
        fit = identify(followed(Sine(amplitude=7, frequency=0.5), 3e-6, seed)).fit
        assert fit is not None
        off.append((fit["time_constant"].value - TIME_CONSTANT) / fit["time_constant"].sd)
    # The mean of six normal numbers has a standard deviation of 0.41.
    assert abs(np.mean(off)) < 3.3 / np.sqrt(6)


def test_the_stretches_are_where_the_shaft_moves_and_say_so() -> None:
    data = followed(square(5), 0.0, seed=1)
    stretches, said = stretches_of_motion([data])

    # Ten steps in 10 s, the first of half the height.
    assert len(stretches) == 10
    assert [np.ptp(each.y) > 4 for each in stretches] == [True] * 10
    assert [finding.code for finding in said] == ["rests-left-out"]


def test_a_stretch_begins_in_the_rest_before_the_jump_that_sets_the_shaft_off() -> None:
    with Twin() as motor:
        data = measure(
            run(Experiment(signal=Square(low=-1.0, high=1.0, frequency=0.4), controller=Pid(kp=3)), motor)
        )
    stretches, _ = stretches_of_motion([data])

    jumps = [np.flatnonzero(np.diff(each.reference)) + 1 for each in stretches if each.reference is not None]
    # A step each 1.25 s; before the first there is no rest.
    assert [len(at) for at in jumps if len(at)] == [1] * 7
    for each, at in zip(stretches, jumps, strict=True):
        if not len(at):
            continue
        jump = int(at[0])
        assert jump == 20
        assert np.ptp(each.y[: jump + 1]) == 0.0
        assert np.ptp(each.y[jump : jump + 10]) > 0.0


@pytest.mark.parametrize(
    ("reference", "expected"),
    [
        (np.where(np.arange(200) < 100, 0.0, 1.0), 80),  # a jump 30 samples before
        (np.where(np.arange(200) < 60, 0.0, 1.0), 130),  # too long before to be what sets the shaft off
        (np.where(np.arange(200) < 100, 0.0, 0.1 * (np.arange(200) - 99)), 130),  # a ramp
        (np.where(np.arange(200) < 100, 0.001 * np.arange(200), 1.0), 130),  # it didn't stand before
        (np.where(np.arange(200) < 100, 0.0, np.minimum(1.0, 0.6 + 0.02 * np.arange(-100, 100))), 80),
        (np.zeros(200), 130),
    ],
)
def test_only_a_jump_out_of_a_standing_reference_sets_a_stretch_off(
    reference: NDArray[np.float64], expected: int
) -> None:
    """At 500 Hz, with a proportional law: the input is 3 (r - y)."""
    data = replace(dataset(seed=1, samples=200, u=3 * reference, y=np.zeros(200)), reference=reference)

    assert _set_off(data, 130, 40) == expected


def test_a_count_that_changed_before_the_jump_is_left_out() -> None:
    n, y = np.arange(200), np.where(np.arange(200) < 90, 0.0, QUANTUM)
    reference = np.where(n < 100, 0.0, 1.0)
    data = replace(dataset(seed=1, samples=200, u=reference - y, y=y), reference=reference)

    assert _set_off(data, 130, 40) == 90


@pytest.mark.parametrize(
    "u",
    [
        np.where(
            np.arange(200) < 100, 0.0, 0.05 * (np.arange(200) - 99)
        ),  # the reference goes to an integral alone
        np.where(np.arange(200) < 100, 0.001 * np.arange(200), 1.1),  # an integral gathers before
    ],
)
def test_a_voltage_that_does_not_jump_out_of_standing_sets_no_stretch_off(u: NDArray[np.float64]) -> None:
    reference = np.where(np.arange(200) < 100, 0.0, 1.0)
    data = replace(dataset(seed=1, samples=200, u=u, y=np.zeros(200)), reference=reference)

    assert _set_off(data, 130, 40) == 130


def test_a_record_in_open_loop_is_left_whole() -> None:
    data = dataset(seed=1)
    again = replace(data, reference=data.u)

    assert stretches_of_motion([data, again]) == ((data, again), [])


def test_a_loop_that_hardly_moves_says_what_to_do_instead() -> None:
    """Steps of 0.1 rad, 33 counts, under a strong torque."""
    result = identify(followed(square(0.05), 3e-5, seed=1))

    assert result.verdict is not Verdict.TRUSTED
    told = [finding.sentence for finding in result.findings if finding.code == "loop-tells-little"]
    assert len(told) == 1
    assert "in open loop" in told[0]
