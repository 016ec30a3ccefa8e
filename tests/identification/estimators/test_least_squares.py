"""The search for a minimum: the same with and without a Jacobian, and back over a kink."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.least_squares import (
    Layout,
    at,
    information,
    lowest,
    minimise,
    square_jacobians,
)
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.base import Chain
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
