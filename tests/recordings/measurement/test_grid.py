"""The step of the grid that values lie on: found where it is there, and only there."""

import numpy as np
import pytest

from servobench.recordings.measurement.grid import grid_step, last_decimal, steps_behind_decimals

t = 0.002 * np.arange(3000)
MOVING = 40.0 * t - 4.0 * (1.0 - np.exp(-t / 0.1)) + np.sin(3.0 * t)


@pytest.mark.parametrize("step", [2 * np.pi / 2048, 2 * np.pi / 500, 1.0, 1e-3])
@pytest.mark.parametrize("offset", [0.0, 0.3217, -1e3])
def test_the_step_of_rounded_values_is_found_wherever_the_grid_lies(step: float, offset: float) -> None:
    assert grid_step(offset + step * np.floor(MOVING / step)) == pytest.approx(step, rel=1e-3)


def test_the_step_is_found_in_a_short_slow_motion() -> None:
    assert grid_step(0.01 * np.floor(np.linspace(0.0, 9.5, 400))) == pytest.approx(0.01)


def test_the_step_is_found_although_no_two_neighbours_on_the_grid_occur() -> None:
    even_and_thirds = np.array([0, 2, 4, 7, 9, 12, 14, 16, 18, 21, 24, 26.0])

    assert grid_step(0.1 * np.repeat(even_and_thirds, 3)) == pytest.approx(0.1)


def test_a_step_below_a_millionth_of_the_range_does_not_count() -> None:
    assert grid_step(1e-5 * np.floor(MOVING / 1e-5)) is None


@pytest.mark.parametrize(
    "values",
    [MOVING, MOVING.astype(np.float32).astype(float), np.sin(9 * t), 5.0 * t, np.zeros(100), np.ones(0)],
)
def test_no_step_is_found_in_values_on_no_grid(values: np.ndarray) -> None:
    assert grid_step(values) is None


def test_no_step_is_found_in_a_handful_of_values() -> None:
    assert grid_step(np.array([0.0, 1.0, 2.0, 3.0, 4.0])) is None


def test_noise_on_a_grid_hides_it() -> None:
    rng = np.random.default_rng(6)

    assert grid_step(np.floor(MOVING / 0.01) * 0.01 + rng.normal(scale=0.003, size=len(t))) is None


def test_random_values_are_never_taken_for_a_grid() -> None:
    found = [grid_step(np.random.default_rng(seed).normal(size=30)) for seed in range(300)]

    assert found == [None] * 300


def test_the_step_is_found_where_most_values_occur_once_and_no_two_are_further_apart() -> None:
    """A wheel that sets off behind a coarse encoder, printed with four digits: each count is passed, at first slowly."""
    t = 0.00625 * np.arange(250)
    angle = 8.0 * (t + 0.23 * np.expm1(-t / 0.23))
    y = np.round(0.0548 * np.floor(angle / 0.0548), 4)

    assert np.unique(np.diff(np.unique(y))).max() < 1.5 * 0.0548  # no two are further apart
    assert len(np.unique(y)) > 0.5 * len(y)  # most occur once
    assert grid_step(y) == pytest.approx(0.0548, rel=1e-3)


@pytest.mark.parametrize("held", [2, 3, 2.5])
def test_a_steady_ramp_that_is_held_over_some_rows_is_no_grid(held: float) -> None:
    assert grid_step(np.floor(np.arange(40) / held)[: int(2 * held) + 4] * 0.1) is None


@pytest.mark.parametrize("bits", [10, 12])
@pytest.mark.parametrize("decimals", [2, 3])
def test_the_steps_of_a_sensor_show_behind_rounded_degrees(bits: int, decimals: int) -> None:
    counts = np.cumsum(np.random.default_rng(bits).integers(0, 9, 200))
    printed = np.deg2rad(np.round(counts * 360.0 / 2**bits, decimals))

    assert steps_behind_decimals(printed, np.deg2rad(10.0**-decimals)) == 2**bits


def test_the_last_decimal_is_that_of_the_print() -> None:
    values = np.random.default_rng(1).uniform(-400.0, 400.0, 200)

    for decimals in range(7):
        assert last_decimal(np.deg2rad(np.round(values, decimals)) / np.deg2rad(1.0)) == 10.0**-decimals
    assert last_decimal(values) is None


def test_degrees_of_no_such_sensor_have_none() -> None:
    degrees = np.round(np.random.default_rng(1).uniform(-400.0, 400.0, 200), 2)
    step = np.deg2rad(0.01)

    assert steps_behind_decimals(np.deg2rad(degrees), step) is None  # an angle without steps
    assert steps_behind_decimals(np.deg2rad(np.arange(200) * 0.36), step) is None  # 1,000 steps in a turn
    assert steps_behind_decimals(np.deg2rad(np.arange(20) * 360.0 / 4096), step) is None  # too few to tell
    assert steps_behind_decimals(np.deg2rad(np.arange(200) * 360.0 / 2**14), step) is None  # too fine to tell


def test_a_coarser_sensor_is_not_taken_for_a_finer_one_whose_steps_it_shares() -> None:
    """A potentiometer with 450° over 128 steps: each is five of the 512 in a turn."""
    degrees = np.round(np.arange(-26, 27) * 450.0 / 128, 2)

    assert steps_behind_decimals(np.deg2rad(degrees), np.deg2rad(0.01)) is None
