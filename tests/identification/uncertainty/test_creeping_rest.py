"""A rest in which no count changes says nothing of friction and offset, and two opposite steps tell two speeds only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Verdict
from servobench.identification.identify import identify
from servobench.identification.uncertainty.creeping_rest import SOURCE
from servobench.identification.uncertainty.identifiability import State
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset, prbs
from tests.rig.motor.reference import Truth, march

# Friction of 0.1 V, and a time constant of 0.28 s.
TRUTH = Truth(coulomb_torque=5e-4, inertia=6e-5)
SPEED_AT = {
    level: (abs(level) - TRUTH.coulomb_torque * TRUTH.resistance / TRUTH.motor_constant) * np.sign(level)
    for level in (3.0, -7.0)
}


def step(level: float, seed: int, samples: int = 800) -> Dataset:
    """A step from rest to one level [V] after 0.3 s, where the shaft stands near the edge of a count."""
    u = np.where(np.arange(samples) < 150, 0.0, level)
    start = 0.05 * QUANTUM * np.random.default_rng(seed).random()
    counts = np.floor(march(TRUTH, u, 0.002, angle=start)[:, 2] / QUANTUM)
    return dataset(seed=seed, u=u, samples=samples, y=counts * QUANTUM)


@pytest.mark.parametrize("seed", range(6))
def test_two_opposite_steps_tell_no_gain(seed: int) -> None:
    result = identify([step(3.0, seed), step(-7.0, seed + 100)])

    assert result.verdict is Verdict.TRUSTED
    assert result.answers["gain"].state is State.COMBINATION
    assert result.answers["coulomb_voltage"].state is not State.KNOWN
    assert result.answers["time_constant"].state is State.KNOWN
    (speed,) = [each for each in result.combinations if each.name == "speed_at_level"]
    gain = TRUTH.motor_constant / (TRUTH.resistance * TRUTH.viscous_friction + TRUTH.motor_constant**2)
    assert speed.input_level is not None
    low, high = speed.estimate.interval
    assert low < gain * SPEED_AT[round(speed.input_level, 3)] < high


def test_the_line_is_in_the_budget_where_the_model_creeps_and_nowhere_else() -> None:
    lines = []
    for seed in range(6):
        fit = identify([step(3.0, seed), step(-7.0, seed + 100)]).fit
        assert fit is not None
        creeps = abs(fit.model["offset_voltage"]) > fit.model["coulomb_voltage"]
        lines.append(creeps)
        assert creeps == any(line.source == SOURCE for line in fit.budget)
    assert any(lines)


def lines_of(records: list[Dataset], structure: str = "auto") -> list[str]:
    fit = identify(records, structure).fit
    assert fit is not None
    return [line.source for line in fit.budget]


def test_a_third_step_for_which_gravity_is_taken_tells_no_gain_either() -> None:
    for seed in (1, 4, 7):
        result = identify([step(3.0, seed), step(-7.0, seed + 100), step(3.0, seed + 200)])

        assert result.answers["gain"].state is State.COMBINATION


def _flickering(data: Dataset) -> Dataset:
    y = data.y.copy()
    y[70] += QUANTUM
    return replace(data, y=y)


def _measured(data: Dataset) -> Dataset:
    """The input is a measured voltage, whose last digit of 1 mV isn't always the same."""
    digits = 1e-3 * np.random.default_rng(1).integers(0, 2, len(data.u))
    return replace(data, u=np.where(data.u == 0.0, digits, data.u))


def _without_word_of_counts(data: Dataset) -> Dataset:
    return replace(data, quantum=None)


@pytest.mark.parametrize("change", [_flickering, _measured, _without_word_of_counts])
def test_a_rest_is_one_all_the_same(change: Callable[[Dataset], Dataset]) -> None:
    for seed in range(3):
        result = identify([change(step(3.0, seed)), change(step(-7.0, seed + 100))])

        assert result.answers["gain"].state is State.COMBINATION


@pytest.mark.parametrize(("sample_time", "delay"), [(0.00025, 0), (0.002, 0), (0.002, 10)])
def test_rows_before_the_input_acts_are_no_rest_to_stand_in(sample_time: float, delay: int) -> None:
    """Bits that begin at once: the count stays for a few rows because the shaft hasn't got anywhere yet."""
    u = prbs(3000, 6, np.random.default_rng(5))
    data = dataset(seed=1, samples=3000, sample_time=sample_time, u=np.roll(u, delay), truth=TRUTH)
    late = replace(data, u=u)

    assert SOURCE not in lines_of([late], "first_order_coulomb")


def test_a_coarse_encoder_under_a_first_level_is_no_rest() -> None:
    levels = np.concatenate([np.full(8, 1.0), np.repeat([0.5, -0.9, 0.8, -0.6, 0.9, -0.5], 300)])
    fine = dataset(seed=1, samples=len(levels), u=levels, truth=TRUTH)
    coarse = 16 * QUANTUM
    data = replace(fine, y=(np.floor(fine.y / coarse) + 0.5) * coarse, quantum=coarse)

    result = identify(data)

    assert result.answers["gain"].state is State.KNOWN
    assert result.fit is not None
    assert SOURCE not in [line.source for line in result.fit.budget]


def test_a_coast_after_a_step_tells_them_all() -> None:
    u = np.concatenate([np.zeros(150), np.full(900, 3.0), np.zeros(400), np.full(900, -7.0)])

    result = identify(dataset(seed=1, u=u, samples=len(u), truth=TRUTH))

    assert result.answers["gain"].state is State.KNOWN
    assert result.fit is not None
    assert not any(line.source == SOURCE for line in result.fit.budget)


def test_a_sensor_without_counts_has_no_such_rest() -> None:
    records = [step(3.0, 1), step(-7.0, 101)]
    random = np.random.default_rng(1)
    noisy = [
        replace(each, y=each.y + random.normal(0.0, 2e-3, len(each.y)), quantum=None) for each in records
    ]

    fit = identify(noisy).fit

    assert fit is not None
    assert not any(line.source == SOURCE for line in fit.budget)
