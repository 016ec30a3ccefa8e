"""A value that jumps away and back is a spike; the tip of a reversal isn't one. It is left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Severity, Verdict
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.identification.trust.doubts.spikes import spike_pairs, spikes, spikes_of, without_spikes
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

TRIANGLE = np.abs((np.arange(1000) / 250 + 0.5) % 2 - 1)  # four sharp reversals
STEP = 1 / 250


@pytest.mark.parametrize("quantum", [0.0, STEP / 100])
def test_a_sharp_reversal_is_no_spike(quantum: float) -> None:
    assert spikes(TRIANGLE, np.zeros(len(TRIANGLE)), quantum).tolist() == []


@pytest.mark.parametrize("size", [20 * STEP, -20 * STEP])
def test_a_value_off_a_straight_course_is_one(size: float) -> None:
    y = TRIANGLE.copy()
    y[300] += size

    assert spikes(y, np.zeros(len(y)), STEP / 100).tolist() == [300]


@pytest.mark.parametrize("samples", [20, 50, 100, 149, 400])
def test_a_spike_is_found_in_a_record_of_any_length(samples: int) -> None:
    t = np.arange(samples) / samples
    y = 100.0 * -np.expm1(-t / 0.2) + 0.3 * np.random.default_rng(2).standard_normal(samples)
    spiky = y.copy()
    spiky[samples // 2] += 60.0

    assert spikes(y, np.zeros(len(y)), 0.0).tolist() == []
    assert spikes(spiky, np.zeros(samples), 0.0).tolist() == [samples // 2]


def test_the_corner_of_a_step_from_rest_is_no_spike_in_a_short_record() -> None:
    y = 100.0 * -np.expm1(-np.maximum(np.arange(40) - 5, 0) / 3.0)

    assert spikes(y, np.zeros(len(y)), 0.0).tolist() == []
    assert spikes(y, np.where(np.arange(40) < 5, 0.0, 12.0), 0.0).tolist() == []


def test_a_spike_under_an_input_that_never_stays_is_one() -> None:
    """A sine of 20 samples a period changes by more than a twentieth of its range in most of them."""
    k = np.arange(400)
    y = 50.0 * np.sin(2 * np.pi * k / 20.0 - 0.8)
    y[201] += 200.0

    assert spikes(y, np.sin(2 * np.pi * k / 20.0), 0.0).tolist() == [201]


def test_a_motor_that_sets_off_in_a_sample_hides_no_spike() -> None:
    """A short record that begins with 40 rad/s in a sample, and a reading that is off by 50: one only where the input stays."""
    k = np.arange(45)
    y = 100.0 * -np.expm1(-np.maximum(k - 5, 0) / 2.0) + 1.5 * np.random.default_rng(4).standard_normal(45)
    step, pulse = np.where(k < 5, 0.0, 100.0), np.where((k < 5) | (k == 30), 0.0, 100.0)
    y[31] += 50.0

    assert spikes(y, step, 0.0).tolist() == [31]
    assert spikes(y, pulse, 0.0).tolist() == []


def spin_up(samples: int = 200) -> np.ndarray:
    """A speed that is read in steps of 0.5: at rest, and from sample 100 on towards 30 with a time constant of 6 samples."""
    return np.round(60.0 * -np.expm1(-np.maximum(np.arange(samples) - 100, 0) / 6.0)) / 2.0


SWITCHED_ON = np.where(np.arange(200) < 100, 0.0, 12.0)


@pytest.mark.parametrize("at", [101, 104, 150])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_two_values_in_a_row_far_off_are_a_spike_too(at: int, sense: float) -> None:
    y = spin_up()
    y[[at, at + 1]] = [43.0, 44.5]
    data = dataset(seed=1, samples=200, sample_time=0.02, u=SWITCHED_ON, y=sense * y)

    assert spike_pairs(sense * y, SWITCHED_ON, 0.0).tolist() == [at]
    assert spikes_of(replace(data, kind="speed", quantum=None)).tolist() == [at, at + 1]


def test_a_measured_voltage_hides_no_spike() -> None:
    """It differs from sample to sample by a hundredth of its range."""
    y, noise = spin_up(), 0.01 * np.random.default_rng(3).standard_normal(200)
    y[[150, 151]] = [43.0, 44.5]

    assert spike_pairs(y, SWITCHED_ON + noise * np.ptp(SWITCHED_ON), 0.0).tolist() == [150]


def test_a_motor_that_follows_a_short_pulse_of_its_input_has_no_spike() -> None:
    u, y = np.zeros(200), 0.1 * np.random.default_rng(1).standard_normal(200)
    u[100:102], y[101:103] = 12.0, [28.0, 30.0]

    assert spike_pairs(y, u, 0.0).tolist() == []
    assert spike_pairs(y, np.zeros(200), 0.0).tolist() == [101]


@pytest.mark.parametrize(
    "y",
    [
        pytest.param(spin_up(), id="a step from rest"),
        pytest.param(np.cumsum(spin_up()), id="its position"),
        pytest.param(TRIANGLE, id="reversals"),
        pytest.param(np.where(np.arange(200) < 100, 3.0, 5.0), id="a step that stays"),
        pytest.param(
            spin_up()
            + 12.0 * np.exp(-np.maximum(np.arange(200) - 100, 0) / 8.0) * np.sin(np.arange(200) - 100),
            id="a shaft that rings",
        ),
        pytest.param(np.random.default_rng(3).standard_normal(2000), id="noise"),
    ],
)
def test_no_other_motion_has_a_pair(y: np.ndarray) -> None:
    assert spike_pairs(y, np.zeros(len(y)), 0.0).tolist() == []


@pytest.fixture(scope="module")
def noisy() -> Dataset:
    """The speed of the reference motor, with noise of 1 rad/s."""
    data = dataset(seed=1, kind="prbs", samples=3000)
    speed = np.gradient(data.y, data.t_output) + np.random.default_rng(4).normal(0.0, 1.0, len(data.y))
    return replace(data, y=speed, kind="speed", output_unit="rad/s", quantum=None, chain_known=True)


def with_spikes(data: Dataset, *heights: float) -> Dataset:
    """The output is off by these heights [rad/s], each in a sample of its own."""
    y = data.y.copy()
    y[400 * (1 + np.arange(len(heights)))] += heights
    return replace(data, y=y)


def severity(result: Result) -> Severity:
    (finding,) = (each for each in result.findings if each.code == "output-spikes")
    return finding.severity


@pytest.mark.parametrize("heights", [(25.0,), (60.0, -60.0, 60.0), (400.0, 25.0)])
def test_spikes_are_left_out_and_the_rest_is_identified(noisy: Dataset, heights: tuple[float, ...]) -> None:
    """Whatever their size, the answer is that of the record without those samples; a large one hides no small one."""
    spiky = with_spikes(noisy, *heights)
    where = 400 * (1 + np.arange(len(heights)))
    result, without = identify(spiky), identify(noisy.without(where))

    assert severity(result) == Severity.INFO
    assert result.verdict is without.verdict is Verdict.TRUSTED
    assert result.fit is not None
    assert without.fit is not None
    assert result.fit.model.theta.tolist() == without.fit.model.theta.tolist()
    assert result.fit.covariance.tolist() == without.fit.covariance.tolist()
    (finding,) = (each for each in result.findings if each.code == "output-spikes")
    assert finding.rows == (where[0] + 1, where[-1] + 1)


def test_a_sample_left_out_leaves_the_input_whole_and_the_other_rows_their_numbers(noisy: Dataset) -> None:
    left = noisy.without(np.array([0, 7]))

    assert left.u.tolist() == noisy.u.tolist()
    assert left.y.tolist() == noisy.y[[*range(1, 7), *range(8, len(noisy.y))]].tolist()
    assert left.row_numbers(np.array([0, 6])).tolist() == [2, 9]
    assert left.without(np.array([0])).row_numbers(np.array([0])).tolist() == [3]


def test_spikes_behind_a_filter_or_for_a_method_asked_for_stay_and_are_doubted(noisy: Dataset) -> None:
    spiky = with_spikes(noisy, 60.0, -60.0, 60.0)
    filtered = replace(spiky, declared=Chain.parse("lowpass 200 rad/s"))

    assert without_spikes([filtered])[0][0] is filtered
    for result in (identify(spiky, estimator="output_error"), identify(filtered)):
        assert severity(result) == Severity.WARNING
        assert result.verdict is Verdict.DOUBTFUL


def test_a_record_to_validate_on_is_held_against_the_model_without_its_spikes(noisy: Dataset) -> None:
    other = dataset(seed=2, kind="prbs", samples=2000)
    speed = np.gradient(other.y, other.t_output) + np.random.default_rng(5).normal(0.0, 1.0, len(other.y))
    other = replace(other, name="other", y=speed, kind="speed", output_unit="rad/s", quantum=None)
    spiky = with_spikes(other, 500.0, -500.0)

    clean, result = (identify(noisy, validate_on=each) for each in (other, spiky))

    assert result.validation is not None
    assert clean.validation is not None
    assert result.validation.fit_percent == pytest.approx(clean.validation.fit_percent, abs=0.1)
    assert severity(result) == Severity.INFO


@pytest.mark.parametrize("samples", [60, 400])
def test_the_answer_to_a_pulse_is_not_left_out(samples: int) -> None:
    """A motor that is quicker than its samples answers in one of them; it may be all that the record says of it."""
    u, y = np.zeros(samples), 0.1 * np.random.default_rng(1).standard_normal(samples)
    u[samples // 2], y[samples // 2 + 1] = 12.0, 28.0
    pulse = dataset(seed=1, samples=samples, sample_time=0.02, u=u, y=y)
    pulse = replace(pulse, kind="speed", output_unit="rad/s", quantum=None)
    false = replace(pulse, u=np.where(np.arange(samples) < 10, 0.0, 12.0))

    assert spikes_of(pulse).tolist() == spikes_of(false).tolist() == [samples // 2 + 1]
    assert without_spikes([pulse])[0][0] is pulse
    assert len(without_spikes([false])[0][0].y) == samples - 1
    goal = replace(false, input_unit="rad")  # a loop that has got there within a sample
    assert without_spikes([goal])[0][0] is goal
