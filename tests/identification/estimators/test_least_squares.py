"""The search for a minimum: the same with and without a Jacobian, and back over a kink."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.estimators.least_squares import (
    Layout,
    at,
    descent,
    information,
    lowest,
    minimise,
    square_jacobians,
)
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset


@pytest.mark.parametrize("name", ["first_order", "first_order_one_way", "first_order_coulomb"])
def test_the_normal_equations_of_several_records_are_the_sums_of_each(name: str) -> None:
    data = tuple(dataset(seed=seed, kind="prbs", samples=700) for seed in (1, 2, 3))
    # The last goes through a chain that does nothing, and so by way of its Jacobian.
    data = (*data[:2], replace(data[2], applied=Chain.parse("scale 1")))
    structure = STRUCTURES[name]
    layout = Layout(structure, data)
    theta = structure.guesses(data)[0]
    predictions = [structure.predict(theta[p], r) for r, p in zip(data, layout.columns(), strict=True)]
    h, g = information(layout, square_jacobians(layout, predictions)), np.zeros(len(theta))
    for record, prediction, place in zip(data, predictions, layout.columns(), strict=True):
        g[place] += prediction.jacobian.T @ (record.y - prediction.y)

    point = at(layout, theta)

    # As for one record (tests/identification/models/test_first_order.py): rounding, and what cancels within a piece.
    cost = sum(float(np.sum((r.y - p.y) ** 2)) for r, p in zip(data, predictions, strict=True))
    size = np.sqrt(np.diag(h))
    assert np.all(np.abs(point.h - h) <= 2e-11 * np.outer(size, size))
    assert np.all(np.abs(point.g - g) <= 2e-11 * size * np.sqrt(cost))
    assert point.cost == pytest.approx(cost, rel=1e-9)


@pytest.mark.parametrize("name", ["first_order_one_way", "first_order_coulomb"])
def test_a_chain_that_does_nothing_changes_no_minimum(name: str) -> None:
    data = dataset(seed=1, kind="square" if name == "first_order_one_way" else "prbs")
    structure = STRUCTURES[name]
    start = structure.guesses([data])[:2][-1]  # that at rest, where there is one
    fast = minimise(structure, [data], start)
    slow = minimise(structure, [replace(data, applied=Chain.parse("scale 1"))], start)
    # Both stop where a step is below a thousandth of a standard deviation.
    layout = Layout(structure, (data,))
    h = information(layout, square_jacobians(layout, fast.predictions))
    change = fast.theta - slow.theta
    assert change @ h @ change <= 4e-6 * fast.cost / len(data.y)
    assert fast.status == slow.status


@pytest.mark.parametrize("speed", [-1e-3, 1e-2, 1.0])
def test_a_search_comes_back_from_the_wrong_side_of_a_shaft_that_sticks(speed: float) -> None:
    """A start speed near zero is a kink of the cost: behind it the sum of squares hardly depends on it."""
    data, structure = dataset(seed=1, kind="prbs"), STRUCTURES["first_order_coulomb"]
    best = lowest(structure, [data], structure.guesses([data]))
    start = best.theta.copy()
    start[-1] = speed

    found = minimise(structure, [data], start)

    assert found.converged
    # A sum of squares within 0.01 of the residual's variance: a tenth of a standard deviation.
    assert found.cost - best.cost <= 0.01 * best.cost / len(data.y)


@pytest.mark.parametrize("name", ["first_order", "first_order_one_way", "first_order_one_way_rest"])
def test_a_step_in_the_coordinates_of_a_slow_motor_is_the_change_to_first_order(name: str) -> None:
    """For a change a tenth as large it's off by a hundredth, and K/τ changes in proportion to it."""
    structure = STRUCTURES[name]
    theta, change = np.array([50.0, 0.2, 0.3, 0.01, 1.0, 2.0]), np.array([5.0, 0.03, 0.05, 0.002, 0.1, 0.2])

    def reached(h: float) -> NDArray[np.float64]:
        return structure.move_if_slow(theta, h * change, 1.5)

    def off(h: float) -> float:
        return float(np.abs(reached(h) - theta - h * change).max())

    assert off(1e-3) == pytest.approx(1e-2 * off(1e-2), rel=0.1)
    slope = [(reached(h)[0] / reached(h)[1] - 250.0) / h for h in (0.1, 1.0)]
    assert slope[0] == pytest.approx(slope[1])


