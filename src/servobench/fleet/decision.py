"""Pass, fail or undecided: a value with its interval compared with limits, and the risks of saying so.

Sources: JCGM 106:2012, *The role of measurement uncertainty in conformity assessment*, clauses 7 (conformance probability), 8
(guard bands) and 9 (risks); ISO 14253-1:2017; ILAC-G8:09/2019.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from statistics import NormalDist

from servobench.core.crossing import crossing
from servobench.core.rounding import TWO_SIDED

_NORMAL = NormalDist()
CONFIDENCE = 0.95
"""The conformance probability that `jcgm-106` asks for, and that the guard band of `iso-14253-1` gives for one limit."""


class Decision(StrEnum):
    """The decision on a motor, or on one parameter of it."""

    PASS = "pass"
    FAIL = "fail"
    UNDECIDED = "undecided"


@dataclass(frozen=True, kw_only=True)
class Rule:
    """A decision rule: how many standard uncertainties the guard band has; None where the conformance probability decides."""

    name: str
    """The parameter's name in a file of limits."""
    guard: float | None
    meaning: str
    """Its source, and the risk at a limit."""


RULES: Mapping[str, Rule] = {
    rule.name: rule
    for rule in (
        Rule(
            name="iso-14253-1",
            guard=_NORMAL.inv_cdf(CONFIDENCE),
            meaning="ISO 14253-1:2017, guard band 1.64 u: at most 5 % risk at a limit, either way",
        ),
        Rule(
            name="ilac-g8",
            guard=TWO_SIDED,
            meaning="ILAC-G8:09/2019 with guard band w = U, half the 95 % interval: at most 2.5 % risk at a limit, either way",
        ),
        Rule(
            name="jcgm-106",
            guard=None,
            meaning="JCGM 106:2012, conformance probability: pass from 95 %, fail up to 5 %",
        ),
        Rule(
            name="simple",
            guard=0.0,
            meaning="simple acceptance (ILAC-G8:09/2019, JCGM 106:2012, 8.2): the value decides, with up to 50 % risk at a limit",
        ),
    )
}
"""The rules by name."""


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A value with the ends of its 95 % interval, which may lie unevenly about it."""

    value: float
    low: float
    """The lower end."""
    high: float
    """The upper end."""

    @property
    def u_below(self) -> float:
        """The standard uncertainty below the value: that part of the interval over 1.96."""
        return (self.value - self.low) / TWO_SIDED

    @property
    def u_above(self) -> float:
        """The standard uncertainty above the value."""
        return (self.high - self.value) / TWO_SIDED

    def distribution(self, x: float) -> float:
        """Return the probability that the true value is at most x: a normal distribution, each half as wide as its interval."""
        width = self.u_below if x < self.value else self.u_above
        if width <= 0:
            return float(x >= self.value)
        return _NORMAL.cdf((x - self.value) / width)


def conformance_probability(measured: Measured, low: float, high: float) -> float:
    """Return the probability that the true value lies between two limits, either of which may be infinite.

    p_c = F(high) - F(low), with F of `Measured`: Φ((high - y)/u) - Φ((low - y)/u) for an even interval. Source: JCGM 106:2012, 7.
    """
    above = 1.0 if high == math.inf else measured.distribution(high)
    below = 0.0 if low == -math.inf else measured.distribution(low)
    return max(0.0, above - below)


def decide(measured: Measured, low: float, high: float, rule: Rule) -> Decision:
    """Return the decision on a value between two limits, either of which may be infinite.

    With a guard band g = k u: pass for low + g ≤ y ≤ high - g, fail for y < low - g or y > high + g, undecided in between,
    where u is that of the side of the limit. Source: JCGM 106:2012, 8.3; ISO 14253-1:2017; ILAC-G8:09/2019.
    """
    if rule.guard is None:
        probability = conformance_probability(measured, low, high)
        if probability >= CONFIDENCE:
            return Decision.PASS
        return Decision.FAIL if probability <= 1 - CONFIDENCE else Decision.UNDECIDED
    y, k = measured.value, rule.guard
    # To a limit above, the upper half of the interval counts while y is below it, the lower half once y is beyond.
    if y - k * measured.u_below > high or y + k * measured.u_above < low:
        return Decision.FAIL
    inside = y - k * measured.u_below >= low and y + k * measured.u_above <= high
    return Decision.PASS if inside else Decision.UNDECIDED


@dataclass(frozen=True, kw_only=True)
class GlobalRisks:
    """A rule's risks in production: probabilities for the next motor, of one parameter.

    `consumer` is to be outside the limits and passed, `producer` to be within and failed, `undecided` to be neither passed nor
    failed.
    """

    consumer: float
    producer: float
    undecided: float


def global_risks(mean: float, spread: float, u: float, low: float, high: float, rule: Rule) -> GlobalRisks:
    """Return the risks for a production of normal true values (`mean`, standard deviation `spread`) measured with uncertainty u.

    R_C = ∫ outside of the limits P(pass | η) g(η) dη, R_P = ∫ within P(fail | η) g(η) dη, where g is the production's density and
    a measured value is normal about η. Source: JCGM 106:2012, 9.5.
    """
    from scipy.integrate import quad

    passes, fails = _zones(u, low, high, rule)

    def lands(eta: float, zone: tuple[float, float]) -> float:
        if not zone[0] < zone[1]:
            return 0.0
        if u <= 0:
            return float(zone[0] <= eta <= zone[1])
        return _NORMAL.cdf((zone[1] - eta) / u) - _NORMAL.cdf((zone[0] - eta) / u)

    def integral(zone: tuple[float, float], among: tuple[float, float]) -> float:
        if spread <= 0:
            return lands(mean, zone) if among[0] <= mean <= among[1] else 0.0
        production = NormalDist(mean, spread)
        far = mean - 9 * spread, mean + 9 * spread
        a, b = max(among[0], far[0]), min(among[1], far[1])
        if not a < b:
            return 0.0
        edges = sorted(
            {min(max(x, a), b) for end in zone for x in (end - 6 * u, end, end + 6 * u)}
            | {a, b, min(max(mean, a), b)}
        )
        pieces = pairwise(edges)
        return sum(
            float(quad(lambda eta: lands(eta, zone) * production.pdf(eta), start, stop)[0])
            for start, stop in pieces
        )

    within, below, above = (low, high), (-math.inf, low), (high, math.inf)
    everything = (-math.inf, math.inf)
    rejected = sum(integral(zone, everything) for zone in fails)
    return GlobalRisks(
        consumer=integral(passes, below) + integral(passes, above),
        producer=sum(integral(zone, within) for zone in fails),
        undecided=max(0.0, 1.0 - integral(passes, everything) - rejected),
    )


def _zones(
    u: float, low: float, high: float, rule: Rule
) -> tuple[tuple[float, float], tuple[tuple[float, float], tuple[float, float]]]:
    """The interval in which a measured value passes, and the two sides on which it fails."""
    if rule.guard is not None:
        g = rule.guard * u
        return (low + g, high - g), ((-math.inf, low - g), (high + g, math.inf))
    passes = _reaches(CONFIDENCE, u, low, high)
    start, stop = _reaches(1 - CONFIDENCE, u, low, high)
    if not start < stop:
        return passes, ((-math.inf, math.inf), (math.inf, math.inf))
    return passes, ((-math.inf, start), (stop, math.inf))


def _reaches(wanted: float, u: float, low: float, high: float) -> tuple[float, float]:
    """Between which measured values the conformance probability reaches a wanted one; an empty interval where it never does."""
    z = _NORMAL.inv_cdf(wanted)
    if u <= 0:
        return low, high
    if low == -math.inf or high == math.inf:
        return low + z * u, high - z * u

    def short(y: float) -> float:
        half = TWO_SIDED * u
        return conformance_probability(Measured(value=y, low=y - half, high=y + half), low, high) - wanted

    middle, far = 0.5 * (low + high), 0.5 * (high - low) + 10 * u
    if short(middle) < 0:
        return math.inf, -math.inf
    return crossing(short, middle - far, middle), crossing(short, middle, middle + far)
