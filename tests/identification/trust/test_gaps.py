"""Gaps in which the input may have changed, rows that were read late, and inputs that are logged at several rates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.channels import Array
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset


def codes(data: Dataset) -> set[str]:
    return {finding.code for finding in DOUBTS["gaps"].about_data([data])}


def at(rows: Array, times: Array) -> Dataset:
    """Those rows of a PRBS's record, at these times [s]."""
    whole = dataset(seed=3, kind="prbs", hold=20)
    return replace(whole, t_input=times, t_output=times, u=whole.u[rows], y=whole.y[rows])


def test_rows_that_were_lost_are_a_gap() -> None:
    rows = np.delete(np.arange(2000), np.concatenate([np.arange(k, k + 100) for k in (300, 900, 1500)]))

    assert "gap-input-unknown" in codes(at(rows, 0.002 * rows))


@pytest.mark.parametrize("rows_at_once", [30, 100])
def test_rows_that_were_read_many_at_once_are_no_gap(rows_at_once: int) -> None:
    """Read at half of the sample time, and then waited for."""
    rows = np.arange(2000)
    times = 0.002 * rows - 0.001 * (rows % rows_at_once)

    assert "times-of-reading" in codes(at(rows, times))
    assert "gap-input-unknown" not in codes(at(rows, times))


def test_an_input_that_is_logged_at_several_rates_has_no_gaps() -> None:
    """Rows 60 ms apart, and then some a second apart, each with another input."""
    rows = np.cumsum([*[30] * 40, *[500] * 7])

    assert codes(at(rows, 0.002 * rows)) <= {"time-uneven"}


def test_an_input_that_changes_once_has_hardly_changed_there_and_back_in_a_short_gap() -> None:
    """A step at row 30 of 300, and 15 rows that are missing long after it."""
    rows = np.delete(np.arange(300), np.arange(200, 215))
    step = replace(at(rows, 0.01 * rows), u=np.where(rows < 30, 30.0, 100.0))

    assert "gap-input-unknown" not in codes(step)
    assert "gap-input-unknown" in codes(replace(step, u=np.where(rows < 210, 30.0, 100.0)))


def test_a_gap_over_which_the_shaft_stood_under_the_same_input_hides_nothing() -> None:
    rows = np.delete(np.arange(2000), np.arange(300, 330))
    record = at(rows, 0.002 * rows)
    u = np.where((rows >= 250) & (rows < 400), 0.05, record.u)
    stood = np.where((rows >= 280) & (rows < 380), record.y[280], record.y)

    assert "gap-input-unknown" not in codes(replace(record, u=u, y=stood))
    assert "gap-input-unknown" in codes(replace(record, u=u))


@pytest.mark.parametrize("apart", [-0.0006, 0.0, 0.0006])
def test_a_shaft_that_turns_on_over_a_gap_did_not_stand(apart: float) -> None:
    """Whether the outputs are stamped a little before the inputs or after them."""
    rows = np.delete(np.arange(2000), np.arange(300, 330))
    record = at(rows, 0.002 * rows)
    u = np.where((rows >= 250) & (rows < 400), 0.05, record.u)
    turning = 0.002 * rows + 0.01 * np.arange(len(rows)) % 2

    assert "gap-input-unknown" in codes(replace(record, u=u, y=turning, t_output=record.t_output + apart))


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.02])
def test_a_settled_speed_does_not_show_that_nothing_is_missing(noise: float) -> None:
    """It is the same before and after 400 rows that were lost, as it would be before and after any other time."""
    rows = np.delete(np.arange(4000), np.concatenate([np.arange(k, k + 400) for k in (900, 2000, 3200)]))
    speed = 20.0 * (1.0 - np.exp(-rows / 50.0)) + noise * np.random.default_rng(1).standard_normal(len(rows))
    whole = dataset(seed=3, samples=4000, u=np.ones(4000), chain="derivative")
    lost = replace(whole, t_input=0.002 * rows, t_output=0.002 * rows, u=whole.u[rows], y=speed)

    assert "times-of-reading" not in codes(lost)


@pytest.mark.parametrize("volts", [0.8, 1.0, 3.0])
def test_the_bursts_of_a_differenced_speed_are_seen_as_well(volts: float) -> None:
    rows = np.arange(2000)
    whole = dataset(seed=3, kind="prbs", hold=20)
    slow = dataset(seed=3, samples=2000, u=volts * np.sign(whole.u[rows]), chain="derivative")
    times = 0.002 * rows - 0.001 * (rows % 40)

    assert "times-of-reading" in codes(replace(slow, t_input=times, t_output=times))
