"""The exponential of a matrix, beside SciPy's and beside its series in decimal numbers."""

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest
from scipy.linalg import expm

from servobench.core.channels import Array
from servobench.core.matrix_exponential import matrix_exponential

EPS = np.finfo(float).eps


def by_decimals(matrix: Array) -> Array:
    """The series of A / 2^s in numbers of 60 digits, squared s times."""
    with localcontext() as context:
        context.prec = 60
        halvings = 2 + max(0, math.ceil(math.log2(np.linalg.norm(matrix, 1) or 1.0)))
        small = np.array([[Decimal(float(x)) / 2**halvings for x in row] for row in matrix], dtype=object)
        one = np.array([[Decimal(int(m == n)) for n in range(len(matrix))] for m in range(len(matrix))])
        total, term = one, one
        for k in range(1, 45):
            term = term.dot(small) / k
            total = total + term
        for _ in range(halvings):
            total = total.dot(total)
        return np.array(total.tolist(), dtype=np.float64)


def a_motor(rng: np.random.Generator) -> Array:
    """h A of a motor with a winding, its voltage and its friction torque as two more states, over all that people own."""
    r, inertia, h = 10 ** rng.uniform((-1, -7, -4.5), (1.5, -2, -1.5))
    inductance = max(r * 10 ** rng.uniform(-4.5, -1.5), r * h / 30)
    k, b = 10 ** rng.uniform((-3, -7), (0, -2))
    a = np.zeros((5, 5))
    a[0] = [-r / inductance, -k / inductance, 0, 1 / inductance, 0]
    a[1] = [k / inertia, -b / inertia, 0, 0, -1 / inertia]
    a[2, 1] = 1
    return np.asarray(h * a)


def errors(matrix: Array) -> tuple[float, float]:
    """The largest relative error of an entry that isn't zero, of ours and of SciPy's."""
    true = by_decimals(matrix)
    there = true != 0
    ours, theirs = (
        np.abs(each(matrix) - true)[there] / np.abs(true[there]) for each in (matrix_exponential, expm)
    )
    return float(ours.max()), float(theirs.max())


def test_each_entry_of_a_motor_is_as_near_to_the_decimal_series_as_scipys() -> None:
    rng = np.random.default_rng(8)
    ours, theirs = np.array([errors(a_motor(rng)) for _ in range(60)]).T
    assert np.median(ours) <= 8 * EPS
    assert np.quantile(ours, 0.9) <= np.quantile(theirs, 0.9)
    # A squaring doubles a relative error, and 30 electrical time constants in a tick are seven of them; where the entries of one
    # matrix are so far apart that this isn't enough, it isn't for SciPy either.
    assert (ours <= np.maximum(2**7 * theirs, 2**7 * 12 * EPS)).all()


@pytest.mark.parametrize(
    ("matrix", "expected"),
    [
        ([[0.0]], [[1.0]]),
        ([[-300.0]], [[math.exp(-300)]]),
        ([[0.0, 1e9], [0.0, 0.0]], [[1.0, 1e9], [0.0, 1.0]]),
        ([[0.0, -math.pi], [math.pi, 0.0]], [[-1.0, 0.0], [0.0, -1.0]]),
        ([[-2.0, 1.0], [0.0, -2.0]], [[math.exp(-2), math.exp(-2)], [0.0, math.exp(-2)]]),
    ],
)
def test_an_exponential_that_algebra_knows(matrix: list[list[float]], expected: list[list[float]]) -> None:
    # Eleven squarings of the largest here, and twelve terms.
    assert matrix_exponential(np.array(matrix)) == pytest.approx(
        np.array(expected), rel=2**11 * 12 * EPS, abs=40 * EPS
    )


@pytest.mark.parametrize("entry", [np.inf, np.nan, 1e200])
def test_what_is_beyond_numbers_is_no_number(entry: float) -> None:
    assert np.isnan(matrix_exponential(np.array([[entry, 1.0], [0.0, 1.0]]))).all()
