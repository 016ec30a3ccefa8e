"""An input that was logged up to the end of a range, while the motor got more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.trust.doubts.base import about_data
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset
from tests.rig.motor.reference import Truth

T = 0.002 * np.arange(3000)
SINE = 3.0 * np.sin(2 * np.pi * T)


def cut_off(end: float, chain: str = "", u: NDArray[np.float64] = SINE) -> Dataset:
    """The reference motor driven by a voltage (N,), of which the file has what lies within an end [V], or below it alone."""
    made = dataset(seed=1, samples=len(u), u=u, chain=chain)
    return replace(made, u=np.clip(u, -abs(end), end))


def codes(data: Dataset) -> list[str]:
    return [each.code for each in about_data([data]) if each.code == "input-cut-off"]


@pytest.mark.parametrize("end", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("chain", ["", "derivative"])
def test_a_speed_that_turns_round_under_a_constant_input_is_found(end: float, chain: str) -> None:
    assert codes(cut_off(end, chain))


def test_a_range_that_ends_on_one_side_is_enough() -> None:
    one_side = replace(cut_off(3.0), u=np.maximum(SINE, -2.0))

    assert codes(one_side)


@pytest.mark.parametrize("chain", ["", "derivative"])
def test_stairs_that_go_on_under_the_last_level_of_the_file_are_found(chain: str) -> None:
    """1 to 5 V, of which the file has what lies below 3.2 V; a motor settles once under one voltage."""
    stairs = np.repeat([0.5, 1.0, 2.0, 3.0, 4.0, 5.0], 500)

    assert codes(cut_off(3.2, chain, stairs))
    assert not codes(dataset(seed=1, samples=len(T), u=np.minimum(stairs, 3.2), chain=chain))


def test_an_amplifier_that_limits_what_is_logged_is_no_fault() -> None:
    """The motor gets what stands in the file: its speed goes on towards one end."""
    limited = np.clip(SINE, -2.0, 2.0)

    assert not codes(dataset(seed=1, samples=len(T), u=limited))
    assert not codes(dataset(seed=1, samples=len(T), u=limited, chain="derivative"))


@pytest.mark.parametrize("u", [SINE, np.where(T % 1.0 < 0.5, 2.0, -2.0), np.full(len(T), 2.0)])
def test_neither_a_sine_nor_levels_are_cut_off(u: NDArray[np.float64]) -> None:
    assert not codes(dataset(seed=1, samples=len(T), u=u, torque_noise=2e-5))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
def test_noise_on_a_level_is_no_speed_that_turns_round(share: float, seed: int) -> None:
    """Stairs up and down to one upper level, read by a tachometer whose noise is that share of the largest speed."""
    stairs = np.tile(np.repeat([0.0, 0.7, 1.4, 2.0, 1.4, 0.7], 100), 5)
    made = dataset(seed=1, samples=len(T), u=stairs, chain="derivative")
    noise = np.random.default_rng(seed).normal(size=len(made.y))

    assert not codes(replace(made, y=made.y + share * made.y.max() * noise))


def test_an_input_that_was_logged_a_row_late_is_not_cut_off() -> None:
    """Under its last rows the motor has the next input already, and its speed falls at once after it had settled."""
    levels = np.tile(np.repeat([2.0, 3.0, 4.0, 5.0, 0.0], 36), 5)
    truth = Truth(inertia=Truth().inertia / 10)  # 10 ms, 5 samples
    made = dataset(seed=1, samples=len(levels), u=levels, truth=truth)
    late = np.concatenate([levels[:1], levels[:-1]])

    assert not codes(replace(made, u=late))
