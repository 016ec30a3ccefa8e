"""Truth: python-control's `margin`, and the algebra of a first-order motor under unit feedback."""

import math

import control
import numpy as np
import pytest

from servobench.interop import to_control
from servobench.margins import margins, series
from servobench.transfer_function import TransferFunction

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
    assert margins(TransferFunction(numerator=(-23.8,), denominator=(0.1, 1.0, 0.0))).phase_margin < 0


def test_systems_in_series_have_the_product_of_their_responses() -> None:
    first = TransferFunction(numerator=(2.0, 1.0), denominator=(0.1, 1.0), delay=0.01, output="voltage")
    then = TransferFunction(numerator=(3.0,), denominator=(1.0, 0.0), delay=0.02, output="position")
    omega = np.geomspace(0.1, 100, 20)

    both = series(first, then)

    np.testing.assert_allclose(
        both.frequency_response(omega), first.frequency_response(omega) * then.frequency_response(omega)
    )
    assert both.output == "position"
