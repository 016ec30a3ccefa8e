"""Kernels of the estimators: against plain NumPy, for several records, held parameters and priors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.estimators import kernels
from servobench.identification.estimators.disturbance import Blocks, Linearisation
from servobench.identification.estimators.symmetric import solve
from servobench.identification.models.turning import Sliding
from servobench.recordings.measurement.dataset import Dataset, keep_with_data
from tests.datasets import dataset

EPS = float(np.finfo(float).eps)
TAU = 0.1
Array = NDArray[np.float64]


def blocks(count: int, random: np.random.Generator) -> Blocks:
    times = np.cumsum(random.uniform(0.005, 0.02, count))
    left = np.select([np.arange(count) % 7 == 3, np.arange(count) % 7 == 6], [0.0, 0.6], 1.0)
    turns = times - 0.4 * np.diff(times, prepend=0.0)
    return Blocks(
        starts=np.arange(count),
        counts=np.ones(count),
        times=times,
        sliding=Sliding(left=left, turns=turns),
        noise=random.uniform(0.5, 2.0, count),
    )


def moves(h: float) -> Array:
    """What becomes of position and speed in a time h without a torque, (2, 2)."""
    a = np.exp(-h / TAU)
    return np.array([[1.0, TAU * (1 - a)], [0.0, a]])


def covariance(of: Blocks, ratio: float) -> Array:
    """That of a position's measured blocks, by stepping the state's covariance and keeping all cross terms."""
    count = len(of.times)
    state, cross = np.zeros((2, 2)), np.zeros((2, count))
    out = np.zeros((count, count))
    for k in range(count):
        if k:
            part, h = of.sliding.left[k], of.times[k] - of.times[k - 1]
            until = of.sliding.turns[k] - of.times[k - 1]
            step = moves(h - until) @ np.diag([1.0, part]) @ moves(until)
            s = np.linspace(0.0, h, 2001)
            reach = np.array([TAU * (1 - np.exp(-s / TAU)), np.exp(-s / TAU)])
            # What the torque adds in a tick in which the shaft turns back is small beside what it added before.
            added = np.trapezoid(reach[:, None] * reach[None, :], s) * (part > 0)
            state, cross = step @ state @ step.T + ratio * added, step @ cross
        out[k, :k] = out[:k, k] = cross[0, :k]
        out[k, k] = state[0, 0] + of.noise[k]
        cross[:, k] = state[:, 0]
    return out


@pytest.mark.parametrize("ratio", [0.0, 3.0, 3e3])
def test_the_likelihood_is_that_of_the_whole_covariance_matrix(ratio: float) -> None:
    """Two records share two parameters and have one each; one parameter is held, one has a prior."""
    random = np.random.default_rng(3)
    parts = (blocks(40, random), blocks(25, random))
    columns = tuple(random.normal(size=(len(b.times), 4)) for b in parts)
    places = (np.array([0, 1, 2]), np.array([0, 1, 3]))
    free, prior = np.array([True, True, False, True]), np.array([0.0, 5.0, 0.0, 0.0])
    near = Linearisation(
        blocks=parts,
        columns=columns,
        places=places,
        free=free,
        kind="position",
        sample_time=0.01,
        prior=prior,
    )

    trial = near.under(TAU, ratio)

    j, r, v = np.zeros((65, 4)), np.zeros(65), np.zeros((65, 65))
    for rows, part, x, place in zip((slice(0, 40), slice(40, 65)), parts, columns, places, strict=True):
        r[rows], v[rows, rows] = x[:, 0], covariance(part, ratio)
        j[rows, place] = x[:, 1:]
    j = j[:, free]
    inverse = np.linalg.inv(v)
    h = j.T @ inverse @ j + np.diag(prior[free])
    change = np.linalg.solve(h, j.T @ inverse @ r)
    left = r - j @ change
    freedom = 65 - 3
    variance = left @ inverse @ left / freedom
    deviance = freedom * np.log(variance) + np.linalg.slogdet(v)[1] + np.linalg.slogdet(h)[1]
    # The trapezoidal rule over 2000 parts is off by h²/12 · (2000 τ/h)⁻²: 1e-9 of the torque's part.
    near_enough = {"rtol": 1e-6}
    np.testing.assert_allclose(trial.change[free], change, **near_enough)
    np.testing.assert_allclose(
        trial.covariance[np.ix_(free, free)], variance * np.linalg.inv(h), **near_enough
    )
    assert trial.change[2] == 0.0
    assert not trial.covariance[2].any()
    assert trial.variance == pytest.approx(variance, rel=1e-6)
    assert trial.deviance == pytest.approx(deviance, abs=1e-5)


def test_harmonics_are_cosines_and_sines_of_the_fraction_of_a_period() -> None:
    periods = np.concatenate([np.linspace(-3.0, 3.0, 2401), 1e5 + np.linspace(0.0, 1.0, 100)])
    found = kernels.harmonics(periods, 8)
    fraction = 2 * np.pi * (periods - np.rint(periods))
    for m in range(8):
        # A rounded angle of up to 8 π, and as many steps of the recurrence.
        np.testing.assert_allclose(found[2 * m], np.cos((m + 1) * fraction), atol=100 * EPS)
        np.testing.assert_allclose(found[2 * m + 1], np.sin((m + 1) * fraction), atol=100 * EPS)


def test_a_step_leaves_out_what_cannot_move() -> None:
    """Of five one is held, one is pressed against its bound, one without effect; at a bound that it leaves, one moves."""
    random = np.random.default_rng(5)
    x = random.normal(size=(20, 5))
    x[:, 3] = 0.0
    h, g = x.T @ x, np.array([1.0, -1.0, 2.0, 1.0, 3.0])
    theta, lower, upper = np.zeros(5), np.array([-1.0, 0.0, -1.0, -1.0, 0.0]), np.ones(5)
    moves = np.array([True, True, False, True, True])
    change, reached = np.empty(5), np.empty(5)

    count, foretold, bend = kernels.damped_step(h, g, 0.1, theta, lower, upper, moves, change, reached)

    assert count == 2
    own = h[np.ix_([0, 4], [0, 4])]
    expected = np.linalg.solve(own + 0.1 * np.diag(np.diag(own)), g[[0, 4]])
    np.testing.assert_allclose(change[[0, 4]], expected, rtol=100 * EPS)
    assert not change[[1, 2, 3]].any()
    assert (reached == theta + change).all()
    assert bend == pytest.approx(change @ h @ change, rel=100 * EPS)
    assert foretold == pytest.approx(2 * change @ g - change @ h @ change, rel=100 * EPS)


def test_a_step_is_cut_at_the_bounds_and_what_it_foretells_is_of_what_is_left() -> None:
    h, g = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([4.0, 1.0])  # without bounds it is (2, 0)
    theta, change, reached = np.array([0.5, 0.25]), np.empty(2), np.empty(2)
    lower, upper = np.array([0.0, 0.0]), np.array([1.0, 1.0])

    count, foretold, bend = kernels.damped_step(
        h, g, 0.0, theta, lower, upper, np.ones(2, dtype=bool), change, reached
    )

    assert count == 2
    np.testing.assert_allclose(reached, [1.0, 0.25], atol=10 * EPS)
    np.testing.assert_allclose(change, [0.5, 0.0], atol=10 * EPS)
    assert bend == pytest.approx(0.5)  # 2 · 0.5²
    assert foretold == pytest.approx(3.5)  # 2 · 4 · 0.5 - 0.5


def test_equations_are_solved_and_where_they_leave_something_open_by_the_shortest_solution() -> None:
    random = np.random.default_rng(6)
    x = random.normal(size=(6, 6))
    a, wanted = x.T @ x, random.normal(size=6)
    solution = wanted.copy()

    solve(a, solution)

    np.testing.assert_allclose(solution, np.linalg.solve(a, wanted), rtol=1e2 * np.linalg.cond(a) * EPS)

    # Two parameters that only their sum matters of, in numbers without rounding.
    twins, wanted = np.array([[2.0, 2.0, 0.0], [2.0, 2.0, 0.0], [0.0, 0.0, 4.0]]), np.array([6.0, 6.0, 8.0])

    solve(twins, wanted)

    np.testing.assert_allclose(wanted, [1.5, 1.5, 2.0], rtol=100 * EPS)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_single_number_that_is_not_finite_is_noticed(bad: float) -> None:
    for n in range(9):
        h = np.ones((3, 3))
        h.flat[n] = bad
        assert not kernels.is_finite(h, 1.0)
    assert not kernels.is_finite(np.ones((3, 3)), bad)
    assert kernels.is_finite(np.ones((3, 3)), 1.0)


def test_what_is_kept_with_data_is_evaluated_once_and_not_handed_on_to_a_changed_copy() -> None:
    asked = []

    @keep_with_data
    def mean(data: Dataset) -> float:
        asked.append(data)
        return float(data.y.mean())

    data = dataset(seed=1, samples=100)
    moved = replace(data, y=data.y + 1.0, quantum=None)
    assert mean(data) == mean(data) == pytest.approx(mean(moved) - 1.0)
    assert [each is data for each in asked] == [True, False]
