"""The gains for which a loop with a delay is stable, against algebra and against Nyquist's count, gain by gain."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from servobench.core.errors import UsageError
from servobench.systems.stability.gains import stable_gains
from servobench.systems.stability.nyquist import closed_loop
from servobench.systems.transfer_function import TransferFunction

# Both sides take some tens of roundings of 1.1e-16 each, and the frequency is solved to 1e-14, of which the gain takes twice.
_EXACT = 1e-12
_DECADES = (1e-12, 1e-6, 1.0, 1e5, 3.1e5, 1e6, 1e12, 1e60)


def loop(numerator: tuple[float, ...], *denominator: float, delay: float = 0.0) -> TransferFunction:
    return TransferFunction(numerator=numerator, denominator=denominator, delay=delay, unit="1")


@pytest.mark.parametrize("gain", _DECADES)
def test_an_electrical_time_constant_limits_the_gain_by_rouths_array(gain: float) -> None:
    """τ τe s³ + (τ + τe)s² + s + K k: stable below (τ + τe)/(τ τe K)."""
    tau, electrical = 0.0998, 1.38e-4
    motor = loop((gain,), tau * electrical, tau + electrical, 1.0, 0.0)
    limit = (1 / tau + 1 / electrical) / gain
    assert stable_gains(motor) == ((0.0, pytest.approx(limit, rel=_EXACT)),)


@pytest.mark.parametrize("gain", _DECADES)
@pytest.mark.parametrize("omega", [1e-3, 1.0, 267.0, 1e6])
def test_a_delay_limits_the_gain_where_it_takes_what_the_motor_left_of_the_phase(
    gain: float, omega: float
) -> None:
    """-90° - atan τω - dω = -180° at any ω that one likes, with the d that it asks for: k K = ω √(1 + τ²ω²)."""
    tau = 0.1
    delay = math.atan2(1.0, tau * omega) / omega
    motor = loop((gain,), tau, 1.0, 0.0, delay=delay)
    limit = omega * math.hypot(1.0, tau * omega) / gain
    # The phase near -π is known to a unit in its last place, 4.4e-16, for each of its four terms; what that moves ω by,
    # relatively, is over the phase's slope over ln ω. The gain goes with ω² at the most.
    slope = delay * omega + tau * omega / (1 + (tau * omega) ** 2)
    allowed = _EXACT + 2 * 4 * 4.4e-16 / slope
    assert stable_gains(motor) == ((0.0, pytest.approx(limit, rel=allowed)),)


@pytest.mark.parametrize("omega", [0.1, 1.0, 30.0])
def test_an_unstable_pole_needs_some_gain_and_bears_no_more_than_its_delay(omega: float) -> None:
    """s - 1 + k e^(-ds): a real pole comes back at k = 1, a pair leaves where atan ω = dω, at k = √(1 + ω²)."""
    balanced = loop((1.0,), 1.0, -1.0, delay=math.atan(omega) / omega)
    low, high = stable_gains(balanced)[0]
    assert (low, high) == (pytest.approx(1.0, rel=_EXACT), pytest.approx(math.hypot(1, omega), rel=_EXACT))
    assert stable_gains(replace(balanced, delay=1.01)) == ()  # with d > 1 a second pole is there before k = 1


def test_two_real_poles_come_back_as_a_pair() -> None:
    """s² - 3s - 1 + k (s + 1) e^(-ds): a left pole joins the right one at k = 1, and both return where the pair's real part is 0.

    Without a delay that is k = 3. With one, jω is a root where the real part and the imaginary part are zero:
    ω² + 1 = k (cos dω + ω sin dω) and 3ω = k (ω cos dω - sin dω).
    """
    delay = 0.05
    falling = loop((1.0, 1.0), 1.0, -3.0, -1.0, delay=delay)
    [(low, high)] = stable_gains(falling)

    def balance(w: float) -> float:
        late = math.cos(delay * w) + w * math.sin(delay * w)
        return (w**2 + 1) * (w * math.cos(delay * w) - math.sin(delay * w)) - 3 * w * late

    for found, (start, end) in ((low, (1, 5)), (high, (20, 35))):
        w = brentq(balance, start, end, xtol=1e-14, rtol=1e-14)
        assert found == pytest.approx(math.hypot(w**2 + 1, 3 * w) / math.hypot(w, 1), rel=_EXACT)


def test_a_pole_on_the_axis_turns_the_phase_by_half_a_turn() -> None:
    """(s² + 1)(s + 1) + k e^(-4s): below 1 rad/s a pair leaves where atan ω + 4ω = π, at k = (1 - ω²) √(1 + ω²)."""
    oscillator = loop((1.0,), *np.convolve((1.0, 0.0, 1.0), (1.0, 1.0)), delay=4.0)
    omega = brentq(lambda w: math.atan(w) + 4 * w - math.pi, 0.1, 0.99, xtol=1e-15, rtol=1e-15)
    limit = (1 - omega**2) * math.hypot(1, omega)
    assert stable_gains(oscillator) == ((0.0, pytest.approx(limit, rel=_EXACT)),)
    # With -k the pair moves to the right at once: ds/dk = e^(-4j)/(2j (1 + j)) at j, with a real part of cos(4 + 3π/4)/√8 > 0.
    backwards = replace(oscillator, numerator=(-1.0,))
    assert stable_gains(backwards) == ()


def test_some_loops_are_stable_for_no_gain() -> None:
    assert stable_gains(loop((-24.0,), 0.1, 1.0, 0.0, delay=1e-3)) == ()
    assert stable_gains(loop((1.0,), 1.0, 0.0, 0.0, delay=1e-3)) == ()
    # Backwards without an integrator: 1 - 2k at s = 0.
    assert stable_gains(loop((-2.0,), 1.0, 1.0, delay=0.1)) == ((0.0, pytest.approx(0.5, rel=_EXACT)),)


def test_loops_that_resonate_are_as_nyquist_counts_gain_by_gain() -> None:
    """A phase that rises brings poles back: some of these loops are stable in several ranges of the gain."""
    random = np.random.default_rng(1)
    several = 0
    for _ in range(100):
        corners, damping = 10 ** random.uniform(0, 2, 2), 10 ** random.uniform(-2.5, 0, 2)
        n = np.array([corners[0] ** -2, 2 * damping[0] / corners[0], 1.0])
        d = np.convolve(
            [corners[1] ** -2, 2 * damping[1] / corners[1], 1.0], [0.1, 1.0, random.choice([0.0, 0.5])]
        )
        resonant = loop(tuple(n), *d, delay=10 ** random.uniform(-3, 0))
        ranges = stable_gains(resonant)
        several += len(ranges) > 1
        for k in 10 ** random.uniform(-4, 2, 4):
            judged = closed_loop(replace(resonant, numerator=tuple(k * n))).verdict
            assert any(low < k < high for low, high in ranges) == (judged == "stable"), (resonant, k, ranges)
    assert several > 2


@pytest.mark.parametrize(
    "refused",
    [
        loop((0.0,), 1.0, 0.0, delay=0.1),
        loop((1.0, 1.0), 1.0, 0.0, delay=0.1),
        loop((1.0, 1.0, 1.0), 1.0, 0.0),
        loop((1.0,), 1.0, 0.0, delay=-0.1),
    ],
)
def test_what_has_no_stable_gains_to_look_for_is_reported(refused: TransferFunction) -> None:
    with pytest.raises(UsageError, match="stable gains"):
        stable_gains(refused)


def test_a_gain_that_no_number_can_hold_squared_is_reported() -> None:
    with pytest.raises(UsageError, match="1e\\+300"):
        closed_loop(loop((1e300,), 0.1, 1.0, 0.0, delay=1e-3))
