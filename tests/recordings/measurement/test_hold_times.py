"""When the voltages of a run held by a device that keeps the time: from what was made, and the host's and the device's word."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from servobench.core.channels import Array
from servobench.recordings.measurement.hold_times import hold_times
from servobench.recordings.measurement.two_clocks import in_device_time

PERIOD, COUNT = 0.005, 1000
T = PERIOD * np.arange(COUNT)
WAY_IN, WAY_OUT = 2e-4, 3e-4  # s; the shortest ways of a sample to the host, and of a voltage to the device


@dataclass
class Made:
    """A run as it was: voltages, when each was put out [s], and what is recorded; the host is 1000 s ahead and 80 ppm fast."""

    u: Array
    put: Array
    received: Array
    handed: Array
    held_since: Array


def made(seed: int, hiccups: int, u: Array | None = None, cable: bool = True) -> Made:
    """Ways of exponential lateness, 0.1 ms on average, and some hiccups of up to 15 ms of the host, and of the `cable`."""
    random = np.random.default_rng(seed)
    u = 3.0 * np.sign(random.standard_normal(COUNT // 8 + 1)).repeat(8)[:COUNT] if u is None else u
    lateness = random.exponential(1e-4, (2, COUNT))
    at = np.array([random.choice(COUNT - 10, hiccups, replace=False) for _ in range(2)])
    np.put_along_axis(lateness, at, random.uniform(0.0, 0.015, at.shape), axis=1)
    lateness[1] = lateness[1] if cable else 1e-4
    read = np.maximum.accumulate(T + WAY_IN + lateness[0])
    read += 1e-9 * np.arange(COUNT)
    handed = read + 3e-5
    put = np.maximum.accumulate(handed + WAY_OUT + lateness[1])
    put += 1e-9 * np.arange(COUNT)
    held_since = np.zeros(COUNT)
    change = np.flatnonzero(np.diff(u, prepend=0.0) != 0.0)
    last = np.searchsorted(put[change], T, side="right")
    held_since = np.where(last > 0, put[change][np.maximum(last - 1, 0)], 0.0)
    host = lambda x: 1000.0 + (1 + 80e-6) * x  # noqa: E731
    return Made(u, put, host(read), host(handed), np.rint(held_since * 1e6) / 1e6)


@pytest.mark.parametrize("seed", range(5))
def test_a_host_s_times_are_carried_over_but_for_the_shortest_way_whatever_else_came_late(seed: int) -> None:
    run = made(seed, hiccups=40)

    found = in_device_time(run.received, run.received, T)

    assert found is not None
    truth = (run.received - 1000.0) / (1 + 80e-6)
    # Of 1,000 ways the shortest near either end is late by 0.1 ms / 500 on average; ten times that is one in e^10.
    assert found + WAY_IN == pytest.approx(truth, abs=2e-6)


def test_a_recording_that_is_played_faster_than_it_was_made_tells_no_time() -> None:
    assert in_device_time(1e-5 * np.arange(COUNT), 1e-5 * np.arange(COUNT), T) is None
    assert in_device_time(T[:1], T[:1], T[:1]) is None


@pytest.mark.parametrize("seed", range(5))
def test_each_change_that_a_sample_tells_of_held_from_when_it_did(seed: int) -> None:
    """However late it came, and whatever else came in the same tick."""
    run = made(seed, hiccups=40)
    handed = in_device_time(run.handed, run.received, T)
    assert handed is not None

    found = hold_times(run.u, handed, run.held_since, T)

    assert found is not None
    changes = np.flatnonzero(np.diff(run.u, prepend=0.0) != 0.0)
    # All changes but the last are told of, in whole microseconds: bits are 40 ms long, and nothing is later than 30 ms.
    assert found[changes[:-1]] == pytest.approx(run.put[changes[:-1]], abs=1e-6)
    assert np.all(np.diff(found) > 0)
    # What repeats a voltage has its usual time, too, or the median step of the input would be a nanosecond.
    assert np.median(np.diff(found)) == pytest.approx(PERIOD, rel=0.1)


def test_where_every_voltage_is_a_change_what_no_sample_tells_of_lies_between_its_neighbours() -> None:
    """As under feedback: of the voltages that a host that was late hands over at once, samples tell of the last only."""
    run = made(3, hiccups=40, u=np.arange(1.0, COUNT + 1.0), cable=False)
    handed = in_device_time(run.handed, run.received, T)
    assert handed is not None

    found = hold_times(run.u, handed, run.held_since, T)

    assert found is not None
    assert np.count_nonzero(np.diff(run.put) < 1e-6) > 20  # such bursts are there
    # To what whole microseconds leave of those that are told of, and of the usual way, and to how well a clock is carried over.
    assert found[:-1] == pytest.approx(run.put[:-1], abs=3e-6)


def test_a_device_that_tells_of_next_to_no_voltage_is_not_taken_at_its_word() -> None:
    run = made(1, hiccups=0)
    handed = in_device_time(run.handed, run.received, T)
    assert handed is not None

    assert hold_times(run.u, handed, np.full(COUNT, np.nan), T) is None
    assert hold_times(run.u, handed, np.where(T > 4.5, run.held_since, np.nan), T) is None
    assert hold_times(run.u, handed, T + 1.0, T) is None  # times to come
