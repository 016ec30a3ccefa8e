"""Decisions and their risks against published figures, simulation, and a second route."""

import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from servobench.core.rounding import TWO_SIDED
from servobench.fleet.decision import (
    RULES,
    Decision,
    Measured,
    conformance_probability,
    decide,
    global_risks,
)


def measured(value: float, u: float) -> Measured:
    return Measured(value=value, low=value - TWO_SIDED * u, high=value + TWO_SIDED * u)


@pytest.mark.parametrize(
    ("value", "u", "low", "high", "published"),
    [(-5.47, 0.05, -math.inf, -5.40, 0.92), (509.7, 8.6, 490.0, math.inf, 0.99)],
    ids=["Zener diode", "metal container"],
)
def test_the_conformance_probability_is_that_of_jcgm_106(
    value: float, u: float, low: float, high: float, published: float
) -> None:
    """The two examples of clause 7 of JCGM 106:2012, printed to two digits."""
    assert conformance_probability(measured(value, u), low, high) == pytest.approx(published, abs=0.005)


def test_an_uneven_interval_counts_on_the_side_of_the_limit() -> None:
    uneven = Measured(value=0.0, low=-TWO_SIDED, high=3 * TWO_SIDED)

    assert conformance_probability(uneven, -1.0, math.inf) == pytest.approx(0.8413447)  # Φ(1)
    assert conformance_probability(uneven, -math.inf, 3.0) == pytest.approx(0.8413447)


@pytest.mark.parametrize(
    ("rule", "value", "decision"),
    [
        ("iso-14253-1", 10 - 1.65, Decision.PASS),
        ("iso-14253-1", 10 - 1.64, Decision.UNDECIDED),
        ("iso-14253-1", 10 + 1.64, Decision.UNDECIDED),
        ("iso-14253-1", 10 + 1.65, Decision.FAIL),
        ("ilac-g8", 10 - 1.95, Decision.UNDECIDED),
        ("ilac-g8", 10 - 1.97, Decision.PASS),
        ("ilac-g8", -1.97, Decision.FAIL),
        ("jcgm-106", 10 - 1.65, Decision.PASS),
        ("jcgm-106", 10 - 1.64, Decision.UNDECIDED),
        ("simple", 10.0, Decision.PASS),
        ("simple", 10.001, Decision.FAIL),
    ],
)
def test_a_value_is_decided_by_the_guard_band(rule: str, value: float, decision: Decision) -> None:
    assert decide(measured(value, 1.0), 0.0, 10.0, RULES[rule]) is decision


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(("low", "high"), [(9.0, 11.5), (-math.inf, 10.5), (9.9, 10.1)])
def test_the_risks_are_those_of_simulated_motors(rule: str, low: float, high: float) -> None:
    """Each share of n motors has the standard deviation sqrt(p (1 - p)/n); four of these, and 1/n for a share of zero."""
    n, mean, spread, u = 20_000, 10.2, 0.7, 0.3
    random = np.random.default_rng(3)
    true = random.normal(mean, spread, n)
    seen = true + random.normal(0, u, n)
    within = (true >= low) & (true <= high)
    decided = np.array([decide(measured(float(y), u), low, high, RULES[rule]) for y in seen])
    risks = global_risks(mean, spread, u, low, high, RULES[rule])

    for told, counted in (
        (risks.consumer, (~within & (decided == Decision.PASS)).mean()),
        (risks.producer, (within & (decided == Decision.FAIL)).mean()),
        (risks.undecided, (decided == Decision.UNDECIDED).mean()),
    ):
        assert abs(told - counted) <= 4 * math.sqrt(told * (1 - told) / n) + 1 / n, (rule, told, counted)


def test_the_risks_are_the_areas_of_a_bivariate_normal() -> None:
    """A second route: true and measured value are jointly normal; the consumer's risk is the area beyond a limit and within g."""
    mean, spread, u, high = 0.0, 1.0, 0.4, 1.2
    g = RULES["ilac-g8"].guard
    assert g is not None
    joint = multivariate_normal([mean, mean], [[spread**2, spread**2], [spread**2, spread**2 + u**2]])
    passed = float(joint.cdf([np.inf, high - g * u]))
    passed_within = float(joint.cdf([high, high - g * u]))
    below_fail = float(joint.cdf([high, high + g * u]))
    within = float(joint.cdf([high, np.inf]))
    risks = global_risks(mean, spread, u, -math.inf, high, RULES["ilac-g8"])

    # SciPy's bivariate integral is good to 1e-5.
    assert risks.consumer == pytest.approx(passed - passed_within, abs=2e-5)
    assert risks.producer == pytest.approx(within - below_fail, abs=2e-5)


def test_without_uncertainty_nobody_runs_a_risk() -> None:
    risks = global_risks(0.0, 1.0, 0.0, -1.0, 1.0, RULES["iso-14253-1"])

    assert (risks.consumer, risks.producer) == (0.0, 0.0)
    assert risks.undecided == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("measured", "decision"),
    [
        (Measured(value=10.0, low=9.9, high=13.0), Decision.UNDECIDED),  # the limit is within the upper half
        (Measured(value=10.0, low=7.0, high=10.1), Decision.FAIL),
    ],
)
def test_the_half_of_an_uneven_interval_towards_a_limit_decides(
    measured: Measured, decision: Decision
) -> None:
    rule = RULES["ilac-g8"]

    assert decide(measured, 11.0, math.inf, rule) is decision
    mirrored = Measured(value=-measured.value, low=-measured.high, high=-measured.low)
    assert decide(mirrored, -math.inf, -11.0, rule) is decision
