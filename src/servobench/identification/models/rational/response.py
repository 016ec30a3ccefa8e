"""The exact response of a rational transfer function to a held and to a sampled input, with the signals for its derivatives.

All lines are read off one chain of N integrators with feedback, s^N + α_{N-1} s^(N-1) + ... + α₀, in a time that is scaled by the
largest root bound σ of that polynomial, so that neither the coefficients nor the powers of s run out of range.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array

_FAR = 1e100  # squares of larger numbers overflow
_SLOTS = 32  # how many lengths of pieces may have a matrix of their own


@dataclass(frozen=True, kw_only=True, eq=False)
class Pieces:
    """A record cut where its held input changes: `length` (E,) [s], `inputs` (E, I), and the `sample` at each end, -1 for none.

    `steps` (D,) are lengths that come often, and `which` (E,) says which of them a piece has, -1 for none.
    `samples` is how many samples there are, `at_start` the input just before the first.
    """

    length: Array
    inputs: Array
    sample: NDArray[np.int64]
    steps: Array
    which: NDArray[np.int64]
    samples: int
    at_start: float = 0.0


def hold_pieces(t_in: Array, u: Array, before: float, t_out: Array, delay: float) -> Pieces:
    """Return the pieces of a record whose input u (N,) holds from t_in + delay (N,) on, and is sampled at t_out (M,) [s]."""
    from servobench.identification.models.rational import kernels

    room = len(t_in) + len(t_out)
    length, held, sample = np.empty(room), np.empty(room), np.empty(room, dtype=np.int64)
    count = kernels.segments(t_in, u, before, t_out, delay, length, held, sample)
    return _sort_pieces(t_out, length[:count], held[:count, None], sample[:count], float(held[0]))


def linear_pieces(t: Array, x: Array) -> Pieces:
    """Return the pieces of a signal x (M,) that is linear between its samples at t (M,) [s]: inputs are value and slope."""
    length = np.diff(t, prepend=t[:1])
    rise = np.diff(x, prepend=x[:1])
    slope = np.divide(rise, length, out=np.zeros(len(t)), where=length > 0)
    start = np.concatenate([x[:1], x[:-1]])
    return _sort_pieces(t, length, np.column_stack([start, slope]), np.arange(len(t)), 0.0)


def _sort_pieces(
    t: Array, length: Array, inputs: Array, sample: NDArray[np.int64], at_start: float
) -> Pieces:
    from servobench.identification.models.rational import kernels

    steps, which = np.empty(_SLOTS), np.empty(len(length), dtype=np.int64)
    resolution = 4 * np.finfo(float).eps * float(np.abs(t).max(initial=0.0))
    step_count = kernels.common(length, resolution, _SLOTS, steps, which)
    return Pieces(
        length=length,
        inputs=np.ascontiguousarray(inputs),
        sample=sample,
        steps=steps[:step_count],
        which=which,
        samples=len(t),
        at_start=at_start,
    )


def root_bound(feedback: Array) -> float:
    """Return σ = max |α_{N-i}|^(1/i) of s^N + α_{N-1} s^(N-1) + ... + α₀; no root is larger than 2 σ (Fujiwara 1916).

    `feedback` (N,) holds the α, lowest power first.
    """
    powers = 1.0 / np.arange(len(feedback), 0, -1)
    return float(np.max(np.abs(feedback) ** powers)) or 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Response:
    """Signals at the samples (M, N each), for A(s) = s^N + Σ α_k s^k; column k is the line with s^k in its numerator.

    `forced` s^k/A u, `free` the impulse responses of s^k/A, `twice` s^k/A y with y = Σ b_k forced_k + Σ c_k free_k;
    `slope` (M,) is s^N/A u.
    """

    forced: Array
    free: Array
    twice: Array
    slope: Array


def response(feedback: Array, forcing: Array, start: Array, pieces: Pieces) -> Response:
    """Return the response for α, b and c (N,) each, lowest power first, to a held input.

    α, b and c are `feedback`, `forcing` and `start`; time in s.
    """
    n = len(feedback)
    sigma = root_bound(feedback)
    # In the time σ t: α_k σ^(k-N), b_k σ^(k-N), c_k σ^(k-N+1); see `Response` for what each multiplies.
    scale = sigma ** (np.arange(n) - float(n))
    alpha = feedback * scale
    field = np.zeros((3 * n + 1, 3 * n + 1))  # row: effect on, column: effect of
    for block in range(3):
        _companion(field, block * n, alpha)
    field[n - 1, 3 * n] = 1.0
    drive = np.concatenate([forcing * scale, start * scale * sigma])
    size = (
        float(np.abs(drive).max()) or 1.0
    )  # taken out, or the gain's unit would decide on the length of the series
    field[3 * n - 1, : 2 * n] = drive / size
    x = np.zeros(3 * n + 1)
    x[2 * n - 1] = 1.0
    out = _march(field, sigma, pieces, x)
    forced = out[:, :n]
    return Response(
        forced=forced * scale,
        free=out[:, n : 2 * n] * (scale * sigma),
        twice=out[:, 2 * n : 3 * n] * (scale * size),
        slope=out[:, 3 * n] - forced @ alpha,
    )


def filter_derivatives(feedback: Array, pieces: Pieces) -> Array:
    """Return s^k/A x (M, N), k = 0..N-1, of a signal that is linear between its samples, from rest."""
    n = len(feedback)
    sigma = root_bound(feedback)
    scale = sigma ** (np.arange(n) - float(n))
    field = np.zeros((n + 2, n + 2))
    _companion(field, 0, feedback * scale)
    field[n - 1, n] = 1.0
    field[n, n + 1] = 1.0 / sigma
    return _march(field, sigma, pieces, np.zeros(n + 2))[:, :n] * scale


def _companion(field: Array, at: int, alpha: Array) -> None:
    n = len(alpha)
    field[at : at + n - 1, at + 1 : at + n] = np.eye(n - 1)
    field[at + n - 1, at : at + n] = -alpha


def _march(field: Array, sigma: float, pieces: Pieces, x: Array) -> Array:
    """The states (M, S) at the samples of x' = field x, the times scaled by σ; NaN where they run away."""
    from servobench.identification.models.rational import kernels

    out = np.empty((pieces.samples, len(x)))
    transposed = np.ascontiguousarray(field.T)
    length, steps = sigma * pieces.length, sigma * pieces.steps
    kernels.march(transposed, steps, pieces.which, length, pieces.inputs, pieces.sample, x, out)
    if not np.abs(out).max(initial=0.0) < _FAR:
        out[:] = np.nan
    return out
