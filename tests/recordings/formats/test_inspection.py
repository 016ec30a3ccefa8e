"""The spacing of samples, and the time that a channel spends at its ends."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.core.channels import Channel
from servobench.recordings.formats.inspection import extremes, intervals
from servobench.recordings.recording import Series

T = 0.01 * np.arange(1000)


def series(values: np.ndarray, unit: str = "V") -> Series:
    return Series(channel=Channel(name="u", unit=unit), values=values, t=T[: len(values)])


def test_even_times_have_one_interval() -> None:
    found = intervals(T)

    assert found is not None
    assert found.is_even
    assert found.median == pytest.approx(0.01)
    assert found.counts.tolist() == [999]


def test_every_interval_that_goes_forward_is_counted_once_and_gaps_apart() -> None:
    random = np.random.default_rng(3)
    t = np.cumsum(random.uniform(0.008, 0.012, 500))
    t[300:] += 0.5
    t[400] = t[399]  # no interval at all, and then one that is longer

    found = intervals(t)

    assert found is not None
    assert not found.is_even
    assert found.beyond == 1
    assert int(found.counts.sum()) == 499 - 1 - 1
    assert found.edges[0] >= 0.008
    assert found.edges[-1] <= 0.025


@pytest.mark.parametrize("t", [np.array([]), np.array([1.0]), np.zeros(5), np.full(5, np.nan)])
def test_without_an_interval_there_is_nothing_to_tell(t: np.ndarray) -> None:
    assert intervals(t) is None


def test_the_shares_at_the_ends_are_those_of_the_samples() -> None:
    found = extremes(series(np.repeat([1.0, 3.0, 1.0, 3.0], [100, 50, 100, 150])))

    assert found is not None
    assert (found.at_smallest, found.at_largest, found.longest) == (0.5, 0.5, 150)
    assert not found.looks_limited  # two levels are a square wave


def test_a_sine_that_a_limit_cuts_off_looks_limited_and_a_whole_one_does_not() -> None:
    sine = 10.0 * np.sin(2 * np.pi * T)

    whole, cut = extremes(series(sine)), extremes(series(np.clip(sine, -8.0, 8.0)))

    assert whole is not None
    assert not whole.looks_limited
    assert cut is not None
    assert cut.looks_limited
    # A sine is above 0.8 of its height for acos(0.8)/π of the time; a sample more or less at each of 20 edges.
    assert cut.at_largest == pytest.approx(np.arccos(0.8) / np.pi, abs=20 / 1000)


def test_a_motor_at_rest_is_not_called_limited() -> None:
    rest = np.concatenate([np.zeros(200), np.linspace(0.0, 5.0, 300), np.full(100, 5.0)])

    found = extremes(series(rest))
    moved_back = extremes(series(np.concatenate([[0.1], rest, [4.9]]), unit="rad"))

    assert found is not None
    assert not found.looks_limited
    assert moved_back is not None
    assert not moved_back.looks_limited


@pytest.mark.parametrize("values", [np.array([]), np.full(5, np.nan), np.ones(9)])
def test_what_never_changes_has_no_ends(values: np.ndarray) -> None:
    assert extremes(series(values)) is None


def test_a_speed_that_is_zero_between_two_runs_is_at_rest_and_not_limited() -> None:
    run = np.r_[np.zeros(100), 20.0 * (1 - np.exp(-np.arange(100) / 20)), 20.0 * np.exp(-np.arange(20) / 5)]
    found = extremes(series(np.tile(run, 3), unit="rad/s"))
    lifted = extremes(series(np.tile(run, 3) + 1.0, unit="rad/s"))

    assert found is not None
    assert not found.looks_limited
    assert lifted is not None
    assert lifted.looks_limited
