"""Loops: Routh's table, root locus and Nyquist's criterion, against roots, textbooks and python-control."""

from __future__ import annotations

import math
from dataclasses import replace

import control
import numpy as np
import pytest
from scipy.optimize import brentq

from servobench.core.errors import UsageError
from servobench.systems.interop import without_delay
from servobench.systems.margins import margins
from servobench.systems.stability.gains import stable_gains
from servobench.systems.stability.locus import root_locus
from servobench.systems.stability.nyquist import closed_loop
from servobench.systems.stability.poles import poles_of
from servobench.systems.stability.routh import routh
from servobench.systems.transfer_function import TransferFunction

K, TAU = 1 / 0.042, 0.0998


def loop(numerator: tuple[float, ...], *denominator: float, delay: float = 0.0) -> TransferFunction:
    return TransferFunction(numerator=numerator, denominator=denominator, delay=delay, unit="1")


def test_the_table_is_the_textbooks() -> None:
    """s⁴ + 2s³ + 3s² + 4s + 5 (Ogata, Modern Control Engineering, section 5.6): two roots to the right."""
    table = routh([1, 2, 3, 4, 5])
    assert [row.elements for row in table.rows] == [(1, 3, 5), (2, 4), (1, 5), (-6,), (5,)]
    assert (table.right, table.on_axis, table.factor) == (2, 0, None)


def test_a_row_of_zeros_is_replaced_by_the_auxiliary_polynomials_derivative() -> None:
    """s⁵ + 2s⁴ + 24s³ + 48s² - 25s - 50 (the same): auxiliary 2s⁴ + 48s² - 50, derivative 8s³ + 96s, one root to the right."""
    table = routh([1, 2, 24, 48, -25, -50])
    assert table.rows[2].elements == (8, 96)
    assert "derivative of the row of s^4" in table.rows[2].note
    assert table.rows[-2].elements[0] == pytest.approx(112.7, abs=0.05)
    assert (table.right, table.on_axis) == (1, 2)  # ±1 and ±5j


def test_a_zero_in_front_is_got_rid_of_by_a_root_more_on_the_left() -> None:
    """s⁴ + s³ + 2s² + 2s + 3: the row of s² would be 0, 3. Two roots to the right."""
    table = routh([1, 1, 2, 2, 3])
    assert table.factor == (1, 1)
    assert len(table.rows) == 6
    assert (table.right, table.on_axis) == (2, 0)


def test_the_count_is_that_of_the_roots() -> None:
    """Small whole coefficients make all special cases, together, too."""
    random = np.random.default_rng(1)
    special = 0
    for _ in range(400):
        polynomial = random.integers(-3, 4, size=random.integers(2, 9)).astype(float)
        polynomial[0] = polynomial[0] or 1.0
        table = routh(polynomial)
        special += table.factor is not None or any(row.note for row in table.rows)
        found = poles_of(polynomial)
        assert table.right == sum(pole.multiplicity for pole in found if pole.side > 0), polynomial
        assert table.on_axis == sum(pole.multiplicity for pole in found if pole.side == 0), polynomial
    assert special > 50


def test_rounding_makes_no_root_on_the_right() -> None:
    """At the limit of a gain the row of s¹ is zero but for rounding, which is no matter of sign."""
    limit = 10 * (1 + 10 * TAU) / (TAU * K)
    table = routh([TAU, 1 + 10 * TAU, 10, K * limit])
    assert (table.right, table.on_axis) == (0, 2)
    assert routh([TAU, 1 + 10 * TAU, 10, K * limit * (1 + 1e-9)]).right == 2
    assert routh([TAU, 1 + 10 * TAU, 10, K * limit * (1 - 1e-9)]).stable


@pytest.mark.parametrize("polynomial", [[1.0], [0.0, 1.0], [math.nan, 1.0], [math.inf, 1.0], []])
def test_what_has_no_table_is_reported(polynomial: list[float]) -> None:
    with pytest.raises(UsageError, match="no Routh table"):
        routh(polynomial)


def test_the_limits_of_a_gain_are_those_of_algebra() -> None:
    """τs³ + (1 + 10τ)s² + 10s + K k: stable up to 10 (1 + 10τ)/(τK)."""
    cubic = loop((K,), *np.convolve((TAU, 1.0, 0.0), (1.0, 10.0)))
    [(low, high)] = stable_gains(cubic)
    assert (low, high) == (0.0, pytest.approx(10 * (1 + 10 * TAU) / (TAU * K), rel=1e-12))
    assert stable_gains(loop((K,), TAU, 1.0, 0.0)) == ((0.0, math.inf),)
    assert stable_gains(loop((1.0,), 1.0, -1.0)) == ((pytest.approx(1.0), math.inf),)
    assert stable_gains(loop((1.0,), 1.0, 0.0, 0.0)) == ()
    # (1 - k) s + 1 + 2 k: at k = 1 the root passes through infinity, and comes back on the right.
    assert stable_gains(loop((-1.0, 2.0), 1.0, 1.0)) == ((0.0, pytest.approx(1.0)),)
    # Conditionally stable: the roots of s³ + k (s + 1)² move to the right first. s³ + ks² + 2ks + k: 2k² > k.
    assert stable_gains(loop((1.0, 2.0, 1.0), 1.0, 0.0, 0.0, 0.0)) == ((pytest.approx(0.5), math.inf),)


