"""Small symmetric matrices: against LAPACK, and against what follows from how they were made."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.identification.estimators.symmetric import chi_square, diagonalise, invert

EPS = float(np.finfo(float).eps)


def of_columns(size: int, scale: float = 0.0) -> np.ndarray:
    """X'X of random columns whose lengths differ by up to 10^±scale."""
    random = np.random.default_rng(size)
    columns = random.normal(size=(40, size)) * 10.0 ** random.uniform(-scale, scale, size)
    return np.asarray(columns.T @ columns)


@pytest.mark.parametrize("size", [1, 2, 3, 6, 12])
def test_eigenvalues_are_lapacks_and_eigenvectors_bring_the_matrix_back(size: int) -> None:
    h = of_columns(size)
    values, vectors = h.copy(), np.empty_like(h)
    diagonalise(values, vectors)

    rounding = 100 * size * EPS * np.linalg.norm(h)
    np.testing.assert_allclose(np.sort(np.diag(values)), np.linalg.eigvalsh(h), atol=rounding)
    np.testing.assert_allclose(vectors * np.diag(values) @ vectors.T, h, atol=rounding)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(size), atol=100 * size * EPS)


@pytest.mark.parametrize("size", [1, 2, 3, 6, 12])
def test_the_inverse_and_the_determinant_are_right_in_any_units(size: int) -> None:
    h = of_columns(size, scale=6.0)
    out = np.empty_like(h)
    logarithm = invert(h, out)

    scale = 1 / np.sqrt(np.diag(h))
    condition = np.linalg.cond(h * np.outer(scale, scale))
    np.testing.assert_allclose(
        (out / np.outer(scale, scale)) @ (h * np.outer(scale, scale)),
        np.eye(size),
        atol=100 * size * EPS * condition,
    )
    assert logarithm == pytest.approx(np.linalg.slogdet(h)[1], abs=100 * size * EPS * condition)


def test_a_parameter_without_information_is_left_out_of_inverse_and_determinant() -> None:
    out = np.full((3, 3), np.nan)
    logarithm = invert(np.diag([4.0, 0.0, 2.0]), out)

    np.testing.assert_allclose(out, np.diag([0.25, 0.0, 0.5]), rtol=4 * EPS)
    assert logarithm == pytest.approx(np.log(8.0), rel=4 * EPS)


def test_a_direction_that_is_not_reported_gets_a_huge_variance() -> None:
    """Of two equal columns only the sum is told: the other direction is taken for told to 1e-14 of it."""
    out = np.empty((2, 2))
    invert(np.array([[1.0, 1.0], [1.0, 1.0]]), out)

    apart, together = np.array([1.0, -1.0]) / np.sqrt(2), np.array([1.0, 1.0]) / np.sqrt(2)
    assert apart @ out @ apart == pytest.approx(1 / (2 * 1e-14), rel=1e-6)
    # A product with entries of 1e14 is right to their rounding.
    assert together @ out @ together == pytest.approx(0.5, abs=0.1)


def test_chi_square_counts_only_directions_with_a_spread() -> None:
    h = of_columns(4)
    x = np.arange(1.0, 5.0)
    condition = np.linalg.cond(h)
    assert chi_square(x, h) == pytest.approx(float(x @ np.linalg.solve(h, x)), rel=100 * EPS * condition)
    # (1, 0) has 1/√2 along (1, 1), whose eigenvalue is 2; along (1, -1) there is no spread.
    assert chi_square(np.array([1.0, 0.0]), np.ones((2, 2))) == pytest.approx(0.25, rel=10 * EPS)
