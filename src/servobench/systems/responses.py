"""Responses of a transfer function: step response, rise time and bandwidth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.systems.transfer_function import TransferFunction

Coefficients: TypeAlias = NDArray[np.floating[Any]]

_POINTS = 400  # among which a crossing is looked for
_APART = 1e-3  # poles nearer than this part of the largest lose more than six digits in a sum over poles
_SETTLED = 12.0  # slowest time constants; e^-12 is 6e-6 of a step


def step_response(system: TransferFunction, t: Array) -> Array:
    """Return the response (N,) to a unit step at t = 0, from rest, at times t (N,) [s]; exact at any times.

    By algebra y(t) = y(0) + Σ N(p)/(p D'(p)) (e^(pt) - 1) over the poles p of N/D; where two of them nearly meet, by a matrix
    exponential (Van Loan 1978).
    """
    later = t - system.delay
    course = _step_course(system, system.poles)
    return np.where(later >= 0, course(np.maximum(later, 0.0)), 0.0)


def rise_time(system: TransferFunction) -> float:
    """Return the time in which a step response goes from 10 to 90 % of its final value for the first time [s].

    NaN for a system that isn't stable or whose final value is zero.
    """
    poles = system.poles
    if (poles.real >= 0).any() or system.numerator[-1] == 0:
        return float("nan")
    if not len(poles):
        return 0.0
    if len(poles) == len(system.numerator) == 1:
        return float(np.log(9.0) / -poles[0].real)  # 1 - e^(pt) is at 0.1 and 0.9
    final = system.numerator[-1] / system.denominator[-1]
    course = _step_course(system, poles)
    # Spread evenly over the orders of magnitude: a fast oscillation that hardly decays rises long before it has settled.
    ends = 0.01 / float(np.abs(poles).max()), _SETTLED / float(np.abs(poles.real).min())
    t = np.concatenate([[0.0], np.geomspace(*ends, _POINTS)])
    y = course(t) / final
    low, high = (_first_time(lambda at: course(at) / final, t, y, level) for level in (0.1, 0.9))
    return high - low


def bandwidth(system: TransferFunction) -> float:
    """Return the lowest frequency at which the magnitude is 1/√2 of that at zero [rad/s].

    Infinite where it never is; NaN for a system with an integrator or without a gain at zero.
    """
    zero, one = system.numerator[-1], system.denominator[-1]
    if one == 0 or zero == 0:
        return float("nan")
    if len(system.numerator) == 1 and len(system.denominator) == 2:
        return abs(one / system.denominator[0])
    n, d = (squared_magnitude(p) for p in (system.numerator, system.denominator))
    crossings = positive_roots(np.polysub(2 * one**2 * n, zero**2 * d))
    return float(np.sqrt(crossings[0])) if len(crossings) else float("inf")


def squared_magnitude(polynomial: Sequence[float] | Coefficients) -> Array:
    """Return |P(jω)|² as the coefficients (n + 1,) of a polynomial in ω², highest power first; of a stack (M, n + 1) each."""
    p = np.asarray(polynomial, dtype=np.float64)
    return mirror(product(p, mirror(p))[..., ::2])  # P(s) P(-s) has even powers only


def mirror(polynomial: Coefficients) -> Array:
    """Return the coefficients (n + 1,) of P(-s), highest power first; of a stack of polynomials (M, n + 1) each."""
    return np.asarray(polynomial * (-1.0) ** np.arange(polynomial.shape[-1] - 1, -1, -1), dtype=np.float64)


def product(one: Coefficients, other: Coefficients) -> Array:
    """Return the product (n + k + 1,) of two polynomials (n + 1,) and (k + 1,), or of each two of stacks (M, n + 1)."""
    if one.ndim == other.ndim == 1:
        return np.asarray(np.convolve(one, other), dtype=np.float64)
    count = max(len(each) for each in (one, other) if each.ndim > 1)
    length = one.shape[-1]
    total = np.zeros((count, length + other.shape[-1] - 1))
    for k in range(other.shape[-1]):
        total[:, k : k + length] += one * other[..., k, None]
    return total


def difference(one: Coefficients, other: Coefficients) -> Array:
    """Return the difference (n + 1,) of two polynomials, n the larger of their orders, or of each two of stacks (M, n + 1)."""
    length = max(one.shape[-1], other.shape[-1])
    total = np.zeros((*one.shape[:-1], length))
    total[..., length - one.shape[-1] :] = one
    total[..., length - other.shape[-1] :] -= other
    return total


def roots(polynomials: Coefficients) -> NDArray[np.complex128]:
    """Return the roots (M, n) of polynomials (M, n + 1): eigenvalues of their companions (Horn and Johnson 1985, section 3.3).

    `numpy.roots` finds the same, of one polynomial at a time. NaN stands in the place of those that are missing where a leading
    coefficient is zero, and the last are the roots at zero.
    """
    count, length = polynomials.shape
    result = np.full((count, max(length - 1, 0)), np.nan, dtype=np.complex128)
    nonzero = polynomials != 0
    first = np.where(nonzero.any(axis=1), nonzero.argmax(axis=1), length)
    ends = list(zip(first.tolist(), (length - nonzero[:, ::-1].argmax(axis=1)).tolist(), strict=True))
    forms = set(ends)
    for start, end in forms:
        rows = [n for n, each in enumerate(ends) if each == (start, end)] if len(forms) > 1 else slice(None)
        order = end - start - 1
        if order >= 0:
            result[rows, :order] = _nonzero_roots(polynomials[rows, start:end])
            result[rows, order : order + length - end] = 0.0
    return result


def _nonzero_roots(polynomials: Coefficients) -> NDArray[Any]:
    """The same where no polynomial has a leading or trailing zero."""
    order = polynomials.shape[1] - 1
    ratios = -polynomials[:, 1:] / polynomials[:, :1]
    if order < 2:
        return ratios
    companion = np.zeros((len(polynomials), order, order))
    companion[:, 1:, :-1] = np.eye(order - 1)
    companion[:, 0] = ratios
    return np.asarray(np.linalg.eigvals(companion))


def positive_roots(polynomial: Coefficients) -> Array:
    """Return the positive real roots (K,) of a polynomial, smallest first.

    A double root is found to the root of the machine's precision only, so roots that near to the axis count as real.
    """
    places = np.roots(polynomial)
    return np.asarray(np.sort(places.real[_positive(places)]), dtype=np.float64)


def positive_roots_of_each(polynomials: Coefficients) -> Array:
    """Return the same of polynomials (M, n + 1), (M, n), with NaN behind the last of each."""
    places = roots(polynomials)
    return np.asarray(np.sort(np.where(_positive(places), places.real, np.nan), axis=1), dtype=np.float64)


def _positive(places: NDArray[Any]) -> NDArray[np.bool_]:
    return np.asarray((np.abs(places.imag) <= 1e-7 * np.abs(places)) & (places.real > 0))


def _step_course(system: TransferFunction, poles: NDArray[np.complex128]) -> Callable[[Array], Array]:
    """The step response from the end of the delay on: y(0) + Σ N(p)/D'(p) ∫ e^(px) dx where the poles p are distinct."""
    gaps = np.abs(poles[:, None] - poles[None, :])[~np.eye(len(poles), dtype=bool)]
    if gaps.size and gaps.min() <= _APART * np.abs(poles).max():
        return lambda t: _by_matrix(system, t)
    residues = np.polyval(system.numerator, poles) / np.polyval(np.polyder(system.denominator), poles)
    direct = len(system.numerator) == len(system.denominator)
    start = system.numerator[0] / system.denominator[0] if direct else 0.0
    integrator = poles == 0
    weights = residues / np.where(integrator, 1.0, poles)

    def course(t: Array) -> Array:
        modes = np.where(integrator, t[:, None], np.expm1(np.multiply.outer(t, poles)))
        return np.asarray(start + (modes @ weights).real, dtype=np.float64)

    return course


def _by_matrix(system: TransferFunction, t: Array) -> Array:
    """The same for any poles: C ∫ e^(Ax) B dx + D, the integral a block of one matrix exponential (Van Loan 1978)."""
    from scipy.linalg import expm

    # The controllable canonical form: ẋ₁ = -a·x + u, ẋₖ₊₁ = xₖ, y = c·x + d u.
    order = len(system.denominator) - 1
    a = np.array(system.denominator) / system.denominator[0]
    b = np.zeros(order + 1)
    b[order + 1 - len(system.numerator) :] = np.array(system.numerator) / system.denominator[0]
    block = np.zeros((order + 1, order + 1))
    block[0] = [*-a[1:], 1.0]
    block[1:order, : order - 1] = np.eye(order - 1)
    states = expm(block * t[:, None, None])[:, :order, order]
    return np.asarray(states @ (b[1:] - b[0] * a[1:]) + b[0], dtype=np.float64)


def _first_time(course: Callable[[Array], Array], t: Array, y: Array, level: float) -> float:
    """The first time at which a course y (N,) at t (N,) reaches a level, by regula falsi between two of the times."""
    at = int(np.argmax(y >= level))
    if at == 0:
        return 0.0
    low, high, below, above = t[at - 1], t[at], y[at - 1] - level, y[at] - level
    for _ in range(60):
        middle = high - above * (high - low) / (above - below)
        value = float(course(np.array([middle]))[0]) - level
        if abs(value) < 1e-13 or high - low < 1e-14 * high:
            return float(middle)
        # The Illinois rule: the end that stays counts half, or it would never move.
        if value < 0:
            low, below, above = middle, value, 0.5 * above
        else:
            high, above, below = middle, value, 0.5 * below
    return float(middle)
