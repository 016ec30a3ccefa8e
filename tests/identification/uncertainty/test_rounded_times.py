"""Rounded times add as much to the intervals as to the errors of the parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.rounded_times import time_step, with_rounded_times
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset, prbs

GAIN, TAU, SAMPLE_TIME = 20.0, 0.1, 0.005  # rad/(s·V), s, s
SAMPLES, NOISE = 800, 1e-3  # of the angle [rad]
RUNS = 40
FIRST_ORDER = STRUCTURES["first_order"]


def recorded(seed: int, step: float, jitter: float = 0.4 * SAMPLE_TIME) -> Dataset:
    """Return a record whose times lie unevenly, and are rounded to a step; the angle is the sum of the answers to all changes.

    A change Δu at a time s makes K Δu (t - s - τ (1 - exp(-(t - s)/τ))) of the angle from then on.
    """
    random = np.random.default_rng(seed)
    t = SAMPLE_TIME * np.arange(SAMPLES) + random.uniform(0.0, jitter, SAMPLES)
    u = prbs(SAMPLES, 8, random)
    changes = np.flatnonzero(np.diff(u, prepend=0.0))
    since = np.maximum(t[:, None] - t[changes], 0.0)
    answers = since - TAU * (1.0 - np.exp(-since / TAU))
    angle = GAIN * answers @ np.diff(u, prepend=0.0)[changes]
    rounded = step * np.round(t / step)
    plain = dataset(seed=seed, u=u, samples=SAMPLES, sample_time=SAMPLE_TIME, y=angle)
    y = angle + NOISE * random.standard_normal(SAMPLES)
    return replace(plain, y=y, t_input=rounded, t_output=t)


def fitted(data: Dataset) -> Fit:
    return ESTIMATORS["output_error"].fit(FIRST_ORDER, [data])


@pytest.mark.parametrize("step", [1e-3, 1e-4])
def test_the_line_is_as_large_as_the_errors_that_rounded_times_make(step: float) -> None:
    """χ² of the runs' normalised errors lies where a χ² of so many degrees of freedom does in 99.9 of 100 cases."""
    errors, without = [], []
    for seed in range(RUNS):
        fit = fitted(recorded(seed, step))
        wide = with_rounded_times(fit)
        errors.append((wide["gain"].value - GAIN) / wide["gain"].sd)
        without.append((fit["gain"].value - GAIN) / fit["gain"].sd)

    assert 14.0 < np.sum(np.square(errors)) < 78.0
    assert np.sum(np.square(without)) > 78.0


def test_the_line_says_what_it_is_for() -> None:
    (line,) = with_rounded_times(fitted(recorded(1, 1e-3))).budget

    assert line.source == "rounded times"
    assert "1000 µs" in line.reason


def test_voltages_that_were_replaced_at_once_stay_in_order_however_their_times_are_rounded() -> None:
    plain = recorded(4, 1e-4)
    t = plain.t_input.copy()
    t[100:103] = t[102] + 1e-9 * np.arange(-2, 1)

    (line,) = with_rounded_times(fitted(replace(plain, t_input=t))).budget

    assert line.source == "rounded times"


@pytest.mark.parametrize("step", [1e-3, 1e-4, 1e-6])
def test_the_step_of_the_times_is_found(step: float) -> None:
    assert time_step(recorded(2, step)) == pytest.approx(step)


def test_even_times_and_even_times_with_rows_missing_are_on_no_step() -> None:
    plain = dataset(seed=3, kind="prbs", samples=SAMPLES, sample_time=SAMPLE_TIME)
    keep = np.random.default_rng(3).random(SAMPLES) > 0.1
    gaps = replace(plain, u=plain.u[keep], t_input=plain.t_input[keep])

    assert time_step(plain) == 0.0
    assert time_step(gaps) == 0.0
    assert time_step(recorded(3, 1e-12)) == 0.0


def test_a_fit_that_knows_a_random_torque_stays_as_it_is() -> None:
    fit = ESTIMATORS["prediction_error"].fit(FIRST_ORDER, [recorded(4, 1e-3)])

    assert with_rounded_times(fit) is fit
