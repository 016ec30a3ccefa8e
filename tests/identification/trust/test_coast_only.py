"""A record that shows nothing but a coast."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.finding import Severity
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset


def after_full_duty(last: float, unit: str = "%") -> Dataset:
    """100 % for a second, and another duty for the next, recorded from when the speed is steady."""
    percent = np.where(np.arange(1000) < 500, 100.0, last)
    whole = dataset(seed=1, samples=1000, u=0.04 * percent, chain="derivative")
    return replace(replace(whole, u=percent, input_unit=unit).part(0.6, 2.0), input_before=100.0)


@pytest.mark.parametrize("last", [0.0, 0.8, -2.0])
def test_next_to_no_duty_is_a_coast_as_none_is(last: float) -> None:
    """Pulses of two parts in 255 drive nothing: a bridge lets go of the motor for all of the time between them."""
    assert [each.code for each in DOUBTS["coast_only"].about_data([after_full_duty(last)])] == ["coast-only"]


def test_another_duty_is_no_coast_and_shows_how_the_motor_slows_down() -> None:
    """Where a bridge lets go of the motor between its pulses, that takes up to three times as long as to speed up."""
    (about,) = DOUBTS["coast_only"].about_data([after_full_duty(20.0)])

    assert about.code == "slows-down-only"
    assert about.severity is Severity.INFO


@pytest.mark.parametrize(("last", "unit"), [(-100.0, "%"), (0.0, "V"), (20.0, "V"), (120.0, "%")])
def test_a_reversal_a_voltage_or_more_of_it_is_none(last: float, unit: str) -> None:
    assert not DOUBTS["coast_only"].about_data([after_full_duty(last, unit)])


def test_a_record_that_shows_both_says_nothing() -> None:
    both = [after_full_duty(20.0), after_full_duty(120.0)]

    assert not DOUBTS["coast_only"].about_data(both)
