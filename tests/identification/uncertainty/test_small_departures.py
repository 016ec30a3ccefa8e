"""A winding that warms up, a dead band, play and a shaft that twists are in the intervals, as far as the data leave room."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.identify import identify
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.possible_term import possible_covariance, size_before
from servobench.identification.uncertainty.score_test import ScoreTest
from servobench.identification.uncertainty.small_departures import with_small_departures
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset, prbs, square
from tests.rig.motor.reference import Truth, march

GAIN, TAU, COULOMB = 20.0, 0.1, 0.6  # rad/(s·V), s, V
STEP, SAMPLES, SUBSTEPS = 0.01, 150, 100  # s, samples, steps in each
RUNS = 20
HALF_PLAY = float(np.deg2rad(0.1))


def turned(u: NDArray[np.float64], warmer: float) -> NDArray[np.float64]:
    """The angle of a motor that turns one way, whose resistance grows by a part of itself over the record, in steps of 0.1 ms.

    τ dω/dt = K ((u - ω/K)/r - u_c), from its speed under the first input on.
    """
    angle, speed, h = 0.0, GAIN * (u[0] - COULOMB), STEP / SUBSTEPS
    found = np.empty(len(u))
    for n, volts in enumerate(u):
        found[n] = angle
        r = 1.0 + warmer * n / len(u)
        for _ in range(SUBSTEPS):
            new = speed + h / TAU * ((GAIN * volts - speed) / r - GAIN * COULOMB)
            angle += 0.5 * h * (speed + new)
            speed = new
    return found


def played(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """The angle behind a gap: it rests until the gap is used up, then follows."""
    found, at = np.empty(len(angle)), angle[0]
    for n, value in enumerate(angle):
        at = min(max(at, value - HALF_PLAY), value + HALF_PLAY)
        found[n] = at
    return found


def fitted(y: NDArray[np.float64], u: NDArray[np.float64], seed: int, structure: str, noise: float) -> Fit:
    read = y + noise * np.random.default_rng(seed).standard_normal(len(y))
    data = replace(dataset(seed=seed, u=u, samples=len(u), sample_time=STEP, y=read), quantum=None)
    return ESTIMATORS["output_error"].fit(STRUCTURES[structure], [data])


def warmed(seed: int, warmer: float, noise: float = 2e-3) -> Fit:
    """A record of two levels, 1.5 and 3 V, three to five times each."""
    random = np.random.default_rng(seed)
    u = np.where((np.arange(SAMPLES) + random.integers(0, 40)) % 40 < 20, 3.0, 1.5)
    return fitted(turned(u, warmer), u, seed, "first_order_one_way", noise)


def geared(seed: int, plays: bool) -> Fit:
    """The reference motor both ways, over a few turns."""
    u = 0.3 * prbs(SAMPLES, 10, np.random.default_rng(seed)) / 3.0
    angle = march(Truth(), u, STEP, step=2e-5)[:, 2]
    return fitted(played(angle) if plays else angle, u, seed, "first_order_coulomb", 3e-4)


def driven(seed: int, band: float) -> Fit:
    """The reference motor both ways under levels of all sizes, behind an amplifier that loses so much of 3 V about zero."""
    u = np.random.default_rng(seed).uniform(-3.0, 3.0, SAMPLES // 5).repeat(5)
    lost = np.clip(u, -3.0 * band, 3.0 * band)
    return fitted(march(Truth(), u - lost, STEP, step=2e-5)[:, 2], u, seed, "first_order_coulomb", 3e-4)


def two_masses(seed: int, end: int, both_ways: bool = False) -> Dataset:
    """Counts of the rotor (`end` 0) or of a load as heavy behind a shaft that twists, exactly, from rest.

    The square wave is 1 V and 3 V, or 2 V both ways.
    """
    random = np.random.default_rng(seed)
    phase = random.random()
    u = square(np.arange(5000) * 0.002, phase)
    u = 2.0 * (u - 2.0) if both_ways else u
    step, state = expm(0.002 * pair()), np.zeros(5)
    angle = np.empty(len(u))
    for n, volts in enumerate(u):
        angle[n] = state[end]
        state[4] = volts
        state = step @ state
    counts = np.floor(angle / QUANTUM + random.random()) + 0.5
    return replace(
        dataset(seed=seed, u=u, samples=len(u), y=counts * QUANTUM), quantum=QUANTUM, input_before=0.0
    )


def pair() -> NDArray[np.float64]:
    """The rates of both angles, both speeds and the held input, halves of one inertia, free resonance at 150 Hz."""
    natural = 2 * np.pi * 150.0
    spring, damping = natural**2 / 4, 2 * 0.02 * natural / 4
    rotor = [-spring, spring, -1 / TAU - damping, damping, GAIN / TAU]
    load = [spring, -spring, damping, -damping, 0.0]
    turning = [[0.0, 0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0]]
    return np.array([*turning, 2 * np.array(rotor), 2 * np.array(load), np.zeros(5)])


def slow_pole() -> float:
    """The time constant of the pair; its other poles are zero and the resonance."""
    return float(-1 / sorted(np.linalg.eigvals(pair()[:4, :4]), key=abs)[1].real)


def far_off(fits: list[Fit], gain: float) -> int:
    """The number of gains that are off by more than the three standard deviations that a trusted one may be."""
    return sum(abs(fit["gain"].value - gain) > 3.0 * fit["gain"].sd for fit in fits)


def test_the_line_allows_for_a_winding_that_warms_up() -> None:
    """By 5 %."""
    fits = [warmed(seed, 0.05) for seed in range(RUNS)]

    assert far_off(fits, GAIN) > RUNS // 4
    assert far_off([with_small_departures(fit) for fit in fits], GAIN) == 0
    assert "a motor that warms up" in {line.source for line in with_small_departures(fits[0]).budget}


def test_the_line_allows_for_play() -> None:
    """Of 0.2°; K = k/(k² + R b)."""
    truth = Truth()
    gain = truth.motor_constant / (truth.motor_constant**2 + truth.resistance * truth.viscous_friction)
    fits = [geared(seed, plays=True) for seed in range(RUNS)]

    assert far_off(fits, gain) > RUNS // 4
    assert far_off([with_small_departures(fit) for fit in fits], gain) == 0
    assert "play" in {line.source for line in with_small_departures(fits[0]).budget}


def test_the_line_allows_for_a_dead_band() -> None:
    """Of 3 % of the largest input. Friction costs as much, but while the shaft turns and not while the input lasts."""
    truth = Truth()
    gain = truth.motor_constant / (truth.motor_constant**2 + truth.resistance * truth.viscous_friction)
    fits = [driven(seed, 0.03) for seed in range(RUNS)]

    assert far_off(fits, gain) > RUNS // 4
    assert far_off([with_small_departures(fit) for fit in fits], gain) == 0
    assert "a dead band" in {line.source for line in with_small_departures(fits[0]).budget}


@pytest.mark.parametrize("end", [0, 1], ids=["encoder on the rotor", "encoder on the load"])
def test_the_line_allows_for_a_shaft_that_twists(end: int) -> None:
    """Rotor and load swing at 150 Hz, which moves the time constant by a part in 10,000 of itself."""
    fits = [
        ESTIMATORS["output_error"].fit(STRUCTURES["first_order_one_way"], [two_masses(n, end)])
        for n in range(8)
    ]

    def far(fit: Fit) -> bool:
        return abs(fit["time_constant"].value - slow_pole()) > 3.0 * fit["time_constant"].sd

    assert sum(map(far, fits)) >= 2
    assert not any(far(with_small_departures(fit)) for fit in fits)
    assert "a shaft that twists" in {line.source for line in with_small_departures(fits[0]).budget}


def test_of_a_speed_no_shaft_twists() -> None:
    """The position's second derivative is what the line goes by."""
    fit = ESTIMATORS["output_error"].fit(
        STRUCTURES["first_order_one_way"], [dataset(seed=1, chain="derivative")]
    )

    assert "a shaft that twists" not in {line.source for line in with_small_departures(fit).budget}


