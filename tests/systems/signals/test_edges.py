"""A sample that falls on an edge, but for rounding, falls on it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobench.systems.signals.edges import is_past, periods
from servobench.systems.signals.square import Square


@pytest.mark.parametrize(
    ("rate", "frequency"), [(500, 0.4), (1000, 0.4), (500, 1 / 3), (100, 0.1), (8000, 0.7), (3, 0.1)]
)
def test_an_edge_on_a_sample_stays_on_it_for_hours(rate: int, frequency: float) -> None:
    k = np.arange(20_000_000 // 10)
    half = rate / (2 * frequency)

    for t in (k / rate, k * (1 / rate)):
        edges = np.flatnonzero(np.diff(Square(frequency=frequency)(t))) + 1
        # The j-th edge is the first sample at or after j half periods; 1e-6 of a sample is far more than the rounding.
        np.testing.assert_array_equal(edges, np.ceil(half * np.arange(1, len(edges) + 1) - 1e-6))


def test_every_half_period_of_the_default_square_wave_has_625_samples_at_500_hz() -> None:
    for first in (0, 10**6, 10**9):
        u = Square()(np.arange(first, first + 1_000_000) * 0.002)
        assert set(np.diff(np.flatnonzero(np.diff(u)))) == {625}


@given(
    st.integers(0, 10**7),
    st.floats(1e-3, 1e3),
    st.sampled_from([-3, -1, 0, 1, 3]),
    st.floats(-100, 100, allow_subnormal=False),
)
def test_a_time_a_few_roundings_off_a_whole_period_counts_as_that_period(
    n: int, frequency: float, roundings: int, start: float
) -> None:
    t = start + n / frequency
    at = periods(np.array([t + roundings * np.spacing(t)]), frequency, start)

    assert at.whole[0] == n
    # What is over is no more than the roundings of t: one on the way to it, three added, twice that with those of the product.
    assert 0 <= at.fraction[0] <= 8 * frequency * np.spacing(abs(t) + abs(start))
    assert at.started[0]


@pytest.mark.parametrize("frequency", [0.4, 0.7, 3, 1 / 0.04])
def test_after_a_billion_periods_an_edge_is_still_where_it_belongs(frequency: float) -> None:
    n = np.random.default_rng(2).integers(10**8, 10**9, 10_000)

    at = periods(n / frequency, frequency, 0.0)

    np.testing.assert_array_equal(at.whole, n)


@given(st.floats(1e-3, 1e3), st.floats(0, 1e4), st.floats(0.001, 0.999))
def test_a_time_that_is_a_thousandth_of_a_period_away_is_not_moved(
    frequency: float, whole: float, fraction: float
) -> None:
    n = np.floor(whole)
    at = periods(np.array([(n + fraction) / frequency]), frequency, 0.0)

    assert at.whole[0] == n
    assert at.fraction[0] == pytest.approx(fraction, abs=1e-11)  # four roundings of 1e4
    assert at.before(fraction + 1e-3)[0]
    assert not at.before(fraction - 1e-3)[0]


@pytest.mark.parametrize(("before", "expected"), [(0.0, True), (1e-10, True), (1e-8, False)])
def test_a_time_has_reached_an_edge_that_is_less_than_a_nanosecond_away(
    before: float, expected: bool
) -> None:
    assert is_past(np.array([0.6 - before]), 0.6)[0] == expected


@pytest.mark.parametrize("phase", [0.0, 0.1, -7.0])
def test_a_signal_has_not_started_before_its_start_whatever_its_phase(phase: float) -> None:
    at = periods(np.array([-1.0, 0.5 - 1e-6, 0.5, 0.6]), 0.4, 0.5, phase)

    np.testing.assert_array_equal(at.started, [False, False, True, True])
