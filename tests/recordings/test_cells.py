"""Dates and durations of arrays in memory are seconds; what is missing is NaN."""

from datetime import UTC, datetime, timedelta
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from servobench.recordings.cells import mostly_numbers, to_numbers

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


@pytest.mark.parametrize("zone", [None, ZoneInfo("Europe/Berlin")])
def test_moments_with_a_time_zone_or_without_are_seconds(zone: ZoneInfo | None) -> None:
    """Clocks in Berlin are set back by an hour between the second moment and the third, a quarter of a second later."""
    utc = datetime(2026, 10, 25, 0, 59, 59, 500_000, tzinfo=UTC)
    moments = [utc + timedelta(seconds=0.25 * k) for k in range(4)]
    cells = [each.replace(tzinfo=None) if zone is None else each.astimezone(zone) for each in moments]

    seconds, are_times = to_numbers("t", cells)

    assert are_times
    assert seconds is not None
    assert seconds.tolist() == [0.0, 0.25, 0.5, 0.75]


def test_a_column_of_which_most_are_numbers_keeps_them_and_names_its_texts() -> None:
    values, texts = mostly_numbers(np.array([1, None, "err", 2.5], dtype=object))

    assert values is not None
    np.testing.assert_array_equal(values, [1.0, np.nan, np.nan, 2.5])
    assert texts == {2: "err"}


@pytest.mark.parametrize("cells", [["a", "b", "3"], [[1], [2]], [10**400] * 2])
def test_a_column_of_texts_is_none(cells: list[object]) -> None:
    assert mostly_numbers(np.array(cells, dtype=object)) == (None, {})
