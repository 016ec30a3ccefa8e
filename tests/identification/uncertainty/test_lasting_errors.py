"""Errors that last: the scatter between runs, a reading that stays, and an input that changed between two rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.identify import identify, identify_evidence
from servobench.identification.models.base import STRUCTURES
from servobench.identification.result import Result
from servobench.identification.uncertainty.changes_between_rows import with_changes_between_rows
from servobench.identification.uncertainty.rounding_that_stays import with_rounding_that_stays
from servobench.identification.uncertainty.scatter_between_runs import with_scatter_between_runs
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

GAIN, TAU, FRICTION = 0.164, 0.06, 2.2  # rad/(s·%), s, %


def speed(u: NDArray[np.float64], step: float, tau: float = TAU) -> NDArray[np.float64]:
    """The speed [rad/s] of a motor from rest under an input (N,) [%] of one sign that holds from row to row."""
    y, decay = np.zeros(len(u)), np.exp(-step / tau)
    for k in range(1, len(u)):
        end = GAIN * (u[k - 1] - FRICTION)
        y[k] = end + decay * (y[k - 1] - end)
    return y


def run(level: float, error: float = 0.0, noise: float = 0.02) -> Dataset:
    """A run from rest at one level [%], whose speed is off by a part of it."""
    u = np.full(400, level)
    y = (1.0 + error) * speed(u, 0.005)
    random = np.random.default_rng(round(level))
    made = dataset(
        seed=1, samples=400, sample_time=0.005, u=u, y=y + random.normal(0.0, noise, 400), chain="derivative"
    )
    return replace(made, input_unit="%", starts_at_rest=True, input_before=0.0, name=f"{level:g} %")


def sources(result: Result) -> set[str]:
    return {line.source for line in result.budget}


@pytest.mark.parametrize(("levels", "most"), [((95.0, 100.0), 0.3), ((20.0, 100.0), 0.03)])
def test_a_gain_between_neighbouring_levels_allows_for_what_runs_differ_by(
    levels: Sequence[float], most: float
) -> None:
    """Speeds that are off by half a percent make a tenth of the gain between 95 and 100 %, and next to nothing from 20 % on."""
    held = 0
    for seed in range(10):
        errors = 0.005 * np.random.default_rng(seed).standard_normal(2)
        result = identify_evidence([run(level, float(e)) for level, e in zip(levels, errors, strict=True)])
        low, high = result["gain"].interval
        held += low < GAIN < high

    assert held >= 8  # of ten with 95 % each, seven or fewer come once in a hundred times
    assert "scatter between runs" in sources(result)
    assert result["gain"].half_width < most * GAIN


def test_runs_of_one_level_keep_friction_that_their_differences_can_not_exclude() -> None:
    """A battery that sags by 3 % under the highest level hides a friction of 2.2 %, which one record would show."""
    runs = [run(level, error) for level, error in ((40.0, 0.0), (80.0, 0.0), (100.0, -0.03))]
    back = [replace(each, u=-each.u, y=-each.y) for each in runs[1:]]

    result = identify_evidence([runs[0], *back])

    assert "coulomb_voltage" in result.answers
    low, high = result["gain"].interval
    assert low < GAIN < high


def fit_of(*records: Dataset) -> Fit:
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], list(records))


def test_the_scatter_is_that_of_two_speeds() -> None:
    """K = (ω₂ - ω₁)/(u₂ - u₁), so its standard deviation is that of two speeds, each 0.4 % of its own, over the difference."""
    fit = fit_of(run(40.0), run(80.0))

    widened = with_scatter_between_runs(fit)

    own = widened["gain"].sd ** 2 - fit["gain"].sd ** 2
    speeds = GAIN * (np.array([40.0, 80.0]) - FRICTION)
    # Each run's first 0.2 s in 2 s rise: what is a part of the motion is a little less there, and the fit weighs it.
    assert np.sqrt(own) == pytest.approx(0.004 * np.hypot(*speeds) / 40.0, rel=0.05)


def test_records_with_several_levels_show_their_scatter_themselves() -> None:
    u = np.repeat([20.0, 60.0, 40.0, 80.0], 100)
    made = dataset(seed=1, samples=400, sample_time=0.005, u=u, y=speed(u, 0.005), chain="derivative")
    fit = fit_of(made, replace(made, name="again"))

    assert with_scatter_between_runs(fit) is fit


def test_a_speed_that_reads_one_value_is_known_to_half_a_step() -> None:
    """9.34 rad/s in whole rad/s is 9 all the time."""
    made = run(59.15)
    rounded = replace(made, y=np.round(speed(made.u, 0.005)))
    assert speed(made.u, 0.005)[-1] == pytest.approx(9.34, abs=0.01)

    result = identify(
        rounded, estimator="output_error"
    )  # as a speed, and not summed to the counts of an encoder

    (known,) = (each for each in result.combinations if each.name == "speed_at_level")
    low, high = known.estimate.interval
    assert low < 9.34 < high
    assert high - low > 0.9  # of a step of 1 rad/s, nine tenths lie within what is stated


def test_steps_that_are_cut_off_towards_zero_look_like_friction() -> None:
    """What a division of whole numbers leaves of speeds up to 16 rad/s in steps of 1 rad/s: half a step, 3 % of the input."""
    u = np.repeat([20.0, 90.0, 40.0, 60.0, -30.0, -80.0, -50.0, 70.0], 200)
    exact, decay = np.zeros(len(u)), np.exp(-0.005 / TAU)
    for k in range(1, len(u)):
        end = GAIN * (u[k - 1] - FRICTION * np.sign(u[k - 1]))
        exact[k] = end + decay * (exact[k - 1] - end)
    noisy = exact + np.random.default_rng(1).normal(0.0, 0.7, len(u))
    made = dataset(seed=1, samples=len(u), sample_time=0.005, u=u, y=np.trunc(noisy), chain="derivative")

    result = identify(replace(made, input_unit="%"), estimator="output_error")

    low, high = result["coulomb_voltage"].interval
    assert low < FRICTION < high
    assert "rounding that stays" in sources(result)


def test_rounding_that_is_fine_beside_what_is_known_adds_nothing() -> None:
    fit = fit_of(replace(run(59.15), y=np.round(1e4 * run(59.15, noise=0.2).y) / 1e4))

    assert with_rounding_that_stays(fit) is fit


def logged(late: NDArray[np.float64], rows: int) -> Dataset:
    """A staircase of which every 100th of 5 ms is logged, and whose changes come so many rows of 5 ms (5,) after the log's."""
    levels = np.array([10.0, 20.0, 30.0, 40.0, 50.0, 60.0])
    at = (np.arange(1, 6) * rows * 100 + late).astype(int)
    u = levels[np.searchsorted(at, np.arange(6 * rows * 100), side="right")]
    way = np.cumsum(speed(u, 0.005)) * 0.005
    way = np.round(way / 0.05) * 0.05
    made = dataset(seed=1, samples=6 * rows, sample_time=0.5, u=u[::100], y=way[::100])
    return replace(made, input_unit="%", quantum=0.05, starts_at_rest=True, input_before=0.0)


def test_changes_that_fall_between_slow_rows_are_allowed_for() -> None:
    """Levels that change anywhere within half a second shift the position by what the motor turns until then."""
    held = 0
    for seed in range(10):
        late = np.random.default_rng(seed).integers(-99, 1, 5).astype(np.float64)
        result = identify(logged(late, 12))
        low, high = result["gain"].interval
        held += low < GAIN < high
        # What shifts the position looks like a random torque, too; where it isn't taken for one it has a line of its own.
        assert result.fit is not None
        assert result.fit.disturbance is not None or "changes between rows" in sources(result)

    assert held >= 8  # of ten with 95 % each, seven or fewer come once in a hundred times


def test_a_motor_that_is_slower_than_its_rows_shows_when_its_input_changes() -> None:
    data = dataset(seed=1, kind="prbs", samples=1000)
    fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])

    assert with_changes_between_rows(fit) is fit
