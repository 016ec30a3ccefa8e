"""Truth: python-control's `margin`, and the algebra of a first-order motor under unit feedback."""

import math
from dataclasses import replace

import control
import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.systems.interop import to_control
from servobench.systems.margins import delay_margin, margins, series
from servobench.systems.stability.nyquist import closed_loop
from servobench.systems.transfer_function import TransferFunction

LOOPS = {
    "motor with an electrical pole": ((23.8,), (1.4e-5, 0.1, 1.0, 0.0)),
    "three equal poles": ((5.0,), (1.0, 3.0, 3.0, 1.0)),
    "resonance that crosses three times": ((4.0, 2.0, 40.0), (1.0, 0.4, 16.0, 2.0, 0.0)),
    "unstable under feedback": ((1e3, 2e3), (1.0, 3.0, 50.0, 100.0, 0.0)),
    "zero in the right half-plane": ((-0.4, 2.0), (0.1, 1.0, 0.0)),
    "motor and lead": ((2.4, 48.0), (0.0002, 0.102, 1.0, 0.0)),
}


def system(name: str, delay: float = 0.0) -> TransferFunction:
    numerator, denominator = LOOPS[name]
    return TransferFunction(numerator=numerator, denominator=denominator, delay=delay)


@pytest.mark.parametrize("name", LOOPS)
def test_margins_are_those_of_python_control(name: str) -> None:
    found = margins(system(name))

    factor, degrees, at_phase, at_gain = control.margin(control.tf(*LOOPS[name]))
    # Roots of polynomials in double precision, a pair of them near to each other at the most.
    assert found.gain_margin == pytest.approx(factor, rel=1e-6)
    assert math.degrees(found.phase_margin) == pytest.approx(degrees, abs=1e-6)
    assert found.gain_crossover == pytest.approx(at_gain, rel=1e-6)
    assert found.phase_crossover == pytest.approx(at_phase, rel=1e-6, nan_ok=True)


@pytest.mark.parametrize("name", LOOPS)
def test_with_a_delay_they_are_those_of_a_pade_approximation_that_is_good_enough(name: str) -> None:
    # Of order 6 and at ωd of 1 or less the approximation's phase is right to 1e-13.
    loop = system(name, delay=0.01)

    found = margins(loop)

    factor, degrees, at_phase, at_gain = control.margin(to_control(loop, pade_order=6))
    assert max(found.gain_crossover, found.phase_crossover) * 0.01 < 3
    # At an ωd of 3 it is still right to 1e-7.
    assert found.gain_margin == pytest.approx(factor, rel=1e-5)
    assert math.degrees(found.phase_margin) == pytest.approx(degrees, abs=1e-4)
    assert found.gain_crossover == pytest.approx(at_gain, rel=1e-5)
    assert found.phase_crossover == pytest.approx(at_phase, rel=1e-5)


def test_a_first_order_motor_has_the_phase_margin_of_the_algebra() -> None:
    # |K/(jω(1 + jωτ))| = 1: τ²ω⁴ + ω² - K² = 0
    gain, tau = 23.8, 0.1
    omega = math.sqrt((math.sqrt(1 + 4 * tau**2 * gain**2) - 1) / (2 * tau**2))

    found = margins(TransferFunction(numerator=(gain,), denominator=(tau, 1.0, 0.0)))

    assert found.gain_crossover == pytest.approx(omega, rel=1e-12)
    assert found.phase_margin == pytest.approx(math.pi / 2 - math.atan(omega * tau), rel=1e-12)
    assert found.delay_margin == pytest.approx(found.phase_margin / omega, rel=1e-12)
    assert found.gain_margin == math.inf
    assert math.isnan(found.phase_crossover)


