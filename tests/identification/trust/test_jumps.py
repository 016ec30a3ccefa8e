"""A position, or a speed, that goes on from somewhere else."""

import numpy as np
import pytest

from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.identification.trust.doubts.jumps import jumps, seams
from servobench.recordings.measurement.dataset import Dataset
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


def test_a_value_that_was_read_a_row_late_is_no_jump() -> None:
    """A sensor that is read each 20 ms into rows of 5 ms: one of its values stands a row later, and the next one in its own."""
    at, late = 20.0 * 0.02 * np.arange(200), np.zeros(200)
    late[[50, 120]] = 0.005
    way = at + 0.0004 * np.random.default_rng(1).standard_normal(200)

    assert not len(jumps(0.02 * np.arange(200) + late, way, 0.0))


@pytest.mark.parametrize("late", [0.012, 0.05])
def test_a_row_that_is_written_with_an_earlier_time_is_no_jump(late: float) -> None:
    """A row every 10 ms, or so, from a slow link: one has the time of the row before, and the next step is longer for that."""
    uneven = 0.001 * np.random.default_rng(2).standard_normal(400)
    taken = 0.01 * np.arange(400) + uneven
    written = taken.copy()
    taken[200:] += late  # after a pause of the link, whose first row says a time from before it
    written[201:] += late

    assert not len(jumps(written, np.floor(9.0 * taken / 0.0175) * 0.0175, 0.0175))
    assert jumps(taken, 9.0 * taken + np.where(taken > 2.0, 1.0, 0.0), 0.0).size


def test_a_step_that_is_lost_is_stated_by_its_size() -> None:
    """A shaft at 20 rad/s goes 40 mrad in a row, and goes on one row behind itself, as where an angle wraps carelessly."""
    y = 0.04 * np.arange(1000.0) - 0.04 * (np.arange(1000) > 400)
    (found,) = DOUBTS["jumps"].about_data([dataset(seed=1, samples=1000, y=y)])

    assert "first by −40\u00a0mrad" in found.sentence


def test_turns_that_are_lost_a_few_rows_apart_are_found() -> None:
    lost = 2 * np.pi * np.searchsorted([300, 305, 310], np.arange(1000))

    assert len(jumps(T, 20.0 * T - lost, QUANTUM)) == 3


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


STEP, TAU = 0.005, 0.15


def run(level: float, samples: int = 400) -> np.ndarray:
    """A speed from rest under a level [V], 10 rad/s each volt, every 5 ms."""
    return np.asarray(-10.0 * level * np.expm1(-STEP * np.arange(samples) / TAU))


def speeds(y: np.ndarray, u: np.ndarray) -> Dataset:
    noise = np.random.default_rng(1).normal(0.0, 0.05, len(y))
    return dataset(seed=1, samples=len(y), sample_time=STEP, u=u, y=y + noise, chain="derivative")


def seams_of(data: Dataset) -> list[int]:
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])
    return seams(fit.records[0]).tolist()


def test_runs_that_were_put_together_are_found_where_they_meet() -> None:
    levels = (5.0, -5.0, 3.0)
    pasted = speeds(np.concatenate([run(each) for each in levels]), np.repeat(levels, 400))

    assert seams_of(pasted) == [399, 799]
    assert "output-jumps" in {each.code for each in identify(pasted).findings}


@pytest.mark.parametrize("late", [0, 1])
def test_one_run_through_the_same_levels_has_none_even_where_a_step_is_a_row_late(late: int) -> None:
    u = np.repeat([0.0, 5.0, -5.0, 3.0], 400)
    y, decay = np.zeros(len(u)), np.exp(-STEP / TAU)
    for k in range(1, len(u)):
        y[k] = 10.0 * u[k - 1] + decay * (y[k - 1] - 10.0 * u[k - 1])

    assert seams_of(speeds(y, np.roll(u, late))) == []


def test_a_motor_that_is_faster_than_its_rows_jumps_with_its_input() -> None:
    u = np.repeat([0.0, 5.0, -5.0, 3.0], 400)

    assert seams_of(speeds(10.0 * np.roll(u, 1), u)) == []