@pytest.mark.parametrize("seed", [0, 3])
def test_a_shaft_that_twists_is_no_winding(seed: int) -> None:
    """A second lag of 1.6 ms would fit better, with an output that is 1.6 ms ahead of its input."""
    result = identify(two_masses(seed, 0, both_ways=True))

    assert result.fit is not None
    assert result.fit.structure == "first_order"


def test_under_one_size_of_input_the_gain_includes_the_dead_band() -> None:
    assert "a dead band" not in {line.source for line in with_small_departures(geared(0, plays=False)).budget}


def test_a_motor_that_turns_one_way_shows_no_play() -> None:
    assert "play" not in {line.source for line in with_small_departures(warmed(0, 0.0)).budget}


@pytest.mark.parametrize(
    "recorded",
    [partial(geared, plays=False), partial(warmed, warmer=0.0, noise=1e-4), partial(driven, band=0.0)],
    ids=["play", "warming", "dead band"],
)
def test_where_there_is_none_and_the_data_show_it_they_add_little(recorded: Callable[[int], Fit]) -> None:
    """On average over 6 records, with readings good enough to tell a departure of a tenth of the largest."""
    fits = [recorded(seed) for seed in range(6)]

    wider = [with_small_departures(fit)["gain"].sd / fit["gain"].sd for fit in fits]

    assert float(np.sqrt(np.mean(np.square(wider)))) < 1.33


def test_before_any_data_the_size_has_its_prior() -> None:
    """A column that is a millionth of the noise says nothing: three quarters none, else uniform up to the largest."""
    fit = warmed(2, 0.0)
    test = ScoreTest(fit, 3.0)
    column = 1e-6 * np.random.default_rng(1).standard_normal(len(test.innovations))

    off = test.joint_shift(column)[: len(fit.model.theta)]

    added = possible_covariance(test, column)
    assert added == pytest.approx(np.outer(off, off) / 12.0, rel=0.02)  # ¼ · ⅓, on 101 sizes
    assert pytest.approx(1.0 / 12.0, rel=0.02) == size_before(0.75) ** 2


