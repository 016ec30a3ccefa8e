"""Poles with their multiplicity, and how exactly the coefficients determine each.

A root of multiplicity m is found by any root finder to the m-th root of its precision only: -1 three times comes out as three
roots 1e-5 apart. The coefficients decide whether such close roots are one: is there a polynomial whose coefficients differ by
no more than their rounding, with an m-fold root there? A root of multiplicity m of D is a simple root of D^(m-1), and found as
exactly as a simple one can be (Zeng, Math. Comp. 74, 2005).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Coefficients: TypeAlias = NDArray[np.floating[Any]]
_STEPS = 20  # of Newton's method, which needs three or four


@dataclass(frozen=True, kw_only=True)
class Pole:
    """A root of a polynomial, `at` [1/s], its `multiplicity`, and the `uncertainty` [1/s] that coefficients' rounding makes."""

    at: complex
    multiplicity: int
    uncertainty: float

    @property
    def side(self) -> int:
        """-1 in the left half-plane, 1 in the right, 0 if it can't be distinguished from the imaginary axis."""
        return 0 if abs(self.at.real) <= self.uncertainty else (1 if self.at.real > 0 else -1)


def poles_of(polynomial: Sequence[float] | Coefficients) -> tuple[Pole, ...]:
    """Return the roots of a polynomial (highest power first), slowest first; a complex one and its conjugate are two.

    Roots that no polynomial within the rounding of the coefficients tells apart are one of higher multiplicity; a real part or an
    imaginary part within that rounding is exactly zero. Roots at zero are counted by the zeros at the end.
    """
    p = np.trim_zeros(np.asarray(polynomial, dtype=np.float64), "f")
    body = np.trim_zeros(p, "b")
    poles = [Pole(at=0j, multiplicity=len(p) - len(body), uncertainty=0.0)] if len(body) < len(p) else []
    roots = [complex(root) for root in np.roots(body)]
    while roots:
        pole, group = _largest(body, roots)
        mirror = pole.at.conjugate()
        for root in group:
            roots.remove(root)
        poles.append(pole)
        if pole.at.imag != 0:  # of a real polynomial the conjugate is a root as often
            poles.append(Pole(at=mirror, multiplicity=pole.multiplicity, uncertainty=pole.uncertainty))
            for root in _nearest(roots, mirror, pole.multiplicity):
                roots.remove(root)
    return tuple(sorted(poles, key=lambda pole: (abs(pole.at), -pole.at.imag)))


def multiplicity_at(polynomial: Sequence[float] | Coefficients, s: complex) -> int:
    """Return how many times a polynomial (highest power first) has the root s, within the rounding of its coefficients."""
    p = np.trim_zeros(np.asarray(polynomial, dtype=np.float64), "f")
    count = 0
    while count < len(p) - 1 and abs(np.polyval(np.polyder(p, count), s)) <= _rounding(p, count, s):
        count += 1
    return count


def _largest(p: Coefficients, roots: list[complex]) -> tuple[Pole, list[complex]]:
    """The pole that the first root belongs to, of the largest multiplicity that the coefficients allow, and its roots."""
    for m in range(len(roots), 1, -1):
        group = _nearest(roots, roots[0], m)
        centre = complex(np.mean(group))
        spread = max(abs(root - centre) for root in group)
        at = _newton(np.polyder(p, m - 1), centre)
        pole = _snap(p, m, at)
        # Roots that happen to come out equal have no spread, and their mean is off by its rounding all the same. A root of the
        # derivative that belongs to another group has others next to it.
        own = abs(at - centre) <= spread + pole.uncertainty and {*group} == {*_nearest(roots, at, m)}
        if own and multiplicity_at(p, pole.at) >= m:
            return pole, group
    return _snap(p, 1, _newton(p, roots[0])), roots[:1]


def _nearest(roots: list[complex], at: complex, count: int) -> list[complex]:
    return sorted(roots, key=lambda root: abs(root - at))[:count]


def _snap(p: Coefficients, m: int, at: complex) -> Pole:
    """A pole with its uncertainty: of the simple root of D^(m-1), to first order; parts below it are zero."""
    slope = abs(np.polyval(np.polyder(p, m), at))
    moved = float(_rounding(p, m - 1, at) / slope) if slope else 0.0
    real = 0.0 if abs(at.real) <= moved else at.real
    imaginary = 0.0 if abs(at.imag) <= moved else at.imag
    return Pole(at=complex(real, imaginary), multiplicity=m, uncertainty=moved)


def _newton(p: Coefficients, start: complex) -> complex:
    """The root of a polynomial next to a start that is nearly one; the start itself where the steps don't shrink."""
    at, slope, before = start, np.polyder(p), np.inf
    for _ in range(_STEPS):
        by = complex(np.polyval(slope, at))
        step = complex(np.polyval(p, at)) / by if by else 0j
        if abs(step) >= before:
            break
        at, before = at - step, abs(step)
        if step == 0:
            break
    return at


def _rounding(p: Coefficients, order: int, s: complex) -> float:
    """The error of the value of a derivative of a polynomial at s, by rounding.

    Each coefficient is off by half a unit in the last place, times the products that made it: a product of n factors costs n
    roundings, its evaluation 2 n more (Higham 2002, section 5.1).
    """
    n = len(p) - 1
    size = np.polyder(np.abs(p), order)
    return float(3 * max(n, 1) * np.finfo(np.float64).eps * np.polyval(size, abs(s)))
