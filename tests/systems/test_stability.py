"""Stability: against systems whose answer is in every textbook."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.signal import lsim

from servobench.systems.signals.constant import Constant
from servobench.systems.signals.sine import Sine
from servobench.systems.stability.poles import poles_of
from servobench.systems.stability.verdict import stability
from servobench.systems.transfer_function import TransferFunction


def system(*denominator: float) -> TransferFunction:
    return TransferFunction(numerator=(1.0,), denominator=denominator)


@pytest.mark.parametrize(
    ("denominator", "verdict", "bibo"),
    [
        ((0.1, 1.0), "stable", True),
        ((0.1, 1.0, 0.0), "marginally stable", False),  # the motor's position: one integrator
        ((1.0, 0.0, 0.0), "unstable", False),  # a double integrator
        ((1.0, 0.0, 4.0), "marginally stable", False),  # an undamped oscillator
        ((1.0, -1.0), "unstable", False),
        (tuple(np.poly([-1.0, -1.0, -1.0])), "stable", True),
        (tuple(np.poly([2j, -2j, 2j, -2j]).real), "unstable", False),  # twice on the axis
    ],
)
def test_the_verdict_is_that_of_the_textbook(
    denominator: tuple[float, ...], verdict: str, bibo: bool
) -> None:
    report = stability(system(*denominator))
    assert (report.verdict, report.bibo) == (verdict, bibo)
    assert len(report.reasons) == sum(pole.imag >= 0 for pole in report.poles)  # one for a pair


def test_a_double_pole_is_counted_twice() -> None:
    report = stability(system(*np.poly([-3.0, -3.0, -1.0])))
    assert sorted(zip(np.real(report.poles).round(3), report.multiplicities, strict=True)) == [
        (-3.0, 2),
        (-1.0, 1),
    ]


def test_the_motors_position_says_which_input_drives_it_off() -> None:
    (reason,) = (r for r in stability(system(0.1, 1.0, 0.0)).reasons if "axis" in r)
    assert "a constant" in reason


def test_a_pole_is_judged_by_the_scale_of_the_system() -> None:
    """A slow motor of 1e6 s isn't an integrator."""
    assert stability(system(1e6, 1.0)).verdict == "stable"


@pytest.mark.parametrize(
    "roots",
    [
        (-3.0, -3.0, -1.0),
        (-1 / 3, -1 / 3, -1 / 3),
        (-0.1,) * 4,
        (-1.0,) * 6,
        (-10.0, -10.0, -1000.0, -1000.0),
        (2j, -2j, 2j, -2j),
        (-1 + 2j, -1 - 2j, -1 + 2j, -1 - 2j),
        (1j, -1j, -5.0, -5.0),
        (0.0, 0.0, -7.0),
        (-1e-6, -7241.0),
    ],
)
def test_multiplicities_are_those_that_the_polynomial_was_made_with(roots: tuple[complex, ...]) -> None:
    """A root finder scatters a root of multiplicity m by the m-th root of its precision; the coefficients know better."""
    found = poles_of(np.poly(roots).real)

    expected = {root: roots.count(root) for root in set(roots)}
    assert len(found) == len(expected)
    for pole in found:
        nearest = min(expected, key=lambda root: abs(root - pole.at))
        assert pole.multiplicity == expected[nearest]
        # Coefficients off by their rounding move the pole by its uncertainty at the most.
        assert abs(pole.at - nearest) <= pole.uncertainty + 1e-15 * abs(nearest)
        assert pole.side == np.sign(nearest.real)


def test_multiplicities_of_many_systems_are_those_that_they_were_made_with() -> None:
    """Servo systems drawn by chance: real poles and pairs over six decades, single and double, on the axis and left of it."""
    random = np.random.default_rng(0)
    for _ in range(500):
        wanted: dict[complex, int] = {}
        while len(wanted) < random.integers(1, 5):
            count = int(random.integers(1, 3))
            real = 0.0 if random.random() < 0.2 else -(10 ** random.uniform(-2, 4))
            imaginary = 0.0 if random.random() < 0.6 else 10 ** random.uniform(-1, 3)
            # What is nearer than a hundredth to another, or to its own conjugate, is a question of digits, asked below.
            if 0 < imaginary < 1e-2 * abs(real):
                continue
            if all(abs(complex(real, imaginary) - z) > 1e-2 * abs(z) for z in wanted):
                wanted |= {complex(real, sign * imaginary): count for sign in (1, -1)}
        roots = [z for z, count in wanted.items() for _ in range(count)]
        found = poles_of(np.poly(roots).real * 10 ** random.uniform(-3, 3))

        assert sum(pole.multiplicity for pole in found) == len(roots)
        for pole in found:
            nearest = min(wanted, key=lambda z: abs(z - pole.at))
            assert (pole.multiplicity, pole.side) == (wanted[nearest], np.sign(nearest.real)), wanted


