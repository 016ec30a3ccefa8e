"""A coarse sensor is said to be one, and rows at the sensor's own steps to be that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Severity
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.identification.trust.doubts.resolution import is_sampled_by_edges
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

STEP = 2 * np.pi / 20
COARSE = 2 * np.pi / 4
GAIN, TAU, LEVEL = 20.0, 0.1, 3.0


def of_edges() -> Dataset:
    """The times [s], in whole milliseconds, at which a motor under 3 V passes each of the 20 slots of a disc."""
    fine = np.arange(0.0, 2.0, 1e-5)
    angle = GAIN * LEVEL * (fine - TAU * -np.expm1(-fine / TAU))
    edges = STEP * np.arange(1, int(angle[-1] / STEP))
    t = np.round(np.interp(edges, angle, fine), 3)
    like = dataset(seed=1, samples=len(t), u=np.full(len(t), LEVEL), y=edges)
    return replace(like, t_input=t, t_output=t, quantum=STEP, input_before=0.0)


def read_evenly(step: float = STEP) -> Dataset:
    """The same disc, or one with other steps, read every 20 ms."""
    t = 0.02 * np.arange(100)
    angle = GAIN * LEVEL * (t - TAU * -np.expm1(-t / TAU))
    like = dataset(
        seed=1, samples=100, sample_time=0.02, u=np.full(100, LEVEL), y=(np.floor(angle / step) + 0.5) * step
    )
    return replace(like, quantum=step)


def fitted(data: Dataset) -> Fit:
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [data])


@pytest.mark.parametrize(
    ("data", "beginning", "severity"),
    [
        (of_edges(), "Each row is one step of the sensor", Severity.INFO),
        (read_evenly(), "The sensor is coarse", Severity.INFO),  # 19 steps in the 0.1 s of the time constant
        (read_evenly(COARSE), "The sensor is coarse", Severity.INFO),  # 4
    ],
)
def test_rows_at_the_steps_of_a_sensor_are_told_from_a_coarse_one(
    data: Dataset, beginning: str, severity: Severity
) -> None:
    (finding,) = DOUBTS["resolution"].about_fit(fitted(data))

    assert finding.code == "resolution-coarse"
    assert finding.sentence.startswith(beginning)
    assert finding.severity is severity


def test_less_than_a_step_in_a_time_constant_is_a_doubt() -> None:
    """Steps of 60 rad, of which the motor passes one a second, and a fit that is sure of the time constant."""
    fit = fitted(read_evenly(60.0))
    sure = replace(
        fit,
        covariance=1e-12 * fit.covariance,
        model=replace(fit.model, theta=np.array([20.0, 0.1, 0.0, 0.0])),
    )
    (finding,) = DOUBTS["resolution"].about_fit(sure)

    assert finding.severity is Severity.WARNING


def test_a_step_in_each_row_at_even_times_is_an_even_motion() -> None:
    data = of_edges()
    t = 0.005 * np.arange(len(data.y))

    assert is_sampled_by_edges(data, STEP)
    assert not is_sampled_by_edges(replace(data, t_input=t, t_output=t), STEP)


@pytest.mark.parametrize(("noise", "coarse"), [(0.1, True), (0.6, False)])
def test_noise_of_half_a_step_makes_rounding_random(noise: float, coarse: bool) -> None:
    """A speed with 20 steps over its range, with noise of so many of them before it is rounded."""
    data = dataset(seed=1, kind="prbs", samples=3000)
    speed = np.gradient(data.y, data.t_output)
    step = float(np.ptp(speed)) / 20
    random = np.random.default_rng(2).standard_normal(len(speed))
    rounded = step * np.rint(speed / step + noise * random)
    fit = fitted(replace(data, y=rounded, kind="speed", output_unit="rad/s", quantum=None))

    found = DOUBTS["resolution"].about_fit(fit)
    # The steps of a speed are in no interval but that for model error.
    assert [(each.code, each.severity) for each in found] == [
        ("resolution-coarse", Severity.WARNING)
    ] * coarse
