"""Interval likelihood: its formulas against numerical ones, what it says of the noise, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Severity
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.estimators.interval.bins import bins, expected_information
from servobench.identification.estimators.interval_likelihood import _floor
from servobench.identification.estimators.least_squares import Layout
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset
from tests.truth.test_counts_as_bins import STRUCTURE, Motor, fitted, position, record


def log_likelihood(theta: Array, data: Dataset, s: float) -> float:
    """Σ ln P from the exact motor's own recursion and differences of normal distributions."""
    gain, tau, lost, delay, start, speed = theta
    shaft = position(Motor(gain, tau, delay, start, speed), data.u - lost, 0.002)
    low, high = (data.y - 0.5 * QUANTUM - shaft) / s, (data.y + 0.5 * QUANTUM - shaft) / s
    p = np.where(low > 0, norm.sf(low) - norm.sf(high), norm.cdf(high) - norm.cdf(low))
    return float(np.sum(np.log(p)))


@pytest.mark.parametrize("s", [0.02, 0.1, 0.5, 3.0])
def test_score_information_and_slope_are_the_derivatives_of_the_probability(s: float) -> None:
    x = np.linspace(-0.5 - 3 * s, 0.5 + 3 * s, 41) + 1e-3

    def log_p(at: Array, noise: float) -> Array:
        return np.log(norm.cdf((0.5 - np.abs(at)) / noise) - norm.cdf((-0.5 - np.abs(at)) / noise))

    step = 1e-3 * s
    said = bins(x, 1.0, s)
    up, down, here = log_p(x + step, s), log_p(x - step, s), log_p(x, s)
    # Differences of second order: a millionth of the third and fourth derivatives, which are some units of 1/s³ and 1/s⁴.
    np.testing.assert_allclose(said.score * s, (up - down) / (2e-3), atol=2e-5)
    np.testing.assert_allclose(said.information * s**2, -(up - 2 * here + down) / 1e-6, atol=2e-4)
    assert said.log_likelihood == pytest.approx(here.sum(), rel=1e-9)
    more, less = bins(x, 1.0, s * np.exp(1e-4)), bins(x, 1.0, s * np.exp(-1e-4))
    assert said.slope == pytest.approx((more.log_likelihood - less.log_likelihood) / 2e-4, rel=1e-5)
    assert said.curvature == pytest.approx(-(more.slope - less.slope) / 2e-4, rel=1e-5)


def test_a_position_far_from_its_bin_is_as_unlikely_as_the_tail_says_and_no_worse() -> None:
    """A thousand counts off with s = 0.02: ln Φ(-50000), and the information of the noise alone."""
    said = bins(np.array([1000.5]), 1.0, 0.02)
    assert said.log_likelihood == pytest.approx(norm.logcdf(-50000.0), rel=1e-12)
    assert said.score[0] == pytest.approx(-50000.0 / 0.02, rel=1e-6)
    assert 0 <= said.information[0] <= 2500.0


@pytest.mark.parametrize(
    ("s", "mean"), [(0.02, 90.32), (0.05, 36.13), (0.1, 18.06), (0.2, 9.03), (0.5, 3.00)]
)
def test_the_expected_information_is_the_mean_square_of_the_score_over_all_bins(
    s: float, mean: float
) -> None:
    """The means over a bin are those of the field's table, to its digits."""
    x = (np.arange(400) + 0.5) / 400 - 0.5
    edges = np.arange(-8, 9) - 0.5
    p = norm.cdf((edges[1:, None] - x) / s) - norm.cdf((edges[:-1, None] - x) / s)
    scores = np.array([bins(x - centre, 1.0, s).score for centre in edges[:-1] + 0.5])
    found = expected_information(x, 1.0, s)
    # In the middle of a bin the sum here is a difference of ones; there is next to no information there.
    np.testing.assert_allclose(found, np.sum(p * scores**2, axis=0), rtol=1e-6, atol=1e-9 * mean)
    # 400 points of a peak of width s ≥ 8 of their steps: the trapezoid is exact far beyond the table's digits.
    assert found.mean() == pytest.approx(mean, abs=0.006)