def test_a_term_that_most_motors_have_counts_for_more() -> None:
    """As above, with one motor of four that hasn't got it: three times the variance."""
    fit = warmed(2, 0.0)
    test = ScoreTest(fit, 3.0)
    column = 1e-6 * np.random.default_rng(1).standard_normal(len(test.innovations))

    assert possible_covariance(test, column, none=0.25) == pytest.approx(
        3.0 * possible_covariance(test, column)
    )


def test_where_large_sizes_are_more_probable_the_mean_square_is_larger() -> None:
    """As above, with a density 2 s in place of 1: ∫ 2 s³ ds = ½ for ∫ s² ds = ⅓."""
    fit = warmed(2, 0.0)
    test = ScoreTest(fit, 3.0)
    column = 1e-6 * np.random.default_rng(1).standard_normal(len(test.innovations))

    off = test.joint_shift(column)[: len(fit.model.theta)]

    assert possible_covariance(test, column, power=1.0) == pytest.approx(np.outer(off, off) / 8.0, rel=0.02)
    assert size_before(0.75, 1.0) ** 2 == pytest.approx(1.0 / 8.0)


def test_a_small_size_that_the_data_could_hide_counts_less_where_large_ones_are_more_probable() -> None:
    """A column of 20 noises of which there is nothing: sizes of a twentieth are 2 · 0.05 times as probable as among all alike."""
    fit = warmed(3, 0.0)
    column = np.random.default_rng(2).standard_normal(len(ScoreTest(fit, 3.0).innovations))
    test = ScoreTest(fit, 3.0)
    column -= test.basis @ (test.basis.T @ column)
    column *= 20.0 / np.linalg.norm(column)
    (record,) = fit.records
    without = record.innovations - column * (column @ record.innovations) / 400.0
    test = ScoreTest(replace(fit, records=(replace(record, innovations=without),)), 3.0)
    hidden = column + test.basis[:, 0]

    small, alike = (possible_covariance(test, hidden, none=0.5, power=power)[0, 0] for power in (1.0, 0.0))

    # ∫ 2 s³ e^(-s²/2σ²) ds = 4 σ⁴ and ∫ 2 s e^(-s²/2σ²) ds = 2 σ² for √(π/2) σ³ and √(π/2) σ, beside the chance of none, 1.
    sd = 1 / 20.0
    half = math.sqrt(math.pi / 2)
    expected = (4 * sd**4 / (1 + 2 * sd**2)) / (half * sd**3 / (1 + half * sd))
    assert small / alike == pytest.approx(expected, rel=0.05)


def test_a_size_that_the_data_show_to_be_none_is_as_uncertain_as_their_noise() -> None:
    """A column of 10,000 noises of which there is nothing: its size is half a normal number of that standard deviation."""
    fit = warmed(3, 0.0)
    test = ScoreTest(fit, 3.0)
    column = np.random.default_rng(2).standard_normal(len(test.innovations))
    column -= test.basis @ (test.basis.T @ column)
    column *= 1e4 / np.linalg.norm(column)
    (record,) = fit.records
    without = record.innovations - column * (column @ record.innovations) / 1e8
    test = ScoreTest(replace(fit, records=(replace(record, innovations=without),)), 3.0)
    hidden = column + test.basis[:, 0]  # what the parameters can have as well

    off = test.joint_shift(hidden)[: len(fit.model.theta)]

    added = possible_covariance(test, hidden, none=0.0)
    assert added == pytest.approx(np.outer(off, off) / 1e8, rel=0.05)


def test_of_several_forms_the_one_that_the_data_show_counts() -> None:
    """One that is there at half of its largest size, 40 standard deviations, beside one that isn't."""
    fit = warmed(3, 0.0)
    columns = np.random.default_rng(2).standard_normal((2, len(ScoreTest(fit, 3.0).innovations)))
    shown, absent = 80.0 * columns / np.linalg.norm(columns, axis=1)[:, None]
    (record,) = fit.records
    test = ScoreTest(
        replace(fit, records=(replace(record, innovations=record.innovations + 0.5 * shown),)), 3.0
    )

    added = possible_covariance(test, shown, absent)

    # Of the other there is as much as chance makes of it, 80 noises long: a sixteenth of a per cent.
    assert added == pytest.approx(possible_covariance(test, shown), rel=0.01)
    assert np.abs(possible_covariance(test, absent)).max() < 0.1 * np.abs(added).max()


def test_a_size_that_the_data_show_is_the_one_that_counts() -> None:
    """Half of the largest, at 40 standard deviations."""
    fit = warmed(3, 0.0)
    random = np.random.default_rng(2)
    column = random.standard_normal(len(ScoreTest(fit, 3.0).innovations))
    column *= 80.0 / np.linalg.norm(column)
    (record,) = fit.records
    shown = replace(fit, records=(replace(record, innovations=record.innovations + 0.5 * column),))
    test = ScoreTest(shown, 3.0)

    off = test.joint_shift(column)[: len(fit.model.theta)]

    # Known to a fortieth of itself, by the part of the column that no parameter explains, and colour left as it is.
    assert possible_covariance(test, column) == pytest.approx(0.25 * np.outer(off, off), rel=0.15)
