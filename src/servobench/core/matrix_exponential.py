"""The exponential of small matrices, without SciPy, whose import takes longer than identifying a motor."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array

_SIZE, _TERMS = 0.25, 12  # of the series: at that size the next term is below 1e-17


def matrix_exponential(matrix: Array) -> Array:
    """Return e^A of a square matrix A (N, N), N a few: (Σ Bᵏ / k!)^(2^s) with B = A / 2^s (Moler and Van Loan 2003, method 3).

    s follows from the size of A's powers, not of A: where units make one entry large, its norm says little, and each squaring
    too many costs accuracy (Al-Mohy and Higham 2009, theorem 4.2).

    :param matrix: A, (N, N), or a stack of such matrices, (M, N, N), each with its own s
    :return: e^A, of the same shape; all NaN where A⁵ is beyond what a number can be
    """
    with np.errstate(over="ignore", invalid="ignore"):
        second = matrix @ matrix
        fourth = second @ second
        fifth = fourth @ matrix
    finite = np.isfinite(fifth).all(axis=(-2, -1), keepdims=True)
    if not finite.all():
        exponential = matrix_exponential(np.where(finite, matrix, 0.0))
        return np.where(finite, exponential, np.nan)
    size = np.maximum(_norm(fourth) ** (1 / 4), _norm(fifth) ** (1 / 5))
    halvings = np.ceil(np.log2(np.maximum(size / _SIZE, 1.0)))
    small = matrix / 2.0**halvings
    result = identity = np.eye(matrix.shape[-1])
    for k in range(_TERMS, 0, -1):
        result = identity + small @ result / k
    with np.errstate(over="ignore", invalid="ignore"):
        for n in range(int(halvings.max(initial=0.0))):
            result = np.where(n < halvings, result @ result, result)
    return np.asarray(result, dtype=np.float64)


def _norm(matrix: Array) -> Array:
    """The largest sum of a column's sizes, of each matrix (…, N, N), as (…, 1, 1)."""
    return np.asarray(np.abs(matrix).sum(axis=-2, keepdims=True).max(axis=-1, keepdims=True))
