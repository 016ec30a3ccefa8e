"""Compiled kernels of the rational structures: the events of a record, and the exact response of a linear system between them.

The states of a system x' = F x include its held inputs, so e^(F h) covers a piece of length h. Frequent lengths have their
matrix computed once. The others are split as h = q h₀ + r: matrices e^(F h₀ 2^k) for the bits of q, and for r a Taylor series,
exact to rounding because |F| h₀ <= 1. So irregular times cost a few times as much, instead of a matrix exponential each.
(Scaling and squaring: Moler and Van Loan 2003, method 3.)

Times and lengths h are in s.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.compiled import compiled

_TERMS = 18  # 1/19! is 1e-17
_SAME = 1e-9  # lengths of segments that differ by less, relatively, are the same but for the rounding of the times


@compiled
def segments(
    t_in: Array,
    u: Array,
    u_before: float,
    t_out: Array,
    delay: float,
    length: Array,
    held: Array,
    sample: NDArray[np.int64],
) -> int:
    """Cut the time from t_out[0] on at samples of the output (M,) and changes of the delayed input (N,); return how many pieces.

    Fills for each piece its `length` [s], the input `held` through it, and the `sample` at its end, -1 where it ends at a change.
    All three need room for M + N. The first piece is of length zero and ends at sample 0: a sample is latched before an input of
    the same instant acts.
    """
    now = t_out[0]
    v = u_before
    k = 0
    while k < len(u) and t_in[k] + delay < now:
        v = u[k]
        k += 1
    pieces = 0
    for m in range(len(t_out)):
        while True:
            while k < len(u) and u[k] == v:
                k += 1
            if k >= len(u) or t_in[k] + delay >= t_out[m]:
                break
            length[pieces], held[pieces], sample[pieces] = t_in[k] + delay - now, v, -1
            now = t_in[k] + delay
            v = u[k]
            pieces += 1
            k += 1
        length[pieces], held[pieces], sample[pieces] = t_out[m] - now, v, m
        now = t_out[m]
        pieces += 1
    return pieces


@compiled
def common(length: Array, resolution: float, often: int, steps: Array, which: NDArray[np.int64]) -> int:
    """Find lengths (E,) that come at least `often` times: `steps` (D,) gets them, `which` (E,) the place of each one's, or -1.

    Returns how many there are; `resolution` [s] is what the rounding of the times may make of a length.
    """
    count = np.zeros(len(steps), dtype=np.int64)
    distinct_count = 0
    last = 0
    for e in range(len(length)):
        h = length[e]
        tolerance = _SAME * h + resolution
        which[e] = -1
        if distinct_count > 0 and abs(h - steps[last]) <= tolerance:
            which[e] = last
        else:
            for d in range(distinct_count):
                if abs(h - steps[d]) <= tolerance:
                    which[e] = d
                    last = d
                    break
        if which[e] < 0 and distinct_count < len(steps):
            steps[distinct_count] = h
            which[e] = distinct_count
            last = distinct_count
            distinct_count += 1
        if which[e] >= 0:
            count[which[e]] += 1
    place = np.full(len(steps), -1)
    frequent_count = 0
    for d in range(distinct_count):
        if count[d] >= often:
            steps[frequent_count] = steps[d]
            place[d] = frequent_count
            frequent_count += 1
    for e in range(len(length)):
        if which[e] >= 0:
            which[e] = place[which[e]]
    return frequent_count


@compiled
def times(a: Array, x: Array, y: Array) -> None:
    """Set y (S,) to A x, where `a` (S, S) is A transposed: row j is what x[j] adds."""
    size = len(x)
    for i in range(size):
        y[i] = 0.0
    for j in range(size):
        xj = x[j]
        if xj != 0.0:
            for i in range(size):
                y[i] += a[j, i] * xj


@compiled
def advance(field: Array, powers: Array, h0: float, h: float, x: Array, term: Array, sum_: Array) -> None:
    """Let x (S,) become e^(F h) x. `field` is F transposed, `powers` (K, S, S) are the e^(F h₀ 2^k), transposed too."""
    size = len(x)
    whole = math.floor(h / h0)
    rest = h - whole * h0
    if rest > 0.0:
        for i in range(size):
            sum_[i] = x[i]
        for n in range(1, _TERMS + 1):
            times(field, x, term)
            factor = rest / n
            for i in range(size):
                x[i] = term[i] * factor
                sum_[i] += x[i]
        for i in range(size):
            x[i] = sum_[i]
    for k in range(len(powers)):
        if whole % 2.0 == 1.0:
            times(powers[k], x, term)
            for i in range(size):
                x[i] = term[i]
        whole = math.floor(whole / 2.0)


@compiled
def unit_length(field: Array) -> float:
    """Return h₀ = 1/|F| in the norm of the largest column sum, for `field` (S, S), F transposed."""
    norm = 0.0
    for j in range(len(field)):
        total = 0.0
        for i in range(field.shape[1]):
            total += abs(field[j, i])
        norm = max(norm, total)
    return 1.0 / max(norm, 1e-300)


@compiled
def powers_by_doubling(field: Array, h0: float, longest: float) -> Array:
    """Return the e^(F h₀ 2^k), transposed, (K, S, S): as many as it takes for lengths up to `longest`."""
    size, doublings = len(field), 0
    while doublings < 60 and h0 * 2.0**doublings <= longest:
        doublings += 1
    powers = np.empty((doublings, size, size))
    term, sum_ = np.empty(size), np.empty(size)
    for k in range(doublings):
        for j in range(size):
            column = np.zeros(size)
            if k > 0:
                times(powers[k - 1], powers[k - 1, j], column)
            else:
                column[j] = 1.0
                # Half of h₀ twice: h₀ itself would need the matrix that is being made.
                advance(field, powers[:0], h0, 0.5 * h0, column, term, sum_)
                advance(field, powers[:0], h0, 0.5 * h0, column, term, sum_)
            powers[k, j] = column
    return powers


@compiled
def transitions(field: Array, powers: Array, h0: float, steps: Array) -> Array:
    """Return e^(F h), transposed, for each of the lengths `steps` (D,), shape (D, S, S)."""
    size = len(field)
    known = np.empty((len(steps), size, size))
    term, sum_ = np.empty(size), np.empty(size)
    for d in range(len(steps)):
        for j in range(size):
            column = np.zeros(size)
            column[j] = 1.0
            advance(field, powers, h0, steps[d], column, term, sum_)
            known[d, j] = column
    return known


@compiled
def march(
    field: Array,
    steps: Array,
    which: NDArray[np.int64],
    length: Array,
    inputs: Array,
    sample: NDArray[np.int64],
    x: Array,
    out: Array,
) -> None:
    """Carry x (S,) through pieces of a `length` (E,) each with the last I states set to `inputs` (E, I); fill `out` (M, S).

    `field` (S, S) is F transposed; `steps` (D,) are the lengths that come often, `which` (E,) says which of them a piece has.
    `sample` (E,) is the row of `out` that holds x at the end of a piece, -1 for none.
    """
    size, held = len(x), inputs.shape[1]
    h0 = unit_length(field)
    longest = 0.0
    for each in length:
        longest = max(longest, each)
    powers = powers_by_doubling(field, h0, longest)
    known = transitions(field, powers, h0, steps)
    term, sum_ = np.empty(size), np.empty(size)
    for e in range(len(length)):
        for i in range(held):
            x[size - held + i] = inputs[e, i]
        if which[e] >= 0:
            times(known[which[e]], x, term)
            for i in range(size):
                x[i] = term[i]
        elif length[e] > 0.0:
            advance(field, powers, h0, length[e], x, term, sum_)
        if sample[e] >= 0:
            for i in range(size):
                out[sample[e], i] = x[i]


@compiled
def products(z: Array, w: Array, out: Array) -> None:
    """Set out (P, Q) to z'w for tall z (M, P) and w (M, Q); with so few columns a library's threads cost more than they save."""
    out[:] = 0.0
    for n in range(z.shape[0]):
        for i in range(z.shape[1]):
            for j in range(w.shape[1]):
                out[i, j] += z[n, i] * w[n, j]


@compiled
def triangle(columns: Array, r: Array) -> None:
    """Fill r (K, K) with the upper triangle of the QR factors of a tall matrix, given by its columns (K, M), which are used up.

    Householder's reflections, as LAPACK does them; see `products` for why it isn't left to that.
    """
    count, rows = columns.shape
    for k in range(count):
        x = columns[k]
        norm = 0.0
        for i in range(k, rows):
            norm += x[i] * x[i]
        norm = math.sqrt(norm)
        pivot = x[k] if k < rows else 0.0
        r[k, k] = -math.copysign(norm, pivot)
        if norm > 0.0:
            x[k] = pivot - r[k, k]
            scale = 1.0 / (norm * (norm + abs(pivot)))
            for j in range(k + 1, count):
                y = columns[j]
                product = 0.0
                for i in range(k, rows):
                    product += x[i] * y[i]
                for i in range(k, rows):
                    y[i] -= product * scale * x[i]
        for j in range(k + 1, count):
            r[k, j] = columns[j, k] if k < rows else 0.0