def test_a_gain_at_which_the_poles_only_touch_the_axis_is_left_out() -> None:
    """s³ + (2 + k)s² + (2 + k)s + 3 + 6k: Routh asks for (2 + k)² > 3 + 6k, which is (k - 1)² > 0."""
    touching = loop((1.0, 1.0, 6.0), 1.0, 2.0, 2.0, 3.0)
    # A double root of a polynomial is found to the root of its precision, √2.2e-16.
    one = pytest.approx(1.0, abs=1e-7)
    assert stable_gains(touching) == ((0.0, one), (one, math.inf))


def test_zeros_draw_the_locus_onto_a_circle() -> None:
    """(s + 3)/(s (s + 2)): the branches meet where s² + 6s + 6 = 0, and between that they are √3 from the zero."""
    locus = root_locus(loop((1.0, 3.0), 1.0, 2.0, 0.0))
    (first, leaves), (last, comes_back) = locus.meetings
    assert (leaves, comes_back) == pytest.approx((-3 + math.sqrt(3), -3 - math.sqrt(3)), rel=1e-9)
    assert (first, last) == pytest.approx((4 - 2 * math.sqrt(3), 4 + 2 * math.sqrt(3)), rel=1e-9)
    round_it = locus.poles[(locus.gains > 1.001 * first) & (locus.gains < 0.999 * last)]
    np.testing.assert_allclose(np.abs(round_it + 3), math.sqrt(3), rtol=1e-9)
    assert (locus.centroid, locus.angles) == (pytest.approx(0 - 2 - (-3)), (math.pi,))


def test_a_branch_stays_one_branch_where_a_root_finder_swaps_two() -> None:
    """Poles at 0, -1 and -3 ± 4j, a zero at -2: none moves by more in a step of the gain than a branch is from the next."""
    resonant = loop((1.0, 2.0), *np.poly([0, -1, -3 + 4j, -3 - 4j]).real)
    locus = root_locus(resonant)
    as_found = np.array([np.roots(np.polyadd(resonant.denominator, [k, 2 * k])) for k in locus.gains])
    assert np.abs(np.diff(as_found, axis=0)).max() > 10  # NumPy does swap them
    # A step of the gain is 3.5 %: it moves a pole by a third of that part of |s| far out, and by its root next to a meeting.
    assert np.abs(np.diff(locus.poles, axis=0)).max() < 1


def test_the_locus_starts_at_the_poles_and_its_branches_are_continuous() -> None:
    cubic = loop((K,), *np.convolve((TAU, 1.0, 0.0), (1.0, 10.0)))
    locus = root_locus(cubic)
    expected = np.sort(np.roots(cubic.denominator).real)
    np.testing.assert_allclose(np.sort(locus.poles[0].real), expected, atol=1e-6)
    for k, poles in zip(locus.gains[::40], locus.poles[::40], strict=True):
        residual = np.polyval(np.polyadd(cubic.denominator, [k * K]), poles)
        size = np.polyval(np.abs(np.polyadd(cubic.denominator, [k * K])), np.abs(poles))
        assert (np.abs(residual) <= 1e-12 * size).all()
    # Steps of the gain are 1.5 %: no branch jumps to another's place, which is 10 away.
    assert np.abs(np.diff(locus.poles, axis=0)).max() < 5
    # Three branches more than zeros: asymptotes at 60°, 180°, 300° from the mean of 0, -10 and -1/τ.
    assert locus.centroid == pytest.approx(-(10 + 1 / TAU) / 3)
    assert locus.angles == pytest.approx((math.pi / 3, math.pi, 5 * math.pi / 3))
    # Where branches meet: d/ds of s (τs + 1)(s + 10) is zero.
    [(gain, place)] = locus.meetings
    assert np.polyval(np.polyder(cubic.denominator), place) == pytest.approx(0, abs=1e-9)
    assert gain == pytest.approx(-np.polyval(cubic.denominator, place) / K)


def test_the_locus_is_python_controls() -> None:
    system = loop((1.0, 3.0), 1.0, 2.0, 5.0, 0.0)
    gains = np.array([0.0, 0.5, 2.0, 10.0])
    theirs = control.root_locus_map(control.tf(system.numerator, system.denominator), gains=gains).loci
    ours = root_locus(system, gains).poles
    for row, other in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(np.sort_complex(row.round(9)), np.sort_complex(other.round(9)), atol=1e-8)


def test_a_delay_has_no_locus_and_says_what_to_do() -> None:
    with pytest.raises(UsageError, match="closed_loop"):
        root_locus(loop((1.0,), 1.0, 1.0, delay=0.1))
    with pytest.raises(UsageError, match="no higher order"):
        root_locus(loop((1.0, 0.0, 0.0), 1.0, 1.0))
    with pytest.raises(UsageError, match="expected finite numbers"):
        root_locus(loop((1.0,), 1.0, 1.0), [1.0, math.inf])


