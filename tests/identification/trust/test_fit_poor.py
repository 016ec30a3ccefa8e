"""A simulation that explains little of a noisy sensor isn't wrong for that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.finding import Finding, Severity
from servobench.identification.trust.doubts.base import about_fit
from servobench.recordings.measurement.dataset import Dataset
from tests.contracts.finding_examples.base import fitted
from tests.datasets import dataset

STEP = np.where(np.arange(600) < 100, 0.0, 2.0)  # V


def step(noise: NDArray[np.float64], times: float = 1.3) -> Dataset:
    """A speed after a step [rad/s] and what a sensor adds to it (600,), so many times as large."""
    clean = dataset(seed=1, samples=600, sample_time=0.005, u=STEP, chain="derivative")
    size = float(clean.y.std()) * noise / noise.std()
    return replace(clean, y=clean.y + times * size)


def poor(data: Dataset) -> Finding:
    (finding,) = [each for each in about_fit(fitted(data, "first_order_one_way")) if each.code == "fit-poor"]
    return finding


def test_noise_of_a_sensor_is_named_and_what_goes_on_from_sample_to_sample_is_doubted() -> None:
    """Both leave 60 % of the output and more."""
    random = np.random.default_rng(2).standard_normal(600)

    white, slow = poor(step(random)), poor(step(np.convolve(random, np.ones(60), "same")))

    assert white.severity is Severity.INFO
    assert "changes from one sample to the next as no motor does" in white.sentence
    assert slow.severity is Severity.WARNING


def test_errors_that_a_few_neighbours_share_are_the_sensor_s_as_well() -> None:
    """Errors of a position, averaged over two rows and differenced over two: alike in neighbours, and gone in longer means."""
    random = np.random.default_rng(2).standard_normal(603)
    shared = np.convolve(random, [1.0, 1.0, -1.0, -1.0], "valid")

    # A half of the time constant is ten rows, of whose mean the twelve squares at its ends are left: 0.17 of a sample.
    assert np.corrcoef(shared[1:], shared[:-1])[0, 1] > 0.2
    assert poor(step(shared, 1.0)).severity is Severity.INFO


def test_a_step_within_the_ripple_of_a_motor_that_turns_all_the_while_is_called_too_small() -> None:
    """Ripple that neighbours share, as of a commutator: the columns are the right ones."""
    u = 8.0 + 0.25 * STEP
    clean = dataset(seed=1, samples=600, sample_time=0.005, u=u, chain="derivative")
    ripple = 8.0 * np.sin(0.3 * np.arange(600))

    (sentence,) = [poor(replace(clean, y=clean.y + ripple).part(0.4, 3.0)).sentence]

    assert "Let the input change by more" in sentence


def test_noise_alone_is_no_motor() -> None:
    """An output that has nothing to do with the input is noise as well."""
    random = np.random.default_rng(3).standard_normal(600)
    alone = replace(step(random), y=random)

    assert poor(alone).severity is Severity.WARNING


def test_rounded_counts_that_were_differenced_are_noise_of_the_sensor() -> None:
    """What one row has too much the next one lacks: neighbours are opposed, not alike."""
    rounding = np.random.default_rng(4).uniform(-0.5, 0.5, 601)

    assert poor(step(np.diff(rounding))).severity is Severity.INFO
