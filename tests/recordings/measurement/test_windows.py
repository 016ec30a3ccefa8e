"""Average, tachometer and derivative against integrals and travels worked out elsewhere."""

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.recordings.measurement.average import Average
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.derivative import Derivative
from servobench.recordings.measurement.tachometer import Tachometer

REGULAR = 0.002 * np.arange(400)
IRREGULAR = np.cumsum(np.random.default_rng(8).uniform(0.0005, 0.009, 400))
TIMES = pytest.mark.parametrize("t", [REGULAR, IRREGULAR], ids=["regular", "irregular"])
# Shorter than a sample, a whole number of samples, not a whole number, longer than half of the record.
WINDOWS = pytest.mark.parametrize("window", [0.0003, 0.01, 0.0333, 0.7])


def mean_by_brute_force(x: np.ndarray, t: np.ndarray, start: float, end: float) -> float:
    """The mean of straight lines between samples: the trapezoid rule, exact once every corner is a point."""
    points = np.unique(np.concatenate([[start], t[(t > start) & (t < end)], [end]]))
    return float(np.trapezoid(np.interp(points, t, x), points) / (end - start))


@TIMES
@WINDOWS
def test_an_average_is_the_integral_over_its_window(t: np.ndarray, window: float) -> None:
    x = np.cumsum(np.random.default_rng(4).normal(size=len(t)))

    averaged = Average(window=window)(x, t)

    expected = [x[0], *(mean_by_brute_force(x, t, max(t[0], end - window), end) for end in t[1:])]
    # np.interp rounds the edge of the window, at most 2 s, to 2e-16 s: some 1e-12 of the shortest window.
    np.testing.assert_allclose(averaged, expected, rtol=0, atol=1e-11 * np.abs(x).max())


@TIMES
@WINDOWS
def test_a_tachometer_is_the_travel_over_its_window(t: np.ndarray, window: float) -> None:
    x = np.cumsum(np.random.default_rng(4).normal(size=len(t)))

    speed = Tachometer(window=window)(x, t)

    start = np.maximum(t[0], t - window)[1:]
    np.testing.assert_allclose(
        speed[1:], (x[1:] - np.interp(start, t, x)) / (t[1:] - start), rtol=1e-9, atol=1e-8
    )
    assert speed[0] == 0.0


@TIMES
def test_a_constant_speed_is_read_exactly_by_each(t: np.ndarray) -> None:
    for text in (
        "derivative",
        "tachometer 33 ms",
        "derivative | average 33 ms",
        "tachometer 33 ms | average 33 ms",
    ):
        chain = Chain.parse(text)
        speed = chain(7.0 + 47.6 * t, t)[chain.valid(t)]
        assert len(speed) > 100
        np.testing.assert_allclose(speed, 47.6, rtol=1e-10)


@TIMES
def test_a_constant_passes_an_average_unchanged_from_the_first_sample(t: np.ndarray) -> None:
    np.testing.assert_allclose(Average(window=0.05)(np.full(len(t), 3.3), t), 3.3, rtol=1e-14)


def test_an_average_delays_a_ramp_by_half_its_window() -> None:
    averaged = Average(window=0.1)(REGULAR, REGULAR)

    np.testing.assert_allclose(REGULAR[60:] - averaged[60:], 0.05, rtol=1e-10)


def test_an_average_does_not_drift_over_a_million_samples() -> None:
    t = 0.001 * np.arange(1_000_000)
    x = np.where(
        np.arange(len(t)) < 1000, 1e9, 0.1
    )  # what a running sum remembers of large values is lost on small ones

    assert np.abs(Average(window=0.1)(x, t)[2000:] - 0.1).max() < 1e-12


def test_a_full_window_is_valid_although_times_are_rounded() -> None:
    for window, first in ((0.01, 5), (0.1, 50), (0.103, 52)):
        assert np.argmax(Chain.parse(f"average {window} s").valid(REGULAR)) == first
        assert np.argmax(Chain.parse(f"tachometer {window} s").valid(REGULAR)) == first


@pytest.mark.parametrize("step", [0.002, 0.007, 0.1])
def test_a_window_of_whole_samples_is_full_after_so_many_wherever_it_begins(step: float) -> None:
    t = step * np.arange(400)

    for samples in (3, 7, 10):
        average = Average(window=samples * step)
        assert [average.first_valid(first, t) - first for first in range(300)] == [samples] * 300


def test_windows_and_differences_in_a_row_lose_the_sum_of_what_they_look_back() -> None:
    assert np.argmax(Chain.parse("derivative | average 10 ms | average 20 ms").valid(REGULAR)) == 1 + 5 + 10
    assert not Chain.parse("average 5 s | average 5 s | derivative").valid(REGULAR).any()


def test_a_derivative_is_the_backward_difference_and_begins_with_zero() -> None:
    speed = Derivative()(np.array([1.0, 2.0, 4.0]), np.array([0.0, 0.5, 2.5]))

    assert speed.tolist() == [0.0, 2.0, 1.0]


@pytest.mark.parametrize("window", [0.0, -0.1, np.inf, np.nan])
def test_a_window_that_is_no_time_is_refused(window: float) -> None:
    with pytest.raises(UsageError, match="average"):
        Average(window=window)
    with pytest.raises(UsageError, match="tachometer"):
        Tachometer(window=window)


@pytest.mark.parametrize("words", [(), ("0.1",), ("5", "rad"), ("s",)])
def test_a_window_without_its_unit_is_asked_for(words: tuple[str, ...]) -> None:
    with pytest.raises(UsageError, match=r"average 0.103 s"):
        Average.parse(words)
    with pytest.raises(UsageError, match="tachometer 10 ms"):
        Tachometer.parse(words)


def test_a_derivative_takes_no_arguments() -> None:
    with pytest.raises(UsageError, match="takes no settings"):
        Derivative.parse(("50", "rad/s"))
