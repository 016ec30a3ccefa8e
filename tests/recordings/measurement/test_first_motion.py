"""When an output first responds: the delay is no longer than that, so what only flickers has not moved."""

from dataclasses import replace

import numpy as np
import pytest

from servobench.recordings.measurement.first_motion import first_motion
from servobench.recordings.measurement.unknown_input import without_unknown_input
from tests.datasets import QUANTUM, dataset

T = 0.002 * np.arange(1000)
U = np.where(T < 0.5, 0.0, 3.0)


@pytest.mark.parametrize(("counts", "moves"), [(5, False), (200, True)])
def test_a_shaft_that_creeps_by_a_few_counts_has_not_begun_to_move(counts: int, moves: bool) -> None:
    y = QUANTUM * np.floor(counts * np.clip(T - 0.6, 0.0, 0.1) / 0.1)

    found = first_motion(dataset(seed=1, samples=len(T), u=U, y=y))

    assert (found is not None) == moves
    if found is not None:
        assert found.cause == pytest.approx(0.5)
        # Three counts are clear of the rounding; at 200 counts in 0.1 s that is within two samples of the begin.
        assert 0.6 <= found.effect <= 0.6 + 3 * 0.002


def test_an_input_that_is_on_from_the_first_row_of_a_shaft_at_rest_is_a_change() -> None:
    """A slow sensor that sees the motion at its second sample: no delay of seconds, whatever fits best."""
    u = np.full(len(T), 3.0)
    y = QUANTUM * np.floor(2000 * np.clip(T - 0.05, 0.0, None))
    record = replace(dataset(seed=1, samples=len(T), u=u, y=y), input_before=0.0)

    stated = first_motion(replace(record, starts_at_rest=True))

    assert stated is not None
    assert stated.cause == 0.0
    # Four counts at 2000 counts/s.
    assert 0.05 <= stated.effect <= 0.05 + 4 * 0.002
    assert first_motion(replace(record, starts_at_rest=False)) is None
    assert first_motion(replace(record, starts_at_rest=True, input_before=3.0)) is None


@pytest.mark.parametrize("rows", [1, 3])
def test_a_shaft_that_goes_on_standing_after_the_input_has_come_stood_all_the_while(rows: int) -> None:
    """A current's own controller begins with the record, and the heavy wheel reaches its first count 0.2 s later."""
    u = np.where(np.arange(len(T)) < rows, 0.0, 3.0 + 0.01 * np.sin(37.0 * T))
    y = QUANTUM * np.floor(0.5 * 100.0 * T**2)  # counts: the first after 0.14 s

    found = first_motion(dataset(seed=1, samples=len(T), u=u, y=y))

    assert found is not None
    assert found.cause == pytest.approx(rows * 0.002)
    # Two counts, and one more for the speed of a count in 0.14 s that could go unseen: 0.5 · 100 t² = 3 + t/0.14 at 0.33 s.
    assert 0.2 < found.effect < 0.34


def test_a_shaft_that_runs_as_the_record_begins_has_no_first_motion() -> None:
    u = np.where(np.arange(len(T)) < 1, 0.0, 3.0)

    assert first_motion(dataset(seed=1, samples=len(T), u=u, y=QUANTUM * np.floor(1600.0 * T))) is None


@pytest.mark.parametrize(("every", "late"), [(1, 0.004), (5, 0.01)])
def test_one_speed_of_nothing_shows_a_rest(every: int, late: float) -> None:
    """A step in the second row; of every fifth row the step's own has moved already."""
    u = np.where(T < 0.002, 0.0, 3.0)
    speed = 70.0 * (1.0 - np.exp(-np.clip(T - 0.002, 0.0, None) / 0.1))
    whole = replace(
        dataset(seed=1, samples=len(T), u=u, y=speed), kind="speed", output_unit="rad/s", quantum=None
    )
    record = replace(
        whole, t_input=T[::every], u=u[::every], t_output=T[::every], y=speed[::every], rows=None
    )

    found = first_motion(record)

    assert found is not None
    assert found.effect - found.cause <= late
    assert len(without_unknown_input(record).y) == len(record.y)
