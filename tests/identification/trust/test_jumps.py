"""A position that goes on from somewhere else."""

import numpy as np
import pytest

from servobench.identification.trust.doubts.jumps import jumps
from tests.datasets import QUANTUM, dataset

T = np.arange(1000) * 0.002


def turning(**steps: float) -> np.ndarray:
    """A shaft at 20 rad/s behind an encoder, which slips by `at_N` [rad] after sample N."""
    y = 20.0 * T
    for name, size in steps.items():
        y = y + np.where(np.arange(len(T)) > int(name.removeprefix("at_")), size, 0.0)
    return np.asarray(np.floor(y / QUANTUM) * QUANTUM)


@pytest.mark.parametrize("size", [0.05, -0.05, 2 * np.pi, -2 * np.pi, 400.0])
def test_a_slip_is_found_where_it_is(size: float) -> None:
    assert jumps(T, turning(at_400=size), QUANTUM).tolist() == [400]


def test_several_are_found() -> None:
    assert jumps(T, turning(at_200=1.0, at_400=-1.0, at_900=3.0), QUANTUM).tolist() == [200, 400, 900]


def test_a_lost_count_or_two_are_no_jump() -> None:
    assert not len(jumps(T, turning(at_400=2 * QUANTUM), QUANTUM))


def test_a_single_value_that_is_off_is_a_spike_and_no_jump() -> None:
    y = turning()
    y[400] += 1.0

    assert not len(jumps(T, y, QUANTUM))


def test_a_time_that_is_missing_is_no_jump() -> None:
    keep = np.r_[0:400, 450:1000]

    assert not len(jumps(T[keep], turning()[keep], QUANTUM))


def test_a_start_from_rest_is_no_jump() -> None:
    assert not len(jumps(T, np.maximum(turning() - 8.0, 0.0), QUANTUM))


def test_a_value_that_is_shown_twice_is_no_jump() -> None:
    y = turning()
    y[400] = y[399]

    assert not len(jumps(T, y, QUANTUM))


def twitching(size: float) -> np.ndarray:
    """Counts of a shaft that rests, steps once by so many, rests again, and then turns at 60 a sample."""
    return np.r_[np.zeros(400), np.full(300, size), size + 60.0 * np.arange(300)]


def test_a_shaft_that_friction_lets_go_for_a_moment_steps_and_does_not_jump() -> None:
    assert not len(jumps(T, twitching(50.0), 1.0))


def test_a_shaft_that_rests_can_not_step_by_more_than_it_turns_in_a_sample() -> None:
    assert jumps(T, twitching(500.0), 1.0).tolist() == [399]


@pytest.mark.parametrize("seed", range(20))
def test_a_sound_record_has_none(seed: int) -> None:
    data = dataset(seed=seed, kind="prbs", samples=2000)

    assert not len(jumps(data.t_output, data.y, QUANTUM))