def test_the_fit_is_the_maximum_of_a_likelihood_from_elsewhere() -> None:
    """Likelier than its neighbours a fifth of a standard deviation away, and than the truth by no more than chance explains."""
    data, true = record(11, 0.1, delay=0.0006)
    fit = fitted(data)
    s = _noise(fit)[0] * QUANTUM
    theta = np.concatenate([fit.model.theta, fit.records[0].nuisance])
    here = log_likelihood(theta, data, s)
    truth = np.array([true.gain, true.time_constant, 0.0, true.delay, true.position, true.speed])
    # Twice the gain over the truth is χ² with 6 degrees of freedom, its 99.9 % point 22.5.
    assert 0 < 2 * (here - log_likelihood(truth, data, s)) < 22.5
    sd = np.sqrt(np.diag(fit.covariance))
    for n, step in enumerate(0.2 * sd):
        for way in (-step, step):
            moved = theta.copy()
            moved[n] += way
            assert log_likelihood(moved, data, s) < here
    ends = []
    for way in (-0.02, 0.02):
        moved = theta.copy()
        moved[4] += way * QUANTUM
        ends.append(log_likelihood(moved, data, s))
    # All samples know the start position alike: N times the information of a sample, 18.06/Q² on average.
    curvature = -(sum(ends) - 2 * here) / (0.02 * QUANTUM) ** 2
    assert curvature == pytest.approx(5000 * 18.06 / QUANTUM**2, rel=0.1)


def test_counts_at_the_lower_edge_of_their_bins_give_the_same_motor_half_a_count_further_back() -> None:
    centred, _ = record(3, 0.05)
    floored = replace(centred, y=centred.y - 0.5 * QUANTUM)
    one, other = fitted(centred), fitted(floored)
    sd = np.sqrt(np.diag(one.covariance))
    np.testing.assert_allclose(other.model.theta, one.model.theta, atol=1e-3 * sd.min(), rtol=1e-9)
    assert one.records[0].nuisance[0] - other.records[0].nuisance[0] == pytest.approx(0.5 * QUANTUM, rel=1e-5)


def test_the_noise_before_rounding_is_found() -> None:
    """In 20 runs, an interval of 95 % misses more than 4 times in 1 case of 400."""
    misses = 0
    for seed in range(20):
        data, _ = record(seed, 0.05)
        value, low, high = _noise(fitted(data))
        misses += not low <= 0.05 <= high
        assert value == pytest.approx(0.05, rel=0.2)
    assert misses <= 4


def test_with_a_count_of_noise_it_is_output_error() -> None:
    data, _ = record(5, 1.0)
    one, other = fitted(data), fitted(data, "output_error")
    for name in ("gain", "time_constant", "coulomb_voltage", "delay"):
        assert abs(one[name].value - other[name].value) < 0.05 * other[name].sd
        assert one[name].sd == pytest.approx(other[name].sd, rel=0.05)
    assert "output_error does as well" in one.findings[-1].sentence


def test_without_noise_the_least_that_an_encoder_is_worth_is_taken_and_reported() -> None:
    data, _ = record(6, 0.0)
    fit = fitted(data)
    assert "noise-below-rounding" in {finding.code for finding in fit.findings}
    assert {finding.severity for finding in fit.findings} == {Severity.INFO}


@pytest.mark.parametrize("counts", [5, 100, 100_000])
def test_a_miscount_neither_breaks_the_fit_nor_goes_untold(counts: int) -> None:
    data, true = record(4, 0.05)
    y = data.y.copy()
    y[2500] += counts * QUANTUM
    fit = fitted(replace(data, y=y))
    assert np.isfinite(fit.model.theta).all()
    assert np.isfinite(fit.covariance).all()
    assert np.isfinite(fit.records[0].innovations).all()
    assert abs(fit["gain"].value - true.gain) < 3.3 * fit["gain"].sd
    (finding,) = (finding for finding in fit.findings if finding.code == "counts-off")
    assert "a sample is" in finding.sentence
    assert "at 5 s" in finding.sentence


