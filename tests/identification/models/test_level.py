"""The levels of the input that moved a motor, if the reading of the shaft is noisy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.identify import identify
from servobench.identification.models.level import few_levels, single_level
from servobench.identification.uncertainty.identifiability import State
from servobench.recordings.measurement.base import Kind
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

STEP = 0.002
GAIN, LAG = 20.0, 0.05


def noisy(levels: tuple[float, ...], kind: Kind, noise: float, each: int = 300) -> Dataset:
    """A motor under levels of the same length, whose output is read with white noise."""
    u = np.repeat(levels, each)
    speed = np.zeros(len(u))
    for k in range(1, len(u)):
        speed[k] = speed[k - 1] + STEP / LAG * (GAIN * u[k - 1] - speed[k - 1])
    y = np.cumsum(speed) * STEP if kind == "position" else speed
    y = y + noise * np.random.default_rng(4).standard_normal(len(y))
    return replace(dataset(seed=1, samples=len(u), y=y), u=u, input_before=levels[0], kind=kind, quantum=None)


@pytest.mark.parametrize(
    ("kind", "noise"), [("position", 0.01), ("position", 0.05), ("speed", 2.0), ("speed", 5.0)]
)
def test_noise_of_a_shaft_at_rest_is_no_motion_under_a_second_level(kind: Kind, noise: float) -> None:
    assert single_level([noisy((0.0, 5.0), kind, noise)]) == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("kind", "noise"), [("position", 0.0), ("position", 0.01), ("speed", 0.0), ("speed", 5.0)]
)
@pytest.mark.parametrize("levels", [(0.0, 5.0, 0.0), (0.0, 5.0, 2.0), (5.0, 3.0), (0.0, 5.0, -5.0)])
def test_coasting_and_a_second_level_are_seen_through_noise(
    levels: tuple[float, ...], kind: Kind, noise: float
) -> None:
    assert single_level([noisy(levels, kind, noise)]) is None


@pytest.mark.parametrize(("wander", "level"), [(0.0, 5.0), (0.3, None)])
def test_noise_of_a_measured_input_makes_no_second_level_and_its_slow_change_does(
    wander: float, level: float | None
) -> None:
    """1 % of noise spreads over 5 % of the input; the means of fiftieths, of 30 samples each, over less than 1.5 %."""
    record = noisy((0.0, 5.0), "position", 0.0, each=1500)
    random = np.random.default_rng(5)
    u = record.u + (record.u > 0) * (0.05 * random.standard_normal(3000) + np.linspace(-wander, wander, 3000))

    found = single_level([replace(record, u=u)])

    assert found == (None if level is None else pytest.approx(level, rel=0.02))


def test_a_row_that_has_the_input_of_the_sample_before_is_no_motion_under_a_second_level() -> None:
    """A logger that writes its input after it has acted, and zero as soon as that is off, gave a gain twice too large."""
    u = np.tile(np.repeat([0.0, 90.0], 40), 3)
    speed, now = np.zeros(len(u)), 0.0
    for k, level in enumerate(u.tolist()):
        now = 30.5 + (now - 30.5) * np.exp(-0.025 / 0.027) if level else 0.0
        speed[k] = now
    y = speed + np.where(u > 0, 0.3 * np.random.default_rng(4).standard_normal(len(u)), 0.0)
    data = dataset(seed=1, samples=len(u), sample_time=0.025, u=u, y=y)
    record = replace(data, kind="speed", output_unit="rad/s", quantum=None, input_unit="%")

    result = identify(record)

    assert single_level([record]) == pytest.approx(90.0)
    assert result.answers["gain"].state is State.COMBINATION
    (at_level,) = (each for each in result.combinations if each.name == "speed_at_level")
    assert at_level.estimate.interval[0] < 30.5 < at_level.estimate.interval[1]


@pytest.mark.parametrize(
    ("u", "levels"),
    [
        (np.repeat([3.0, 1.2, -3.0], 50), [-3.0, 1.2, 3.0]),
        (np.repeat([0.0, 3.0, -0.6], 50), [-0.6, 3.0]),
        (np.repeat([3.0, -3.0], 50), None),  # one magnitude
        (np.repeat([3.0, -2.9], 50), None),  # as good as one
        (np.repeat([3.0, 1.2], 50), None),  # one way
        (np.repeat([3.0, 2.0, -1.0, -3.0], 50), None),  # more
        (0.5 + 2.0 * np.sin(0.1 * np.arange(200)), None),  # none
    ],
)
def test_few_levels_are_those_that_drive_to_and_fro(
    u: NDArray[np.float64], levels: list[float] | None
) -> None:
    found = few_levels([dataset(seed=1, samples=len(u), u=u)])

    assert found is None if levels is None else found is not None and found.tolist() == levels