def test_added_delay_takes_the_phase_margin_and_the_delay_margin_takes_all_of_it() -> None:
    without = margins(TransferFunction(numerator=(23.8,), denominator=(0.1, 1.0, 0.0)))
    edge = TransferFunction(numerator=(23.8,), denominator=(0.1, 1.0, 0.0), delay=without.delay_margin)

    found = margins(edge)

    assert found.phase_margin == pytest.approx(0.0, abs=1e-12)
    assert found.gain_margin == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("delay", [1e-9, 1e-4, 0.02, 3.0])
def test_the_phase_at_the_phase_crossover_is_minus_180_degrees_whatever_the_delay(delay: float) -> None:
    loop = TransferFunction(numerator=(23.8,), denominator=(0.1, 1.0, 0.0), delay=delay)

    found = margins(loop)

    value = loop.frequency_response(np.array([found.phase_crossover]))[0]
    assert value.real == pytest.approx(-1 / found.gain_margin, rel=1e-9)
    assert abs(value.imag) < 1e-9 * abs(value)


def test_a_negative_delay_counts_as_none() -> None:
    early, prompt = system("three equal poles", delay=-0.01), system("three equal poles")

    assert margins(early) == margins(prompt)


def test_a_loop_that_never_reaches_a_gain_of_one_has_no_phase_margin_to_lose() -> None:
    found = margins(TransferFunction(numerator=(0.5,), denominator=(1.0, 1.0)))

    assert found.phase_margin == found.delay_margin == found.gain_margin == math.inf
    assert math.isnan(found.gain_crossover)


def test_a_motor_wired_the_wrong_way_round_is_unstable_under_feedback() -> None:
    found = margins(TransferFunction(numerator=(-23.8,), denominator=(0.1, 1.0, 0.0)))

    assert found.phase_margin < 0
    assert found.delay_margin == 0.0


def test_systems_in_series_have_the_product_of_their_responses() -> None:
    first = TransferFunction(numerator=(2.0, 1.0), denominator=(0.1, 1.0), delay=0.01, output="voltage")
    then = TransferFunction(numerator=(3.0,), denominator=(1.0, 0.0), delay=0.02, output="position")
    omega = np.geomspace(0.1, 100, 20)

    both = series(first, then)

    np.testing.assert_allclose(
        both.frequency_response(omega), first.frequency_response(omega) * then.frequency_response(omega)
    )
    assert both.output == "position"


def is_stable(loop: TransferFunction, factor: float = 1.0, later: float = 0.0) -> bool:
    """By Nyquist's count, which knows nothing of margins."""
    changed = replace(loop, numerator=tuple(factor * c for c in loop.numerator), delay=loop.delay + later)
    return closed_loop(changed).verdict == "stable"


def test_no_narrow_resonance_hides_the_gain_at_which_a_loop_becomes_unstable() -> None:
    """A servo with one or two resonances of a damping of 1e-4 to 0.03, each with its antiresonance next to it, behind a delay."""
    random = np.random.default_rng(3)
    limited = 0
    for _ in range(60):
        numerator, denominator = np.array([1.0]), np.array([1.0, 10 ** random.uniform(-1, 1), 0.0])
        for _ in range(random.integers(1, 3)):
            omega, damping = 10 ** random.uniform(0, 2), 10 ** random.uniform(-4, -1.5)
            apart = 1 + 10 ** random.uniform(-3, -1) * random.choice([-1, 1])
            numerator = np.convolve(numerator, [1, 2 * damping * omega * apart, (omega * apart) ** 2])
            denominator = np.convolve(denominator, [1, 2 * damping * omega, omega**2])
        numerator *= 10 ** random.uniform(-1, 1)
        loop = TransferFunction(
            numerator=tuple(map(float, numerator)),
            denominator=tuple(map(float, denominator)),
            delay=float(10 ** random.uniform(-3, -0.5)),
        )
        if not is_stable(loop):
            continue
        factor = margins(loop).gain_margin
        # Roots of a polynomial of order 12 in ω² are known to 1e-6 at the worst; Nyquist's count takes 1e-9 for the border.
        assert not is_stable(loop, factor * (1 + 1e-5 * math.copysign(1, factor - 1)))
        nearest = max(factor, 1 / factor) * (1 - 1e-5)
        assert all(is_stable(loop, nearest**part) for part in np.linspace(-1, 1, 9))
        limited += 1
    assert limited > 30


