"""Values of the waveforms by their textbook definitions."""

import math

import numpy as np
import pytest
import scipy.signal

from servobench.core.errors import UsageError
from servobench.systems.signals.pulse import Pulse
from servobench.systems.signals.ramp import Ramp
from servobench.systems.signals.sawtooth import Sawtooth
from servobench.systems.signals.sine import Sine
from servobench.systems.signals.square import Square
from servobench.systems.signals.staircase import Staircase
from servobench.systems.signals.step import Step
from servobench.systems.signals.triangle import Triangle

T = np.linspace(0.0, 10.0, 4001) + 1e-5  # beside the edges


def test_a_square_wave_is_high_in_the_first_half_of_its_period() -> None:
    u = Square(low=1, high=3, frequency=0.4)(np.array([0.0, 1.2499, 1.25, 2.4999, 2.5]))

    np.testing.assert_array_equal(u, [3, 3, 1, 1, 3])


@pytest.mark.parametrize("duty", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_a_square_wave_is_that_of_scipy(duty: float) -> None:
    expected = 2 + scipy.signal.square(2 * math.pi * 0.4 * T + 0.3, duty)

    np.testing.assert_array_equal(Square(frequency=0.4, duty=duty, phase=0.3)(T), expected)


@pytest.mark.parametrize("rise", [0.0, 0.2, 0.5, 1.0])
def test_a_triangle_wave_is_that_of_scipy(rise: float) -> None:
    expected = 2 + scipy.signal.sawtooth(2 * math.pi * 0.4 * T + 0.3, rise)

    wave = Triangle(low=1, high=3, frequency=0.4, rise=rise, phase=0.3)(T)

    np.testing.assert_allclose(wave, expected, rtol=0, atol=1e-12)


def test_a_sawtooth_wave_is_that_of_scipy_and_a_falling_one_is_a_triangle_without_rise() -> None:
    expected = scipy.signal.sawtooth(2 * math.pi * 0.4 * T)

    np.testing.assert_allclose(Sawtooth(low=-1, high=1, frequency=0.4)(T), expected, rtol=0, atol=1e-12)
    falling = Triangle(low=-1, high=1, frequency=0.4, rise=0)(T)
    np.testing.assert_allclose(falling, -expected, rtol=0, atol=1e-12)


def test_a_sine_wave_is_a_sine() -> None:
    wave = Sine(amplitude=2, offset=0.5, frequency=3, phase="90 deg", start=1)(T)

    expected = np.where(T >= 1, 0.5 + 2 * np.sin(2 * math.pi * 3 * (T - 1) + math.pi / 2), 0.5)
    np.testing.assert_allclose(wave, expected, rtol=0, atol=1e-12)


def test_a_phase_of_a_quarter_period_brings_a_square_wave_forward_by_it() -> None:
    u = Square(frequency=1, phase="90 deg")(np.array([0.0, 0.2499, 0.25, 0.7499, 0.75]))

    np.testing.assert_array_equal(u, [3, 3, 1, 1, 3])


def test_a_step_is_final_at_the_very_sample_of_its_start() -> None:
    t = np.arange(1000) * 0.1  # 7 * 0.1 is a rounding above 0.7, 3 * 0.1 above 0.3, and others are below

    for k in range(1000):
        assert int(np.argmax(Step(start=k / 10)(t))) == k


def test_a_pulse_lasts_for_its_width_and_may_go_downwards() -> None:
    u = Pulse(rest=1, level=-2, start=0.5, width=0.2)(np.arange(10) / 10)

    np.testing.assert_array_equal(u, [1, 1, 1, 1, 1, -2, -2, 1, 1, 1])


def test_a_ramp_meets_both_its_values_exactly_and_its_middle_between_them() -> None:
    u = Ramp(initial=0.1, final=-0.7, start=1, duration=2)(np.array([-5, 1, 2, 3, 1e9]))

    np.testing.assert_array_equal(u[[0, 1, 3, 4]], [0.1, 0.1, -0.7, -0.7])
    assert u[2] == pytest.approx(-0.3, abs=1e-15)


def test_a_staircase_holds_each_level_and_stays_at_the_last() -> None:
    u = Staircase(levels=(1, -1, 2), dwell="200 ms", start="0.1 s")(np.arange(10) / 10)

    np.testing.assert_array_equal(u, [1, 1, 1, -1, -1, 2, 2, 2, 2, 2])


@pytest.mark.parametrize("wave", [Square, Triangle, Sawtooth])
def test_a_high_level_below_the_low_one_is_refused(wave: type) -> None:
    with pytest.raises(UsageError, match="high = 3 is below low = 5; exchange them"):
        wave(low=5)


@pytest.mark.parametrize(
    ("signal", "expected"),
    [
        (Square(frequency=2, duty=0.1), 0.05),
        (Square(duty=0), None),
        (Sine(frequency=5), 0.1),
        (Triangle(frequency=1, rise=0.2), 0.2),
        (Triangle(frequency=1, rise=1), 1.0),
        (Sawtooth(frequency=4), 0.25),
        (Staircase(dwell=3), 3.0),
        (Staircase(levels=(1,)), None),
        (Step(), None),
    ],
)
def test_the_shortest_change_is_the_time_between_two_edges_or_half_a_period(
    signal: Square, expected: float | None
) -> None:
    assert signal.shortest_change == (None if expected is None else pytest.approx(expected, rel=1e-12))
