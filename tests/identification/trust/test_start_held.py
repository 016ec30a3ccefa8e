"""A delay that only a start from rest shows may be static friction."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.finding import Finding
from servobench.identification.estimators.base import Fit
from servobench.identification.identify import identify
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

GAIN, TAU, SLIDING, STATIC = 4.0, 0.2, 6.0, 7.5  # rad/(s·V), s, V, V
STEP, SUBSTEPS = 0.01, 10  # s
RIPPLE = 0.4  # V, once in a turn
BEGINS = 100  # samples at rest before the input comes
QUANTUM = 2 * np.pi / 2400


def risen(later: float = 0.0) -> NDArray[np.float64]:
    """An input [V] that jumps to 4.8 V, rises to 8 V in 0.13 s and stays about there; from 0.6 s on it is `later` higher."""
    t = STEP * np.arange(2 * BEGINS) - STEP * BEGINS
    u = np.minimum(4.8 + 25.0 * t, 8.0 + 0.2 * np.sin(9.0 * t))
    return np.where(t < 0, 0.0, u + later * (t >= 0.6))


def turned(u: NDArray[np.float64], static: float, late: int) -> Dataset:
    """Counts of a motor that starts at a `static` friction [V], `late` samples after its input, and has a ripple of its own."""
    angle, speed, h = 0.3 * QUANTUM, 0.0, STEP / SUBSTEPS
    y = np.empty(len(u))
    for n in range(len(u)):
        y[n] = QUANTUM * np.floor(angle / QUANTUM)
        volts = u[max(n - late, 0)]
        for _ in range(SUBSTEPS):
            if speed == 0.0 and volts <= static:
                continue
            speed = max(
                speed + h / TAU * (GAIN * (volts - SLIDING + RIPPLE * np.sin(angle + 1.0)) - speed), 0.0
            )
            angle += h * speed
    return replace(dataset(seed=1, u=u, samples=len(u), sample_time=STEP, y=y), quantum=QUANTUM)


def fit_of(later: float = 0.0, static: float = STATIC, late: int = 1) -> Fit:
    fit = identify(turned(risen(later), static, late)).fit
    assert fit is not None
    return fit


def doubts(fit: Fit) -> list[Finding]:
    return list(DOUBTS["start_held"].about_fit(fit))


@pytest.fixture(scope="module")
def sticking() -> Fit:
    """The fit of a shaft that sticks for 0.12 s while the input rises, and has no delay to speak of."""
    return fit_of()


def test_a_delay_that_only_a_start_under_a_rising_input_shows_is_doubted(sticking: Fit) -> None:
    """The ripple hides from the fit what the gain is: 1.1 instead of 4."""
    (doubt,) = doubts(sticking)

    assert sticking.model["delay"] > 10 * STEP
    assert abs(sticking.model["gain"] - GAIN) > 0.5 * GAIN
    assert doubt.code == "start-held"
    assert "static friction may have held it" in doubt.sentence


def test_what_a_device_is_known_to_be_late_by_is_no_part_of_it(sticking: Fit) -> None:
    """Two samples later in all, as the device says: the input a whole delay before the motion is the same."""
    later = identify(replace(turned(risen(), STATIC, 3), delay=2 * STEP)).fit
    assert later is not None

    (one,), (other,) = doubts(sticking), doubts(later)

    assert re.findall(r"rose from (\S+)", other.sentence) == re.findall(r"rose from (\S+)", one.sentence)


def test_one_that_a_later_step_shows_as_well_is_not() -> None:
    fit = fit_of(later=3.0, static=SLIDING, late=12)

    assert fit["delay"].interval[0] < 12 * STEP < fit["delay"].interval[1]
    assert not doubts(fit)


def test_nor_one_that_a_step_from_rest_shows() -> None:
    """The input doesn't rise while the shaft stands."""
    u = np.where(np.arange(2 * BEGINS) < BEGINS, 0.0, 8.0)
    fit = identify(turned(u, STATIC, 12)).fit
    assert fit is not None

    assert fit.model["delay"] == pytest.approx(12 * STEP, abs=2 * STEP)
    assert not doubts(fit)
