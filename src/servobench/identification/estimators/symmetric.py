"""Compiled kernels for small symmetric matrices, such as J'J of a handful of parameters.

For these a call of LAPACK through NumPy takes several times as long as the arithmetic.
"""

from __future__ import annotations

import math

import numpy as np

from servobench.core.channels import Array
from servobench.core.compiled import compiled

_SWEEPS = 60  # convergence is quadratic: ten are more than matrices of this size need
_NEGLIGIBLE = 1e-18  # of the two elements on the diagonal: rounding has long swallowed it
_NARROW = 1e-9  # of the largest eigenvalue: a direction with a smaller one is none
_LEAST = 1e-14  # of the largest eigenvalue: what is below says nothing


@compiled
def diagonalise(a: Array, vectors: Array) -> None:
    """Turn a symmetric matrix (P, P) into its eigenvalues on the diagonal, in no order; `vectors` (P, P) gets the eigenvectors.

    Jacobi's rotations (1846), in rows and columns in turn.
    """
    size = len(a)
    vectors[:] = 0.0
    for i in range(size):
        vectors[i, i] = 1.0
    for _ in range(_SWEEPS):
        rotated = False
        for i in range(size):
            for k in range(i + 1, size):
                apart = a[i, k]
                if not abs(apart) > _NEGLIGIBLE * math.sqrt(abs(a[i, i] * a[k, k])):
                    continue
                rotated = True
                half = (a[k, k] - a[i, i]) / (2.0 * apart)
                t = math.copysign(1.0, half) / (abs(half) + math.sqrt(1.0 + half * half))
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = t * c
                a[i, i] -= t * apart
                a[k, k] += t * apart
                a[i, k] = a[k, i] = 0.0
                for n in range(size):
                    if n != i and n != k:
                        one, other = a[i, n], a[k, n]
                        a[i, n] = a[n, i] = c * one - s * other
                        a[k, n] = a[n, k] = s * one + c * other
                    one, other = vectors[n, i], vectors[n, k]
                    vectors[n, i] = c * one - s * other
                    vectors[n, k] = s * one + c * other
        if not rotated:
            return


@compiled
def invert(information: Array, out: Array) -> float:
    """Fill out (P, P) with H⁻¹ of a symmetric non-negative matrix (P, P), from scaled parameters; return ln |H|.

    A parameter without any information (a zero on the diagonal) is left out of both: its row and column are zero. Other
    directions that the data say nothing about get a huge variance.
    """
    size = len(information)
    informed = np.empty(size, dtype=np.int64)
    count = 0
    for n in range(size):
        if information[n, n] > 0.0:
            informed[count] = n
            count += 1
    out[:] = 0.0
    scale = np.empty(count)
    scaled, vectors = np.empty((count, count)), np.empty((count, count))
    for i in range(count):
        scale[i] = 1.0 / math.sqrt(information[informed[i], informed[i]])
    for i in range(count):
        for k in range(count):
            scaled[i, k] = information[informed[i], informed[k]] * scale[i] * scale[k]
    diagonalise(scaled, vectors)
    largest = 1e-300
    for n in range(count):
        largest = max(largest, scaled[n, n])
    logarithm = 0.0
    for n in range(count):
        value = max(scaled[n, n], _LEAST * largest)
        logarithm += math.log(value) - 2.0 * math.log(scale[n])
        for i in range(count):
            for k in range(count):
                out[informed[i], informed[k]] += vectors[i, n] * vectors[k, n] / value * scale[i] * scale[k]
    return logarithm


@compiled
def solve(a: Array, x: Array) -> None:
    """Replace x (P,) by the solution of A s = x for a symmetric matrix (P, P); of a singular one by the shortest of all s.

    Gauss's elimination with partial pivoting (Golub and Van Loan 2013, section 3.4), as in LAPACK. Cholesky's factors take half
    the time, but where rounding leaves them no pivot another method has to step in, and the long steps along what a matrix hardly
    determines are lost, which take a search out of a flat valley. A singular matrix is overwritten.
    """
    size = len(a)
    left, right = a.copy(), x.copy()
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if abs(left[i, k]) > abs(left[pivot, k]):
                pivot = i
        if left[pivot, k] == 0.0:
            solve_shortest(a, x)
            return
        for n in range(k, size):
            left[k, n], left[pivot, n] = left[pivot, n], left[k, n]
        right[k], right[pivot] = right[pivot], right[k]
        for i in range(k + 1, size):
            factor = left[i, k] / left[k, k]
            for n in range(k + 1, size):
                left[i, n] -= factor * left[k, n]
            right[i] -= factor * right[k]
    for i in range(size - 1, -1, -1):
        for n in range(i + 1, size):
            right[i] -= left[i, n] * x[n]
        x[i] = right[i] / left[i, i]


@compiled
def solve_shortest(a: Array, x: Array) -> None:
    """Replace x (P,) by the shortest solution of A s = x for a symmetric matrix (P, P) without negative eigenvalues.

    The matrix is overwritten; directions in which it has less than 1e-14 of its largest eigenvalue count for nothing.
    """
    vectors = np.empty_like(a)
    diagonalise(a, vectors)
    largest = 0.0
    for n in range(len(x)):
        largest = max(largest, a[n, n])
    solution = np.zeros(len(x))
    for n in range(len(x)):
        if a[n, n] > _LEAST * largest:
            along = 0.0
            for i in range(len(x)):
                along += x[i] * vectors[i, n]
            for i in range(len(x)):
                solution[i] += along / a[n, n] * vectors[i, n]
    for i in range(len(x)):
        x[i] = solution[i]


@compiled
def chi_square(x: Array, spread: Array) -> float:
    """Return x' S⁻¹ x of numbers x (P,) with covariance S (P, P), but for directions of which S has less than 1e-9."""
    values, vectors = spread.copy(), np.empty_like(spread)
    diagonalise(values, vectors)
    largest, total = 0.0, 0.0
    for n in range(len(x)):
        largest = max(largest, values[n, n])
    for n in range(len(x)):
        if values[n, n] > _NARROW * largest:
            along = 0.0
            for i in range(len(x)):
                along += x[i] * vectors[i, n]
            total += along * along / values[n, n]
    return total