def test_a_random_torque_is_reported_from_noise_of_the_measurement() -> None:
    """A torque of 1e-7 N·m/√Hz leaves residuals of 1.07 times the rounding, and spoils the intervals."""
    data = dataset(seed=1, torque_noise=1e-7)
    codes = {finding.code for finding in fitted(data).findings}
    assert "noise-not-of-the-measurement" in codes


def test_white_noise_is_not_taken_for_a_torque() -> None:
    """By chance in 1 of 100: 3 or more of 30 in 1 case of 300."""
    warned = 0
    for seed in range(30):
        data, _ = record(seed, 0.05)
        warned += "noise-not-of-the-measurement" in {finding.code for finding in fitted(data).findings}
    assert warned <= 2


def test_records_share_the_parameters_and_the_noise() -> None:
    data, true = record(8, 0.05)
    parts = [data.part(0.0, 5.0), data.part(5.0, 11.0)]
    joint = ESTIMATORS["interval_likelihood"].fit(STRUCTURE, parts)
    for name, value in (("gain", true.gain), ("time_constant", true.time_constant)):
        assert abs(joint[name].value - value) < 3.3 * joint[name].sd
        assert joint[name].sd < min(fitted(part)[name].sd for part in parts)


def test_irregular_times_and_friction_with_reversals_are_no_hindrance() -> None:
    data, true = record(9, 0.05)
    keep = np.random.default_rng(9).random(5000) > 1 / 3
    fit = fitted(replace(data, t_output=data.t_output[keep], y=data.y[keep]))
    assert abs(fit["gain"].value - true.gain) < 3.3 * fit["gain"].sd
    reversing = dataset(seed=1, kind="prbs")
    turned = ESTIMATORS["interval_likelihood"].fit(STRUCTURES["first_order_coulomb"], [reversing])
    assert turned.converged
    assert turned["coulomb_voltage"].value == pytest.approx(8e-4 * 8.4 / 0.042, rel=1e-3)


def test_data_that_are_no_bins_are_refused_with_the_reason() -> None:
    data, _ = record(2, 0.05)
    smoothed = replace(data, y=np.convolve(data.y, [0.25, 0.5, 0.25], mode="same"))
    behind_chain = dataset(seed=1, chain="derivative | lowpass 50 rad/s")
    for refused, why in (
        (replace(data, quantum=None), "the encoder's step"),
        (smoothed, "whole steps of 0.00306796 rad"),
        (behind_chain, "a speed or data behind a measurement chain"),
    ):
        with pytest.raises(NotIdentifiable, match=why):
            fitted(refused)


def test_fewer_samples_than_unknowns_are_refused() -> None:
    data, _ = record(2, 0.05)
    few = replace(data, t_output=data.t_output[:6], y=data.y[:6])
    with pytest.raises(NotIdentifiable, match="6 samples for 6 unknowns"):
        ESTIMATORS["interval_likelihood"].fit(STRUCTURE, [few], [np.array([23.0, 0.1, 0.0, 0.0, 0.0, 50.0])])


def _noise(fit: Fit) -> tuple[float, float, float]:
    """The noise in counts that a fit tells, and its interval."""
    (told,) = (finding.sentence for finding in fit.findings if finding.code == "noise-before-rounding")
    words = told.replace("(", "").replace(")", "").replace(".\n", "").split()
    numbers = [float(word.rstrip(".:")) for word in words if word[0].isdigit()]
    return numbers[0], numbers[1], numbers[2]


def test_the_least_noise_that_is_tried_leaves_eight_samples_near_an_edge_for_each_unknown() -> None:
    """Unknown are the parameters and the start's place and speed; within s of an edge are 2 s/Q of 500 samples."""
    structure, data = STRUCTURES["first_order_coulomb"], dataset(seed=1, samples=500)
    unknowns = len(structure.parameters) + 2

    assert _floor(Layout(structure, (data,))) == pytest.approx(8 * unknowns / (2 * 500) * QUANTUM)
