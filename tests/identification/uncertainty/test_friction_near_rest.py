"""Friction that is larger near rest is in the intervals, and only where there is friction and motion near rest."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.friction_near_rest import (
    excess_covariance,
    with_friction_near_rest,
)
from tests.datasets import dataset, prbs

GAIN, TAU, COULOMB, EXCESS = 20.0, 0.1, 0.3, 0.3  # rad/(s·V), s, V, of the Coulomb friction
NARROW = 2.0  # rad/s, in which the excess falls to 37 %: a thirtieth of the largest speed
STEP, SAMPLES, SUBSTEPS, NOISE = 0.005, 800, 200, 1e-3  # s, samples, steps in each, rad
RUNS = 30


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def turned(u: NDArray[np.float64], excess: float, narrow: float) -> NDArray[np.float64]:
    """The angle of a motor whose friction has an exponential excess near rest (Stribeck), in steps of 25 µs from rest."""
    angle, speed, h = 0.0, 0.0, STEP / SUBSTEPS
    found = np.empty(len(u))
    for n, volts in enumerate(u):
        found[n] = angle
        for _ in range(SUBSTEPS):
            lost = COULOMB * (1.0 + excess * np.exp(-abs(speed) / narrow))
            free = speed + h / TAU * (GAIN * volts - speed)
            brake = h / TAU * GAIN * lost
            new = free - min(brake, max(-brake, free))
            angle += 0.5 * h * (speed + new)
            speed = new
    return found


def fitted(seed: int, excess: float) -> Fit:
    random = np.random.default_rng(seed)
    return of(prbs(SAMPLES, 25, random), excess, NARROW, seed, random)


def of(u: NDArray[np.float64], excess: float, narrow: float, seed: int, random: np.random.Generator) -> Fit:
    y = turned(u, excess, narrow) + NOISE * random.standard_normal(SAMPLES)
    data = replace(dataset(seed=seed, u=u, samples=SAMPLES, sample_time=STEP, y=y), quantum=None)
    return ESTIMATORS["output_error"].fit(STRUCTURES["first_order_coulomb"], [data])


@pytest.fixture(scope="module")
def stribeck() -> list[Fit]:
    """Recordings of motors with 30 % more friction at rest, each of another input."""
    return [fitted(seed, EXCESS) for seed in range(RUNS)]


def misses(fits: list[Fit]) -> int:
    return sum(abs(fit["gain"].value - GAIN) > 1.96 * fit["gain"].sd for fit in fits)


def test_the_line_covers_what_more_friction_near_rest_does(stribeck: list[Fit]) -> None:
    """Of 30 intervals that hold 95 % three or more miss with a chance of 19 %, six or more with one of 0.3 %."""
    assert misses([with_friction_near_rest(fit) for fit in stribeck]) <= 5
    assert misses(stribeck) > 5


def with_wide_excess(seed: int) -> Fit:
    """A motor with half as much friction again at rest, falling to nothing at three tenths of its largest speed."""
    structure, plain = STRUCTURES["first_order_coulomb"], fitted(seed, 0.0)
    (record,) = plain.records
    theta = np.concatenate([plain.model.theta, record.nuisance])
    top = float(np.abs(structure.speed(theta, record.data)).max())
    more = 0.5 * COULOMB * structure.by_excess_friction(theta, record.data, 0.3 * top)
    return ESTIMATORS["output_error"].fit(structure, [replace(record.data, y=record.data.y + more)])


def test_the_line_covers_an_excess_that_reaches_to_a_third_of_the_largest_speed() -> None:
    """Of 6 intervals that hold 95 % three or more miss with a chance of 0.2 %."""
    fits = [with_wide_excess(seed) for seed in range(6)]

    assert misses(fits) >= 3
    assert misses([with_friction_near_rest(fit) for fit in fits]) == 0


def test_the_line_says_what_it_is_for(stribeck: list[Fit]) -> None:
    (line,) = with_friction_near_rest(stribeck[0]).budget

    assert line.source == "friction near rest"
    assert line.freedom == np.inf


def test_where_the_data_show_none_it_adds_little() -> None:
    """On average: the same motor with a constant friction has a gain that is at most a third less certain."""
    fits = [fitted(seed, 0.0) for seed in range(6)]

    wider = [with_friction_near_rest(fit)["gain"].sd / fit["gain"].sd for fit in fits]

    assert float(np.sqrt(np.mean(np.square(wider)))) < 1.33


def test_a_model_without_friction_has_no_such_line(stribeck: list[Fit]) -> None:
    data = [stribeck[0].records[0].data]

    assert not excess_covariance(ESTIMATORS["output_error"].fit(STRUCTURES["first_order"], data)).any()