def test_a_delay_limits_the_gain_of_every_loop_also_of_one_whose_zeros_hold_its_phase_up() -> None:
    loop = TransferFunction(
        numerator=(3e-5, 1.3e-4, 1.1e-4, 1.3e-5), denominator=(1.0, 0.083, 0.0017, 0.0, 0.0), delay=0.18
    )

    found = margins(loop)

    # There L(jω) is real and negative, by its definition.
    there = loop.frequency_response(np.array([found.phase_crossover]))[0]
    assert there.real * found.gain_margin == pytest.approx(-1)
    assert abs(there.imag) < 1e-9 * abs(there.real)


@pytest.mark.parametrize("delay", [0.0, 0.01])
def test_a_loop_that_is_negative_at_standstill_has_its_limit_there(delay: float) -> None:
    # 1 + k L(0) = 0 at k = 10, where a real pole goes to the right; python-control says so of the loop without delay.
    loop = TransferFunction(numerator=(0.1, -0.2), denominator=(1.0, 3.0, 2.0), delay=delay)

    found = margins(loop)

    assert control.margin(control.tf([0.1, -0.2], [1, 3, 2]))[0] == pytest.approx(10)
    assert (found.gain_margin, found.phase_crossover) == pytest.approx((10, 0))


def test_a_loop_that_is_negative_at_high_frequencies_has_its_limit_there() -> None:
    # 1 - k/2 = 0 at k = 2: the leading coefficient of s + 2 - k (s + 1)/2 is lost, before the last one is at 4.
    found = margins(TransferFunction(numerator=(-0.5, -0.5), denominator=(1.0, 2.0)))

    assert (found.gain_margin, found.phase_crossover) == (2, math.inf)


def test_the_delay_that_a_loop_with_two_crossovers_bears_is_that_at_which_it_becomes_unstable() -> None:
    # |10 jω| = 1 + ω² at ω = 5 ± √24; there the phase is 90° - 2 arctan ω, 79° at the lower one, which is far from -180°.
    loop = TransferFunction(numerator=(10.0, 0.0), denominator=(1.0, 2.0, 1.0))
    omega = 5 + math.sqrt(24)

    found = delay_margin(loop)

    assert found == pytest.approx((1.5 * math.pi - 2 * math.atan(omega)) / omega, rel=1e-9)
    assert is_stable(loop, later=0.999 * found)
    assert not is_stable(loop, later=1.001 * found)


def test_of_a_loop_with_one_crossover_it_is_that_of_the_margins() -> None:
    loop = system("motor with an electrical pole", delay=0.001)

    assert delay_margin(loop) == pytest.approx(margins(loop).delay_margin, rel=1e-12)
    assert delay_margin(TransferFunction(numerator=(0.5,), denominator=(1.0, 1.0))) == math.inf


@pytest.mark.parametrize(
    ("gain", "delay", "said"), [(1e155, 0.0, "a coefficient of the loop is 1e"), (1.0, 1e-300, "1e-300 s")]
)
def test_a_loop_beyond_floating_point_is_refused_with_what_to_do(
    gain: float, delay: float, said: str
) -> None:
    with pytest.raises(UsageError, match=said):
        margins(TransferFunction(numerator=(gain,), denominator=(0.1, 1.0, 0.0), delay=delay))


def test_a_loop_that_does_nothing_has_no_limits() -> None:
    found = margins(TransferFunction(numerator=(0.0,), denominator=(0.1, 1.0, 0.0), delay=0.01))

    assert (found.gain_margin, found.phase_margin, found.delay_margin) == (math.inf,) * 3
