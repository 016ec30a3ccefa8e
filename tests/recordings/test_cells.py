"""Dates and durations of arrays in memory are seconds; what is missing is NaN."""

import numpy as np
import pytest

from servobench.recordings.cells import to_numbers

FIRST = np.datetime64("2026-11-24T12:00:00", "ms")


@pytest.mark.parametrize("missing", [0, 2])
def test_dates_are_seconds_since_the_first_that_is_there(missing: int) -> None:
    stamps = FIRST + np.arange(4) * np.timedelta64(250, "ms")
    stamps[missing] = np.datetime64("NaT")
    expected = 0.25 * (np.arange(4) - (missing == 0))
    expected[missing] = np.nan

    seconds, are_times = to_numbers("t", stamps)

    assert are_times
    assert seconds is not None
    np.testing.assert_array_equal(seconds, expected)


def test_durations_are_seconds_whatever_their_unit() -> None:
    seconds, are_times = to_numbers("t", np.array([1500, 250], dtype="timedelta64[us]"))

    assert are_times
    assert seconds is not None
    assert seconds.tolist() == pytest.approx([1.5e-3, 2.5e-4], rel=1e-12)
