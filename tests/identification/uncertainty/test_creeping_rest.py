"""A rest in which no count changes says nothing of friction and offset, and two opposite steps tell two speeds only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Verdict
from servobench.identification.identify import identify
from servobench.identification.uncertainty.creeping_rest import SOURCE
from servobench.identification.uncertainty.identifiability import State
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset
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
