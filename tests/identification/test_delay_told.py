"""A delay swallows nothing: the first motion bounds it, and where the data don't tell it, it stays a thing of the loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.estimators.delay_prior import finding, prior_of_delay
from servobench.identification.estimators.least_squares import minimise
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset
from tests.rig.motor.reference import Truth

STEP = 0.002
FRICTION = Truth(coulomb_torque=2.5e-3, inductance=1e-9)
COULOMB = FRICTION.coulomb_torque * FRICTION.resistance / FRICTION.motor_constant
RATE = 1.0  # V/s


def ramp(seed: int) -> Dataset:
    u = RATE * np.arange(2500) * STEP
    acting = dataset(seed=seed, u=np.append(0.0, u[:-1]), samples=2500, sample_time=STEP, truth=FRICTION)
    return dataset(seed=seed, u=u, samples=2500, sample_time=STEP, y=acting.y)


def test_on_a_ramp_from_rest_friction_is_not_taken_for_a_delay() -> None:
    """Friction and delay are told as u_c + rate · delay only: the delay is what loops have, and the friction what is left.

    As the estimator says by itself, before any allowance for model error.
    """
    for seed in range(2):
        fit = ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way_rest"], [ramp(seed)])
        friction, delay = fit["coulomb_voltage"], fit["delay"]
        # The prior is one sample ± max(2 samples, 10 ms): 3 standard deviations of it.
        assert abs(delay.value) < STEP + 3 * 0.01
        assert abs(friction.value - COULOMB) < 1.96 * friction.sd
        # What isn't known of the delay, 10 ms at the least, isn't known of the friction.
        assert RATE * 0.01 < 1.1 * friction.sd < 10 * RATE * 0.01
        # Their sum is known to a count's worth of time at the end of the ramp, and lies where it is.
        assert abs(friction.value + RATE * delay.value - COULOMB - RATE * STEP) < 1e-3


def test_the_first_motion_bounds_the_delay() -> None:
    """A shaft that moves within 12 ms of a step can't have a delay of 13 ms and a sample."""
    at = np.arange(300) * STEP
    u = np.where(at < 0.02, 0.0, 3.0)
    data = dataset(seed=1, u=u, samples=300, sample_time=STEP, truth=FRICTION)
    moved = float(at[np.flatnonzero(np.abs(data.y - data.y[0]) > 3 * QUANTUM)[0]])
    (_, upper) = STRUCTURES["first_order_one_way"].bounds([data])
    assert upper[-1] <= moved - 0.02 + 2 * STEP
    assert upper[-1] >= STEP  # the truth, none and the latch


def test_a_record_in_mid_motion_bounds_no_delay() -> None:
    u = np.where(np.arange(300) * STEP < 0.02, 2.0, 3.0)
    data = dataset(seed=1, u=np.append(np.full(300, 2.0), u), samples=600, sample_time=STEP, truth=FRICTION)
    late = data.part(300 * STEP, 1e9)
    assert late.first_motion is None
    assert STRUCTURES["first_order_one_way"].bounds([late])[1][-1] == np.inf


def test_a_delay_that_the_data_know_is_the_datas_own() -> None:
    """40 ms in a square wave, which is four scales of what is expected."""
    u = np.where(np.arange(2000) * STEP % 0.8 < 0.4, 3.0, 1.0)
    acting = dataset(seed=2, u=np.append(np.zeros(20), u[:-20]), samples=2000, truth=FRICTION)
    data = replace(acting, u=u)
    fit = identify(data).fit
    assert fit is not None
    # A winding-free motor: only rounding, 1/√12 of a count at 10 rad/s and more, over 2000 samples.
    assert abs(fit["delay"].value - 0.040) < 1e-4


@pytest.mark.parametrize(
    ("scales", "words", "severity"),
    [(0.0, "about 2 ms, a sample time or so", "info"), (-0.1, "about 1 ms, a part of a sample time", "info"),
     (-0.1985, "assumed to be zero, as is usual", "info"), (6.0, "though so long a delay is rare", "info"),
     (9.0, "Check that the input is logged when it acts.", "warning"), (-0.5, "assumed to be zero", "info"),
     (-1.5, "before its input, as no motor has, and the other", "info")],
)  # fmt: skip
def test_a_delay_that_nothing_shows_is_told_as_it_is_and_doubted_where_nothing_is_so_late(
    scales: float, words: str, severity: str
) -> None:
    """The prior's middle is a sample of 2 ms, its scale 10 ms."""
    data = dataset(seed=1, kind="prbs", samples=500)
    structure = STRUCTURES["first_order"]
    prior = prior_of_delay(structure, [data])
    assert prior is not None
    place = minimise(structure, [data], structure.guesses([data])[0])
    theta = place.theta.copy()
    theta[prior.at] = prior.middle + scales * prior.scale

    told = finding(replace(place, theta=theta), prior)

    assert words in told.sentence.replace("\u00a0", " ")
    assert told.severity == severity


@pytest.mark.parametrize(
    ("step", "delay", "is_rare"),
    [
        (0.002, 0.08, False),
        (0.002, 0.09, True),
        (0.1, 0.5, False),
        (0.1, 0.7, True),
        (0.5, 2.4, False),
        (0.5, 2.6, True),
    ],
)
def test_a_delay_is_rare_beyond_half_a_second_or_two_scales_and_sooner_where_rows_are_close(
    step: float, delay: float, is_rare: bool
) -> None:
    """The scale is two sample times, 10 ms at least; the middle is one."""
    data = dataset(seed=1, samples=50, sample_time=step)

    prior = prior_of_delay(STRUCTURES["first_order"], [data])

    assert prior is not None
    assert prior.is_rare(delay) is is_rare


@pytest.mark.parametrize(("first", "others"), [(3, 3), (3, 7), (3, 10)])
def test_a_delay_that_is_longer_after_other_changes_than_after_the_first_is_in_its_interval(
    first: int, others: int
) -> None:
    """A loop that takes over a new input at times of its own: the first motion bounds the delay of one change."""
    edges = np.arange(200, 3000, 200)
    levels = np.resize([3.0, 1.0], len(edges))
    u, acting = np.zeros(3000), np.zeros(3000)
    for n, (edge, level) in enumerate(zip(edges, levels, strict=True)):
        u[edge:] = level
        acting[edge + (others if n else first) :] = level
    data = replace(dataset(seed=2, u=acting, samples=3000, truth=FRICTION), u=u)
    fit = identify(data).fit

    assert fit is not None
    low, high = fit["delay"].interval
    assert low < others * STEP < high


@pytest.mark.parametrize("digit", [0.0, 0.001])
def test_the_delay_of_a_single_step_is_cut_off_at_the_first_motion_also_if_its_last_digit_flickers(
    digit: float,
) -> None:
    """A lag of 40 ms that isn't modelled looks like a delay, but the shaft moves long before that."""
    t = STEP * np.arange(1500)
    lagging = np.where(t < 0.2, 0.0, 5.0 * (1.0 - np.exp(-np.maximum(t - 0.2, 0.0) / 0.04)))
    u = np.where(t < 0.2, 0.0, 5.0)
    u[1000:1010] += digit
    data = replace(dataset(seed=2, u=lagging, samples=1500, truth=FRICTION), u=u)
    fit = identify(data, "first_order_one_way").fit

    assert fit is not None
    assert not fit.delays_differ
    assert data.first_motion is not None
    moved = data.first_motion.effect - data.first_motion.cause
    assert fit["delay"].interval[1] <= moved + STEP + 1e-9