def test_what_the_coefficients_tell_apart_is_told_apart() -> None:
    """Two poles a thousandth apart are two; two that differ by less than the coefficients' digits are one."""
    assert [pole.multiplicity for pole in poles_of(np.poly([-1.0, -1.001]))] == [1, 1]
    assert [pole.multiplicity for pole in poles_of(np.poly([-1.0, -1.0 - 1e-12]))] == [2]


def test_a_slow_pole_beside_a_fast_one_isnt_an_integrator() -> None:
    """The electrical pole of a servo is at thousands, and that says nothing of how exactly a slow one is known."""
    assert stability(system(*np.poly([-1e-6, -7241.0]))).verdict == "stable"
    assert stability(system(*np.poly([1e-6, -7241.0]))).verdict == "unstable"


@pytest.mark.parametrize(
    ("numerator", "denominator", "verdict", "bibo"),
    [
        ((1.0, 0.0), (0.1, 1.0, 0.0), "marginally stable", True),  # the integrator is cancelled
        ((1.0, -1.0), (1.0, 0.0, -1.0), "unstable", True),  # 1/(s + 1) with a hidden e^t
        ((1.0, 0.0), (1.0, 1.0, 0.0, 0.0), "unstable", False),  # of two integrators one is left
        ((1.0, 0.0, 0.0), (0.1, 1.0), "stable", False),  # it differentiates
        ((2.0,), (3.0,), "stable", True),
    ],
)
def test_bibo_is_about_what_the_output_shows(
    numerator: tuple[float, ...], denominator: tuple[float, ...], verdict: str, bibo: bool
) -> None:
    report = stability(TransferFunction(numerator=numerator, denominator=denominator))
    assert (report.verdict, report.bibo) == (verdict, bibo)
    assert bibo or report.drive is not None or len(numerator) > len(denominator)
    assert not (bibo and report.drive)


def test_a_constant_drives_the_motors_position_off_by_its_gain() -> None:
    """K/(s (τs + 1)) answers 1 V by K (t - τ (1 - e^(-t/τ))): a slope of K, by algebra."""
    gain, tau = 23.8, 0.0998
    drive = stability(TransferFunction(numerator=(gain,), denominator=(tau, 1.0, 0.0), unit="rad/V")).drive
    assert drive is not None
    t = np.linspace(0, 2.5, 26)

    assert isinstance(drive.signal, Constant)
    assert (drive.coefficient, drive.power, drive.rate) == (pytest.approx(gain, rel=1e-12), 1, 0.0)
    np.testing.assert_allclose(drive.simulate(t), gain * (t - tau * (1 - np.exp(-t / tau))), atol=1e-9)
    assert "23.8 rad/V for each s" in drive.sentence


@pytest.mark.parametrize(
    ("numerator", "denominator"),
    [
        ((1.0,), (1.0, 0.0, 4.0)),
        ((3.0, 1.0), tuple(np.poly([-1.0, 5j, -5j]).real)),
        ((1.0,), tuple(np.poly([2j, -2j, 2j, -2j]).real)),
        ((1.0,), (1.0, 0.0, 0.0)),
        ((1.0, 2.0), tuple(np.poly([0.5, -1.0]))),
        ((3.0,), tuple(np.poly([0.3 + 2j, 0.3 - 2j]).real)),
        ((1.0,), tuple(np.poly([0.4, 0.4, -2.0]))),
    ],
)
def test_the_drive_is_bounded_and_the_output_grows_as_it_says(
    numerator: tuple[float, ...], denominator: tuple[float, ...]
) -> None:
    """SciPy simulates the same input through the same system, by another route: states, and the input on straight lines."""
    drive = stability(TransferFunction(numerator=numerator, denominator=denominator)).drive
    assert drive is not None
    t = np.linspace(0, 40, 40_001)
    u = drive.signal(t)
    _, y, _ = lsim((numerator, denominator), u, t)

    assert np.abs(u).max() <= 1
    np.testing.assert_allclose(drive.simulate(t), y, atol=1e-5 * np.abs(y).max())
    # What isn't of the growing mode falls behind it as 1/t (or e^(-rate t)): for the slowest of these, the double pole at 0.4,
    # te^(0.4 t) (1 + c/t) with c = -(1/0.4 + 1/2.4) = -2.9, which is 7 to 8 % there.
    late = t > 35
    grown = drive.coefficient * t[late] ** drive.power * np.exp(drive.rate * t[late])
    ratio = (np.abs(y[late]) / grown).max()
    assert ratio == pytest.approx(1, abs=0.09)