def test_nyquist_counts_what_a_high_pade_approximation_has() -> None:
    """For a delay that the order eight holds: its error, (ωd/16)^17, is nothing at any crossover here."""
    random = np.random.default_rng(3)
    seen = set()
    for _ in range(120):
        corner, other = random.uniform(0.1, 100, 2)
        integrator = float(random.choice([0.0, 0.5]))
        denominator = np.poly([-corner, -other, integrator])
        gain, delay = 10 ** random.uniform(0, 6), 10 ** random.uniform(-4, -1)
        system = loop((gain,), *map(float, denominator), delay=delay)
        rational = without_delay(system, 8)
        right = int((np.roots(np.polyadd(rational.denominator, rational.numerator)).real > 0).sum())
        found = closed_loop(system)
        assert found.right == right, system
        assert found.encirclements == right - (integrator > 0)
        assert found.verdict == ("unstable" if right else "stable")
        seen.add(right)
    assert {0, 2} <= seen


def test_nyquist_agrees_with_the_margins_about_the_border() -> None:
    """e^(-ds)/(τs + 1)/s times k: the gain margin is where the verdict turns, to the ninth digit."""
    system = loop((K,), TAU, 1.0, 0.0, delay=0.004)
    limit = margins(system).gain_margin
    for factor, verdict in ((1 - 1e-6, "stable"), (1 + 1e-6, "unstable")):
        k = limit * factor
        assert closed_loop(replace(system, numerator=(k * K,))).verdict == verdict
    # By algebra: -90° - arctan(ωτ) - ωd = -180°, and |L| = 1 there.
    omega = brentq(lambda w: math.atan(w * TAU) + w * 0.004 - math.pi / 2, 1, 400, xtol=1e-12)
    assert limit == pytest.approx(omega * math.hypot(1, omega * TAU) / K, rel=1e-9)


def test_an_unstable_motor_needs_an_encirclement() -> None:
    """k/(s - 1): stable for k > 1, and then L goes round -1 once against the clock; a delay takes it away again."""
    assert closed_loop(loop((2.0,), 1.0, -1.0)).encirclements == -1
    held = closed_loop(loop((2.0,), 1.0, -1.0, delay=0.1))
    assert (held.verdict, held.open_right, held.encirclements) == ("stable", 1, -1)
    # s = jω: ω = √3, and the delay may take arctan √3 of phase: d < (π/3)/√3.
    limit = math.pi / 3 / math.sqrt(3)
    assert closed_loop(loop((2.0,), 1.0, -1.0, delay=0.999 * limit)).verdict == "stable"
    assert closed_loop(loop((2.0,), 1.0, -1.0, delay=1.001 * limit)).verdict == "unstable"
    assert closed_loop(loop((0.5,), 1.0, -1.0)).verdict == "unstable"
    assert "once, anticlockwise (each turn anticlockwise is a pole less there" in held.sentence
    # s³ + 3s² + 3s + 17: Hurwitz asks for 3 · 3 > 17, so that a pair is to the right.
    driven = closed_loop(loop((16.0,), 1.0, 3.0, 3.0, 1.0))
    assert driven.encirclements == 2
    assert "twice, clockwise (each turn clockwise is a pole more there" in driven.sentence


def test_a_loop_through_minus_one_is_on_the_border() -> None:
    assert closed_loop(loop((4.0,), 1.0, 0.0, 0.0)).verdict == "marginally stable"  # poles at ±2j
    # k e^(-s d)/s with k d = π/2 goes through -1.
    on_it = closed_loop(loop((math.pi / 2,), 1.0, 0.0, delay=1.0))
    assert (on_it.verdict, on_it.right, on_it.encirclements) == ("marginally stable", None, None)


def test_what_nyquist_cant_be_asked_is_reported() -> None:
    with pytest.raises(UsageError, match="doesn't fall"):
        closed_loop(loop((1.0, 1.0), 1.0, 2.0, delay=0.1))
    with pytest.raises(UsageError, match="expected 0 or more"):
        closed_loop(loop((1.0,), 1.0, 2.0, delay=-0.1))
    with pytest.raises(UsageError, match="can't be closed"):
        closed_loop(loop((-1.0, 1.0), 1.0, 2.0))


@pytest.mark.parametrize("gain", [1e-18, 1e-25, 1e-40, 1e-100, 1e-140])
def test_a_tiny_gain_behind_a_delay_is_not_reported_to_be_on_the_border(gain: float) -> None:
    """k e^(-ds)/(s (τs + 1)) is stable for each k from 0 to 1/d at the least: a pole at -k leaves the integrator."""
    assert closed_loop(loop((gain,), 0.1, 1.0, 0.0, delay=1e-4)).verdict == "stable"
    assert closed_loop(loop((-gain,), 0.1, 1.0, 0.0, delay=1e-4)).right == 1


def test_a_gain_whose_square_is_no_number_any_more_is_reported() -> None:
    with pytest.raises(UsageError, match="1e-300; expected 0, or no less than 1e-150: take a larger gain"):
        closed_loop(loop((1e-300,), 0.1, 1.0, 0.0, delay=1e-4))
