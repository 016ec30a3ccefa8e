"""A value that jumps away and back is a spike; the tip of a reversal isn't one. Few and small ones go into the intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Severity
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.identification.trust.doubts.spikes import spikes
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

TRIANGLE = np.abs((np.arange(1000) / 250 + 0.5) % 2 - 1)  # four sharp reversals
STEP = 1 / 250


@pytest.mark.parametrize("quantum", [0.0, STEP / 100])
def test_a_sharp_reversal_is_no_spike(quantum: float) -> None:
    assert spikes(TRIANGLE, quantum).tolist() == []


@pytest.mark.parametrize("size", [20 * STEP, -20 * STEP])
def test_a_value_off_a_straight_course_is_one(size: float) -> None:
    y = TRIANGLE.copy()
    y[300] += size

    assert spikes(y, STEP / 100).tolist() == [300]


@pytest.mark.parametrize("samples", [20, 50, 100, 149, 400])
def test_a_spike_is_found_in_a_record_of_any_length(samples: int) -> None:
    t = np.arange(samples) / samples
    y = 100.0 * -np.expm1(-t / 0.2) + 0.3 * np.random.default_rng(2).standard_normal(samples)
    spiky = y.copy()
    spiky[samples // 2] += 60.0

    assert spikes(y, 0.0).tolist() == []
    assert spikes(spiky, 0.0).tolist() == [samples // 2]


def test_the_corner_of_a_step_from_rest_is_no_spike_in_a_short_record() -> None:
    y = 100.0 * -np.expm1(-np.maximum(np.arange(40) - 5, 0) / 3.0)

    assert spikes(y, 0.0).tolist() == []


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
