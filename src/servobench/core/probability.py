"""The normal and the χ² distribution, of numbers, without SciPy: importing that takes longer than identifying a motor."""

from __future__ import annotations

import math
from statistics import NormalDist

_FAR = -36.0  # standard deviations: below it the probability itself is too small for a number
_TERMS = 6  # of the series there: the next one is below 1e-15


def normal_below(x: float) -> float:
    """Return the probability that a standard normal number is below x, Φ(x), to the last digits at either end."""
    return 0.5 * math.erfc(-x / math.sqrt(2))


def normal_quantile(probability: float) -> float:
    """Return the x below which a standard normal number is with a probability between 0 and 1, both excluded (Wichura 1988).

    :raises statistics.StatisticsError: if the probability isn't between 0 and 1
    """
    return NormalDist().inv_cdf(probability)


def log_normal_below(x: float) -> float:
    """Return log Φ(x), also where Φ(x) is too small for a number.

    There by Φ(x) = φ(x) / |x| (1 - 1/x² + 1·3/x⁴ - 1·3·5/x⁶ ...) (Abramowitz and Stegun 1964, 26.2.12).
    """
    if x > 0:
        return math.log1p(-normal_below(-x))
    if x > _FAR:
        return math.log(normal_below(x))
    term, total = 1.0, 1.0
    for k in range(1, _TERMS + 1):
        term *= -(2 * k - 1) / x**2
        total += term
    return -0.5 * x**2 - 0.5 * math.log(2 * math.pi) - math.log(-x) + math.log(total)


def chi_square_above(value: float, freedom: int) -> float:
    """Return the probability that χ² of a whole number of degrees of freedom is above a value.

    A finite sum, with y = value / 2: e^(-y) Σ yᵏ/k! for an even number; for an odd one it begins with that of one degree,
    erfc(√y), and goes on by halves (Abramowitz and Stegun 1964, 26.4.4 and 26.4.5).

    :param value: the value, of any size; below zero the probability is 1
    :param freedom: degrees of freedom, 1 to a few
    :return: the probability; 0 where it is too small for a number
    """
    y = 0.5 * max(value, 0.0)
    if math.exp(-y) == 0.0:
        return 0.0
    if freedom % 2:
        total, power, term = math.erfc(math.sqrt(y)), 0.5, 2.0 * math.sqrt(y / math.pi) * math.exp(-y)
    else:
        total, power, term = math.exp(-y), 1.0, y * math.exp(-y)
    while power < 0.5 * freedom:
        total += term
        power += 1.0
        term *= y / power
    return total
