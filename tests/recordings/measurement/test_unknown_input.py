"""A record whose input is on from its first row, with a shaft that stands for some rows still: what is left out of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.finding import Verdict
from servobench.identification.identify import identify_evidence
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.unknown_input import rows_standing, without_unknown_input
from tests.datasets import dataset

GAIN, TAU, DELAY = 500.0, 0.105, 0.057


def from_rest(level: float, step: float, samples: int, delay: float = DELAY, kind: str = "speed") -> Dataset:
    """A motor [counts/s] from rest under a voltage that is on from the first row and acts a delay later."""
    t = step * np.arange(samples)
    since = np.maximum(t - delay, 0.0)
    speed = GAIN * level * -np.expm1(-since / TAU)
    y = speed if kind == "speed" else GAIN * level * since - TAU * speed
    made = dataset(seed=1, samples=samples, sample_time=step, u=np.full(samples, level), y=y)
    unit = "counts/s" if kind == "speed" else "counts"
    return replace(made, kind=kind, output_unit=unit, quantum=None, input_before=level, name=f"{level:g} V")


@pytest.mark.parametrize("step", [0.01, 0.025, 0.05, 0.1])
@pytest.mark.parametrize("kind", ["speed", "position"])
def test_a_shaft_that_sets_off_late_is_no_slower_for_that(step: float, kind: str) -> None:
    made = [from_rest(level, step, 40, kind=kind) for level in (3.0, 6.0, 9.0)]
    read = [
        replace(
            each,
            y=each.y + np.random.default_rng(n).normal(0.0, 3.0, 40) if kind == "speed" else np.round(each.y),
        )
        for n, each in enumerate(made)
    ]

    result = identify_evidence([without_unknown_input(each) for each in read])

    low, high = result["time_constant"].interval
    assert low < TAU < high
    assert result.verdict is Verdict.TRUSTED


def test_it_is_said_that_rows_are_left_out() -> None:
    result = identify_evidence([without_unknown_input(from_rest(level, 0.05, 40)) for level in (3.0, 6.0)])

    (hint,) = (each.sentence for each in result.findings if each.code == "rest-to-state")
    assert "the rows in which the shaft still stands are left out" in hint


@pytest.mark.parametrize("kind", ["speed", "position"])
def test_rows_before_a_rise_are_counted_and_a_rise_from_the_first_row_has_none(kind: str) -> None:
    late, at_once = (from_rest(6.0, 0.004, 200, delay, kind) for delay in (DELAY, 0.0))

    # The first 15 rows lie within the delay; the next one comes 3 ms later, in which a position hardly changes.
    assert rows_standing(late) in ((15,) if kind == "speed" else (15, 16))
    assert rows_standing(at_once) == 0
    assert without_unknown_input(at_once) is at_once


@pytest.mark.parametrize(
    "u",
    [
        pytest.param(np.repeat([1.0, 4.0], 20), id="a level that friction holds"),
        pytest.param(np.repeat([0.0, 4.0], 20), id="no input at first"),
    ],
)
def test_a_rest_that_a_later_input_ends_says_something_of_friction_or_of_the_delay(
    u: NDArray[np.float64],
) -> None:
    late = from_rest(4.0, 0.05, 40, delay=0.05 * 20)

    assert rows_standing(replace(late, u=u, input_before=float(u[0]))) == 0


@pytest.mark.parametrize("y", [np.zeros(40), np.full(40, 7.0)])
def test_what_never_moves_or_never_stands_stays_as_it_is(y: Sequence[float]) -> None:
    still = replace(from_rest(4.0, 0.05, 40), y=np.asarray(y))

    assert without_unknown_input(still) is still


def test_readings_of_nothing_before_a_sensor_begins_are_left_out_of_a_motion() -> None:
    """A chirp from the middle, whose speed reads zero for five rows and is at once what it was all the time."""
    t = 0.005 * np.arange(600)
    u = 8.0 * np.sin(2.0 * np.pi * (0.3 + 0.05 * t) * t + 1.0)
    made = dataset(seed=1, samples=600, sample_time=0.005, u=u, y=20.0 * u, chain="derivative")
    late = replace(made, y=np.where(np.arange(600) < 5, 0.0, made.y), input_before=float(u[0]))

    assert len(without_unknown_input(late).y) == len(made.y) - 5
    assert len(without_unknown_input(replace(late, y=made.y)).y) == len(made.y) - 4  # what a delay may hide


def test_a_step_from_rest_to_a_speed_that_is_there_at_once_is_a_fast_motor() -> None:
    u = np.repeat([1.0, 1.0, 6.0], [3, 2, 195])
    made = dataset(
        seed=1, samples=200, sample_time=0.05, u=u, y=np.where(u > 2.0, 100.0, 0.0), chain="derivative"
    )
    fast = replace(made, input_before=1.0)

    assert len(without_unknown_input(fast).y) == len(fast.y) - 4  # what a delay may hide, and no row more
