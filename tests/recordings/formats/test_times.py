"""Faults of times, and the samples to keep; the longest increasing subsequence is compared with brute force."""

from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobench.recordings.formats.times import (
    in_words,
    keep_increasing,
    mean_step,
    time_base,
    time_findings,
)
from tests.recordings.formats.tables import codes


def longest_by_brute_force(values: list[float]) -> int:
    """Length of the longest strictly increasing subsequence, by trying all."""
    for length in range(len(values), 0, -1):
        for chosen in combinations(values, length):
            if all(a < b for a, b in pairwise(chosen)):
                return length
    return 0


@given(values=st.lists(st.integers(0, 6).map(float) | st.just(float("nan")), max_size=9))
def test_as_many_samples_as_possible_are_kept_and_their_times_increase(values: list[float]) -> None:
    t = np.array(values)

    kept = t[keep_increasing(t)]

    assert (np.diff(kept) > 0).all()
    assert np.isfinite(kept).all()
    # Equal times one after the other are one time, whichever way round.
    finite = [value for value in values if value == value]
    assert len(kept) == longest_by_brute_force(finite)


def test_of_equal_times_the_first_is_kept() -> None:
    assert keep_increasing(np.array([0.0, 1.0, 1.0, 1.0, 2.0])).tolist() == [True, True, False, False, True]


def test_one_wild_time_costs_one_sample() -> None:
    t = np.arange(100.0)
    t[40] = 1e9
    t[70] = -1e9

    assert np.flatnonzero(~keep_increasing(t)).tolist() == [40, 70]


def test_a_time_base_is_described_by_its_steps() -> None:
    base = time_base(np.array([0.0, 1.0, 2.0, 2.0, 3.0, 10.0, 9.0, np.nan]))

    assert (base.samples, base.non_finite, base.start, base.end) == (8, 1, 0.0, 9.0)
    assert (base.shortest_step, base.median_step, base.longest_step) == (1.0, 1.0, 7.0)
    assert (base.gaps, base.duplicates, base.backward) == (1, 1, 1)


@pytest.mark.parametrize("t", [[], [1.0], [2.0, 2.0], [np.nan, np.nan], [3.0, 1.0]])
def test_times_without_a_step_forward_have_no_steps(t: list[float]) -> None:
    base = time_base(np.array(t))

    assert base.median_step is base.longest_step is base.p99_step is base.shortest_step is None
    assert base.gaps == 0


def test_even_times_have_no_findings() -> None:
    assert time_findings(0.002 * np.arange(1000)) == ()


def test_times_too_far_apart_for_a_float_are_described_all_the_same() -> None:
    t = np.array([-1.7e308, 1.7e308, 0.0, 1.0, 2.0])

    assert np.isfinite(time_base(t).longest_step or np.nan)
    assert "time-not-increasing" in codes(time_findings(t))


def test_findings_name_the_rows_of_the_file() -> None:
    t = np.array([0.0, 1.0, np.nan, 2.0, 2.0, 1.5, 3.0, 4.0])
    rows = np.array([3, 4, 5, 8, 9, 10, 11, 12])

    found = {each.code: each.rows for each in time_findings(t, rows)}

    assert found["time-not-finite"] == (5, 5)
    assert found["time-duplicate"] == (9, 9)
    assert found["time-not-increasing"] == (10, 10)


def test_rows_are_put_into_words() -> None:
    assert in_words(np.array([7])) == "row 7"
    assert in_words(np.array([7, 8, 9])) == "rows 7 to 9"
    assert in_words(np.array([7, 90]), "sample") == "2 samples from 7 to 90"


def test_the_mean_of_rounded_times_is_known_to_one_count_between_the_ends() -> None:
    step = mean_step(np.floor(0.1 * np.arange(400) + 0.74))  # 10 Hz, whole seconds: 0 to 40

    assert step is not None
    assert step.step == pytest.approx(40 / 399)
    assert step.resolution == pytest.approx(1 / 399)
    assert step.figure == 0.1


def test_a_mean_step_leaves_out_a_pause_and_an_overflow() -> None:
    t = np.concatenate([0.01 * np.arange(100), 900 + 0.01 * np.arange(100), 0.01 * np.arange(100)])
    step = mean_step(t)

    assert step is not None
    assert step.step == pytest.approx(0.01)


@pytest.mark.parametrize("t", [np.zeros(20), np.full(5, np.nan), -np.arange(20.0), np.array([])])
def test_times_that_never_grow_have_no_mean_step(t: np.ndarray) -> None:
    assert mean_step(t) is None
