"""The transfer function of a control law from the shaft's angle, as a ratio of polynomials, taken from the running law itself.

Away from the voltage's limits and at even ticks a law is linear: x⁺ = A x + B θ, u = C x + D θ. Its difference equation is
stated once, by its compiled step (`control.kernels`); A, B, C and D are that step's responses to each state alone, and to the
angle alone. From them follows, in fractions and so without rounding,

    u = -C(z) θ,   C(z) = -(C adj(zI - A) B / det(zI - A) + D)      (Faddeev and Leverrier, see Gantmacher 1959, chapter 4)

and with z = (1 + w)/(1 - w) what `SampledLaw` holds. A difference is then exactly zero at w = 0, and a sum has its pole there.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TypeAlias

import numpy as np

from servobench.core.channels import Channel, DeviceInfo
from servobench.core.errors import UsageError
from servobench.systems.control.base import Controller
from servobench.systems.control.running import Running
from servobench.systems.sampled_loop import SampledLaw, in_w

_Matrix: TypeAlias = list[list[Fraction]]
_Polynomial: TypeAlias = list[Fraction]  # highest power first
_FAR = Fraction(1, 10**7)  # beyond, the squares of the roots are further apart than eigenvalues are good to
_ROUNDING = Fraction(1, 2**50)  # of a sum of a few products, each rounded to one part in 2^53


def sampled_law(controller: Controller, sample_time: float) -> SampledLaw:
    """Return what a controller that runs every `sample_time` [s] makes of the angle, away from the limits of the voltage.

    Raises `UsageError` for gains so large that what it computes is no number.
    """
    a, b, c, d = _equations(controller.start(sample_time, _IN_RADIANS), sample_time)
    above, below = _ratio(a, b, c, d)
    while len(below) > 1 and above[-1] == 0 == below[-1]:  # samples that are kept and have no part in it
        above, below = above[:-1], below[:-1]
    numerator = in_w(above)
    # A filter by the trapezoid rule passes nothing at z = -1; the law's own products are rounded there.
    if abs(numerator[0]) <= _ROUNDING * sum(map(abs, above)):
        numerator[0] = Fraction(0)
    denominator = in_w(below)
    # A filter far faster than the ticks does nothing.
    while len(denominator) > 1 and _vanishes(numerator) and _vanishes(denominator):
        numerator, denominator = numerator[1:], denominator[1:]
    return SampledLaw(
        numerator=tuple(-float(each) for each in numerator),
        denominator=tuple(float(each) for each in denominator),
    )


def _vanishes(polynomial: _Polynomial) -> bool:
    """Whether a polynomial in w has a root so far out that it turns the phase by 1e-7 rad only where w is as large as j."""
    return abs(polynomial[0]) <= _FAR * max(map(abs, polynomial))


_IN_RADIANS = DeviceInfo(
    name="motor",
    channels=(
        Channel(name="voltage", unit="V"),
        Channel(name="counts", unit="counts", counts_per_rev=2 * math.pi),  # a count is a radian
    ),
)


def _equations(
    state: Running, sample_time: float
) -> tuple[_Matrix, list[Fraction], list[Fraction], Fraction]:
    """A, B, C and D of a law, of the states that the angle reaches and the voltage hangs on."""
    from servobench.systems.control.kernels import BIAS, SEEN, TIME, UNDER_WAY

    law, p, start = state
    names = [n for n in range(len(start)) if n not in {SEEN, TIME, BIAS}]

    def answer(to: int | None) -> tuple[list[Fraction], Fraction]:
        x = start.copy()
        x[:] = 0.0
        x[SEEN] = UNDER_WAY
        if to is not None:
            x[to] = 1.0
        x, voltage = law(x, p, 0.0, 1 if to is None else 0, sample_time)
        if not (np.isfinite(x).all() and math.isfinite(voltage)):
            raise UsageError(
                f"margins: the law puts out {voltage:g} V for a radian, and its states are up to {np.abs(x).max():g}; expected "
                "numbers: take smaller gains"
            )
        return [Fraction(float(x[n])) for n in names], Fraction(float(voltage))

    columns = [answer(n) for n in names]
    b, d = answer(None)
    a = [[column[row] for column, _ in columns] for row in range(len(names))]
    c = [voltage for _, voltage in columns]
    parts = range(len(names))
    reached = _spread({n for n in parts if b[n]}, {n: {i for i in parts if a[i][n]} for n in parts})
    observed = _spread({n for n in parts if c[n]}, {n: {j for j in parts if a[n][j]} for n in parts})
    states = sorted(reached & observed)
    return [[a[i][j] for j in states] for i in states], [b[i] for i in states], [c[i] for i in states], d


def _spread(start: set[int], leads: dict[int, set[int]]) -> set[int]:
    """All that a start leads to, itself included."""
    reachable, ahead = set(start), list(start)
    while ahead:
        new = leads[ahead.pop()] - reachable
        reachable |= new
        ahead += new
    return reachable


def _ratio(a: _Matrix, b: list[Fraction], c: list[Fraction], d: Fraction) -> tuple[_Polynomial, _Polynomial]:
    """C adj(zI - A) B + D det(zI - A), and det(zI - A), by Faddeev's and Leverrier's recursion."""
    size = range(len(b))
    below = [Fraction(1)]
    above = [d]
    # M₁ = I, p_k = -tr(A M_k)/k, M_k+1 = A M_k + p_k I; adj(zI - A) = Σ M_k z^(n-k).
    m = [[Fraction(int(i == j)) for j in size] for i in size]
    for k in range(1, len(b) + 1):
        through = sum((c[i] * m[i][j] * b[j] for i in size for j in size), Fraction(0))
        am = [[sum((a[i][l] * m[l][j] for l in size), Fraction(0)) for j in size] for i in size]
        coefficient = -sum((am[i][i] for i in size), Fraction(0)) / k
        m = [[am[i][j] + (coefficient if i == j else 0) for j in size] for i in size]
        below.append(coefficient)
        above.append(through + d * coefficient)
    return above, below
