"""The exponential of a small matrix, without SciPy, whose import takes longer than identifying a motor."""

from __future__ import annotations

import math

import numpy as np

from servobench.core.channels import Array

_SIZE, _TERMS = 0.25, 12  # of the series: at that size the next term is below 1e-17


def matrix_exponential(matrix: Array) -> Array:
    """Return e^A of a square matrix A (N, N), N a few: (Σ Bᵏ / k!)^(2^s) with B = A / 2^s (Moler and Van Loan 2003, method 3).

    s follows from the size of A's powers, not of A: where units make one entry large, its norm says little, and each squaring
    too many costs accuracy (Al-Mohy and Higham 2009, theorem 4.2).

    :param matrix: A, (N, N)
    :return: e^A, (N, N); all NaN where A⁵ is beyond what a number can be
    """
    with np.errstate(over="ignore", invalid="ignore"):
        fourth = np.linalg.matrix_power(matrix, 4)
        fifth = fourth @ matrix
    if not np.isfinite(fifth).all():
        return np.full(matrix.shape, np.nan)
    size = max(np.linalg.norm(fourth, 1) ** (1 / 4), np.linalg.norm(fifth, 1) ** (1 / 5))
    halvings = max(0, math.ceil(math.log2(size / _SIZE))) if size > 0 else 0
    small = matrix / 2.0**halvings
    result = identity = np.eye(len(matrix))
    for k in range(_TERMS, 0, -1):
        result = identity + small @ result / k
    for _ in range(halvings):
        result = result @ result
    return np.asarray(result, dtype=np.float64)
