"""A value that jumps away and back is a spike; the tip of a reversal isn't one. Few and small ones go into the intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Severity
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.identification.trust.doubts.spikes import spike_pairs, spikes, spikes_of
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


def test_what_few_and_small_spikes_move_is_a_line_of_the_budget(noisy: Dataset) -> None:
    clean, result = identify(noisy), identify(with_spikes(noisy, 25.0))

    assert severity(result) == Severity.INFO
    assert result.verdict.value == "trusted"
    assert clean.fit is not None
    assert result.fit is not None
    (line,) = (each for each in result.fit.budget if each.source == "spikes")
    # To first order it is the square of the difference that the spike makes.
    for at, name in enumerate(result.fit.model.names):
        moved = result.fit.model[name] - clean.fit.model[name]
        assert np.sqrt(line.covariance[at, at]) == pytest.approx(
            abs(moved), rel=0.2, abs=0.02 * result.fit.sd(name)
        )


def test_spikes_that_are_most_of_the_residual_are_doubted(noisy: Dataset) -> None:
    result = identify(with_spikes(noisy, 60.0, -60.0, 60.0))

    assert severity(result) == Severity.WARNING
    assert result.verdict.value == "doubtful"
