"""Causes of a bad fit are told only where they are there: behind a measurement chain, and in records longer than the grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.explanations.base import explain, is_damaged
from servobench.measurement.dataset import Dataset
from tests.datasets import dataset


@pytest.mark.parametrize(
    "chain",
    ["tachometer 10 ms", "tachometer 50 ms", "derivative | average 50 ms", "derivative | lowpass 30 rad/s"],
)
def test_a_sound_record_behind_its_chain_is_explained_by_nothing(chain: str) -> None:
    """The twin motor is of first order: no second pole, no other motor's column."""
    record = dataset(seed=3, kind="prbs", hold=20, samples=5100, chain=chain)

    assert [finding.code for finding in explain([record])] == []


def test_another_motors_input_is_told_behind_a_chain_too() -> None:
    record = dataset(seed=3, kind="prbs", hold=20, chain="tachometer 20 ms")
    other = dataset(seed=4, kind="prbs", hold=20, chain="tachometer 20 ms")

    assert [finding.code for finding in explain([replace(record, u=other.u)])] == ["input-unrelated"]


def test_an_input_whose_simulation_explains_the_output_is_not_unrelated() -> None:
    """What the equation says is a hint; that the simulation of a fit explains most of the output is none."""
    record = dataset(seed=3, kind="prbs", hold=20)
    other = dataset(seed=4, kind="prbs", hold=20)

    assert explain([replace(record, u=other.u)], 91.0) == []
    assert is_damaged([replace(record, u=other.u)])
    assert not is_damaged([replace(record, u=other.u)], 91.0)


def test_a_record_so_long_that_the_grid_misses_its_input_is_explained_by_nothing() -> None:
    """Levels of 40 ms over 1500 s, on a grid of 6000 points 250 ms apart: what acts between them isn't seen."""
    levels = np.random.default_rng(0).uniform(-3, 3, 37_500)
    record = _ideal(np.repeat(levels, 10), 0.004)

    assert explain([record]) == []


def _ideal(u: np.ndarray, step: float) -> Dataset:
    """A motor without friction, K 23.7 rad/(s V), τ 0.1 s, exact at the samples: θ = K ∫u - τ ω."""
    from scipy.signal import lfilter

    decay = np.exp(-step / 0.1)
    speed = lfilter([0.0, 23.7 * (1 - decay)], [1.0, -decay], u)
    angle = 23.7 * step * np.concatenate([[0.0], np.cumsum(u[:-1])]) - 0.1 * speed
    like = dataset(seed=0, samples=2, y=np.zeros(2))
    t = np.arange(len(u)) * step
    return replace(like, t_input=t, u=u, t_output=t, y=np.round(angle, 6), quantum=None)