def test_of_poles_on_the_axis_the_one_with_most_growth_is_driven() -> None:
    """1/(s² (s² + 4)) = (1/4)/s² - …: a constant gives t²/8, which outgrows the t that a sinusoid of 2 rad/s gives."""
    drive = stability(system(1.0, 0.0, 4.0, 0.0, 0.0)).drive
    assert drive is not None
    assert (drive.pole, drive.power) == (0, 2)
    assert drive.coefficient == pytest.approx(1 / 8, rel=1e-12)


def test_growth_counts_the_poles_that_no_zero_cancels() -> None:
    """s/(s² (s + 1)) is 1/(s (s + 1)), whose slope after a constant is 1."""
    drive = stability(TransferFunction(numerator=(1.0, 0.0), denominator=(1.0, 1.0, 0.0, 0.0))).drive
    assert drive is not None
    assert (drive.power, drive.coefficient) == (1, pytest.approx(1.0, rel=1e-12))


def test_a_triple_pole_on_the_right_grows_as_partial_fractions_say() -> None:
    """1/(s (s - 1/2)³) has 2/(s - 1/2)³ as its fastest fraction: t² e^(t/2)."""
    drive = stability(system(*np.poly([0.5, 0.5, 0.5]))).drive
    assert drive is not None
    assert (drive.power, drive.rate) == (2, pytest.approx(0.5, rel=1e-12))
    assert drive.coefficient == pytest.approx(1.0, rel=1e-12)


def test_a_delay_moves_the_growth_and_changes_no_verdict() -> None:
    delayed = TransferFunction(numerator=(20.0,), denominator=(0.1, 1.0, 0.0), delay=0.5)
    report = stability(delayed)
    assert report.verdict == "marginally stable"
    assert report.drive is not None
    assert (report.drive.coefficient, report.drive.power) == (pytest.approx(20.0), 1)
    # After a second of the 1.5 s the double pole's 20 t has lost 20 τ, and e^(-10) of it has come back.
    assert report.drive.simulate(np.array([0.4, 1.5])) == pytest.approx([0.0, 18.0], abs=2e-4)


def test_an_oscillator_is_driven_at_its_own_frequency() -> None:
    drive = stability(system(1.0, 0.0, 4.0)).drive
    assert drive is not None
    assert isinstance(drive.signal, Sine)
    assert 2 * math.pi * drive.signal.frequency == pytest.approx(2.0, rel=1e-14)
    # sin 2t through 1/(s² + 4) is (sin 2t - 2t cos 2t)/8: its envelope grows by a quarter a second.
    assert drive.coefficient == pytest.approx(0.25, rel=1e-12)


def test_a_number_below_zero_has_a_minus_sign() -> None:
    said = stability(system(1.0, 0.2, 1.0)).reasons + stability(system(1e-6, 1.0)).reasons
    assert [each.partition(" is ")[0] for each in said] == [
        "The pole at −0.1 ±0.995j 1/s",  # √(1 - 0.1²) = 0.99499
        "The pole at −1000000 1/s",
    ]


def test_a_system_that_is_zero_is_driven_off_by_nothing() -> None:
    report = stability(TransferFunction(numerator=(0.0,), denominator=(1.0, 0.0)))
    assert (report.bibo, report.drive) == (True, None)
    assert not any("drives it without bound" in reason for reason in report.reasons)


def test_a_double_pole_to_the_right_grows_faster_than_its_exponential() -> None:
    # 1/(s - 1)² and 1/(s - 1)³ answer 1 by e^t (t - 1) + 1 and e^t (t²/2 - t + 1) - 1, by partial fractions.
    for power, said in ((2, "grows as t · e^(1/s · t)"), (3, "grows as t² · e^(1/s · t)")):
        drive = stability(system(*np.poly([1.0] * power))).drive
        assert drive is not None
        assert said in drive.sentence


def test_a_pole_of_which_a_zero_takes_a_part_is_reported_with_what_is_left_to_be_seen() -> None:
    # s/s² is one integrator to the output, which nothing but an input moves.
    (said,) = stability(TransferFunction(numerator=(1.0, 0.0), denominator=(1.0, 0.0, 0.0))).reasons
    assert "Zeros cancel part of it: the output shows it once only" in said
