"""A closed loop's record is fitted where the shaft moves, one in open loop as it is."""

from dataclasses import replace

import numpy as np
import pytest

from servobench.control.pid import Pid
from servobench.devices.twin import Twin, TwinSettings
from servobench.experiment import Experiment
from servobench.finding import Severity, Verdict
from servobench.identification import identify
from servobench.loop.run import run
from servobench.measurement.dataset import Dataset
from servobench.measurement.measure import measure
from servobench.models.stretches import stretches_of_motion
from servobench.signals.sine import Sine
from servobench.signals.square import Square
from tests.datasets import dataset

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

    assert {each.code for each in result.findings if each.severity is Severity.WARNING} == {"rests-left-out"}
    assert result.fit is not None
    assert result.fit.estimator == ("prediction_error" if torque_noise else "output_error")
    for name, true in (("gain", GAIN), ("time_constant", TIME_CONSTANT)):
        assert abs(result.fit[name].value - true) < 3.3 * result.fit[name].sd, name


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