def test_a_step_in_the_coordinates_of_a_slow_motor_leaves_alone_what_is_held_and_is_no_leap() -> None:
    structure = STRUCTURES["first_order_one_way"]
    theta, change = np.array([50.0, 0.2, 0.3, 0.01, 1.0, 2.0]), np.array([5.0, 0.03, 0.05, 0.002, 0.1, 0.2])
    for held in (0, 2):
        part = np.where(np.arange(len(theta)) == held, 0.0, change)
        assert structure.move_if_slow(theta, part, 1.5)[held] == theta[held]

    far = structure.move_if_slow(theta, np.array([0.0, 10.0, 0.0, 0.0, 1.0, 0.0]), 1.5)

    # 1/τ falls to a fifth, which 0.16 s of the 10 s are to first order; the start angle goes as much of its way.
    assert far[1] == pytest.approx(5 * 0.2)
    assert far[4] == pytest.approx(1.0 + 0.016)


def one_square(late: float) -> Dataset:
    """Counts under a square wave of half a period in 0.6 time constants, that reverses as the record begins.

    The response is exact between the changes of the input, which come `late` samples later.
    """
    gain, tau, step, half, samples, quantum = 50.0, 0.187, 0.0184, 6, 336, 0.0587
    levels = (0.31, 1.68)
    angle, speed, y = 71.0, 50.0, np.empty(samples)
    moments = sorted({*map(float, range(samples + 1)), *(n + late % 1.0 for n in range(samples))})
    for now, until in pairwise(moments):
        if now == int(now):
            y[int(now)] = quantum * np.round(angle / quantum)
        driven = gain * levels[(max(int(np.floor(now - late + 1e-9)), -1) // half) % 2]
        h = step * (until - now)
        angle += driven * h + tau * (speed - driven) * -np.expm1(-h / tau)
        speed = driven + (speed - driven) * np.exp(-h / tau)
    u = np.array([levels[n // half % 2] for n in range(samples)])
    made = dataset(seed=1, u=u, samples=samples, sample_time=step, y=y)
    return replace(made, quantum=quantum, input_before=levels[1])


@pytest.mark.parametrize("late", [1.2, 1.9, 2.5, 3.1])
def test_a_motor_that_is_slower_than_its_input_is_found(late: float) -> None:
    """What explains the counts: what rounding leaves is 0.29 of one, and a twentieth more is far beyond chance."""
    data = one_square(late)
    structure = STRUCTURES["first_order_one_way"]

    found = lowest(structure, [data], structure.guesses([data]))

    assert found.cost < len(data.y) * (1.05 * 0.0587) ** 2 / 12


def test_a_search_ends_where_less_is_to_be_gained_than_it_is_worth() -> None:
    """Near a minimum the quadratic model is right: what it foretells is what is left to gain."""
    structure, data = STRUCTURES["first_order_coulomb"], (dataset(seed=1, kind="prbs"),)
    layout = Layout(structure, data)
    start = 1.02 * structure.guesses(data)[0]
    settled = descent(layout, start)
    worth = 0.01 * settled.point.cost

    rough = descent(layout, start, worth=worth)

    assert rough.converged
    assert 0.0 < rough.point.cost - settled.point.cost < worth
    assert int(rough.status.split()[2]) < int(settled.status.split()[2])


@pytest.mark.parametrize("off", [(0.6, 1.8), (2.0, 0.5)])
def test_a_search_goes_on_as_long_as_it_comes_down_by_much(off: tuple[float, float]) -> None:
    """A step at a time: the first five come down to the minimum, and are too few to see that they have."""
    data, structure = dataset(seed=1), STRUCTURES["first_order_one_way"]
    whole = minimise(structure, [data], structure.guesses([data])[0])
    start = whole.theta.copy()
    start[:2] *= off

    found = minimise(structure, [data], start, steps=1)

    assert found.converged
    assert found.cost == pytest.approx(whole.cost, rel=1e-9)


def two_starts(off: float) -> tuple[Layout, np.ndarray, np.ndarray]:
    """A record of a motor with friction, a guess for it, and a start whose gain and time constant are `off` times as large."""
    data = (dataset(seed=1, kind="prbs", samples=700),)
    structure = STRUCTURES["first_order_coulomb"]
    start = structure.guesses(data)[0]
    beside = start.copy()
    beside[:2] *= off
    return Layout(structure, data), start, beside


def test_a_search_that_comes_to_the_end_of_another_one_ends_there() -> None:
    layout, start, beside = two_starts(1.3)
    end = descent(layout, start)

    assert descent(layout, beside, ends=[end]) is end
    assert len(lowest(layout.structure, layout.data, [start, beside]).others) == 0


def test_a_search_that_stays_far_behind_another_one_is_given_up() -> None:
    """The sum of squares hardly depends on a time constant far beyond the record, and creeps there for a hundred steps."""
    layout, start, beside = two_starts(1e4)
    end, alone = descent(layout, start), descent(layout, beside)

    behind = descent(layout, beside, ends=[end])

    assert not alone.converged
    assert alone.point.cost > 1000 * end.point.cost
    assert behind.status == "far behind another start after 25 steps"
    assert not behind.converged
