"""Frequency response: points against the algebra of a linear motor, what is left out, what is refused, what is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.errors import NotIdentifiable, UsageError
from servobench.identification.estimators.base import ESTIMATORS, is_regular
from servobench.identification.estimators.frequency_response import (
    FrequencyResponse,
    bode_readings,
    frequency_response,
)
from servobench.identification.estimators.spectral.path import chain_response, hold_response
from servobench.identification.estimators.spectral.sines import sines
from servobench.identification.models.base import STRUCTURES
from servobench.identification.uncertainty.bands import frequency_band
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.report.frequency_figures import measured_bode
from servobench.report.palette import Style
from servobench.systems.signals.multisine import Multisine
from servobench.systems.transfer_function import TransferFunction
from tests.datasets import dataset
from tests.rig.motor.reference import Truth, march
from tests.truth.test_frequency_bands import SAMPLES, Array, Motor, T, binary, multisine, record, square

NYQUIST = np.pi / T
RANDOM = np.random.default_rng(1)


def clean(u: Array, kind: str, motor: Motor | None = None, chain: str = "") -> Dataset:
    """The motor's position or speed, with noise of a nanoradian only, or of that a second."""
    angle, speed = (motor or Motor()).states(u, np.random.default_rng(2))
    y = angle if kind == "position" else speed
    return record(u, y + 1e-9 * np.random.default_rng(3).standard_normal(len(u)), kind, chain)


def check_exact(found: FrequencyResponse, motor: Motor | None = None, below: float = 0.5 * NYQUIST) -> None:
    """Within a part in a million, and 6 standard deviations: what noise of a nanoradian leaves."""
    speed = found.as_speed()
    near = speed.omega < below
    assert near.sum() >= 5
    off = np.abs(speed.response - (motor or Motor()).response(speed.omega))
    assert (off[near] <= 1e-6 * speed.magnitude[near] + 6 * speed.sd[near]).all()
    assert (speed.sd[near] <= 0.01 * speed.magnitude[near]).any()


SYSTEMS = (
    TransferFunction(numerator=(20.0,), denominator=(0.1, 1.0), delay=0.013),
    TransferFunction(numerator=(20.0,), denominator=(0.1, 1.0, 0.0)),
    TransferFunction(numerator=(-6400.0, 1600.0), denominator=(1.0, 5.0, 408.0, 416.0, 1600.0), delay=-0.003),
)


@pytest.mark.parametrize("system", SYSTEMS, ids=["delayed", "integrating", "fourth order"])
def test_the_response_behind_a_hold_is_the_sum_over_all_aliases(system: TransferFunction) -> None:
    """Σ G(jω_m) (1 - e^(-jω_m T))/(jω_m T) over ω_m = ω + 2πm/T. What is left out beyond m = ±M is 1/M² at most."""
    omega, step, most = np.array([0.5, 5.0, 50.0, 200.0, 300.0]), 0.01, 100_000
    alias = omega + 2 * np.pi / step * np.arange(-most, most + 1)[:, None]
    hold = -np.expm1(-1j * alias * step) / (1j * alias * step)
    total = np.sum(system.frequency_response(alias.ravel()).reshape(alias.shape) * hold, axis=0)
    np.testing.assert_allclose(hold_response(system, omega, step), total, rtol=1e-9)


def test_a_system_whose_output_jumps_with_the_input_is_refused() -> None:
    jumping = TransferFunction(numerator=(1.0, 2.0), denominator=(1.0, 1.0))
    with pytest.raises(UsageError, match="jumps"):
        hold_response(jumping, np.array([1.0]), 0.01)


@pytest.mark.parametrize(
    "text",
    [
        "lowpass 50 rad/s",
        "derivative | lowpass 8 Hz euler",
        "average 25 ms",
        "tachometer 33 ms | lowpass 1 rad/s zoh",
    ],
)
def test_the_response_of_a_chain_is_what_it_makes_of_a_sine_in_the_end(text: str) -> None:
    omega, chain = np.array([0.5, 5.0, 50.0, 300.0]), Chain.parse(text)
    t = 0.01 * np.arange(4000)  # forty time constants of the slowest filter
    cosine, sine = chain(np.cos(np.outer(t, omega)), t), chain(np.sin(np.outer(t, omega)), t)
    steady = (cosine[-1] + 1j * sine[-1]) * np.exp(-1j * omega * t[-1])
    np.testing.assert_allclose(chain_response(chain, omega, 0.01), steady, rtol=1e-8)


@pytest.mark.parametrize("kind", ["position", "speed"])
def test_points_of_a_square_wave_are_exact_and_at_odd_harmonics_only(kind: str) -> None:
    """The position is a ramp with a ripple, by offset and mean; nothing of it leaks."""
    found = frequency_response(clean(square(SAMPLES), kind))
    harmonic = found.omega / (2 * np.pi / (500 * T))
    np.testing.assert_allclose(harmonic % 2, 1.0, atol=1e-9)
    assert found.omega[-1] < NYQUIST
    assert found.left_out == SAMPLES // 2 - 1 - len(found.omega)
    assert str(found.left_out) in found.findings[0].sentence
    check_exact(found)


@pytest.mark.parametrize("kind", ["position", "speed"])
def test_points_of_an_input_that_does_not_repeat_are_free_of_leakage(kind: str) -> None:
    """The plain ratio of spectra is off by a few per cent on the same data, by what the record's ends leave."""
    u = binary(SAMPLES, 20, np.random.default_rng(4))
    data = clean(u, kind)
    check_exact(frequency_response(data))
    y = data.y if kind == "speed" else np.gradient(data.y, T)
    k = np.arange(3, 60)
    omega = 2 * np.pi * k / (SAMPLES * T)
    hold = -np.expm1(-1j * omega * T) / (1j * omega * T)
    ratio = np.fft.fft(y)[k] / np.fft.fft(u)[k] / hold
    assert np.median(np.abs(ratio / Motor().response(omega) - 1)) > 0.01


def test_delay_chain_and_device_are_divided_out() -> None:
    motor = Motor(delay=0.3 * T)
    u = 2 + multisine(500, np.arange(1, 100, 2), np.random.default_rng(5))
    filtered = clean(u, "position", motor, "derivative | lowpass 50 rad/s")
    check_exact(frequency_response(filtered), motor)
    told = frequency_response(replace(filtered, delay=0.3 * T))
    check_exact(told, Motor())


def test_position_and_speed_are_jomega_apart_and_in_their_units() -> None:
    found = frequency_response(clean(square(SAMPLES), "position"))
    speed = found.as_speed()
    assert (found.output, found.unit, speed.output, speed.unit) == ("position", "rad/V", "speed", "rad/(s·V)")
    np.testing.assert_allclose(speed.response, 1j * found.omega * found.response)
    np.testing.assert_allclose(speed.sd / speed.magnitude, found.sd / found.magnitude)


def test_the_package_s_own_multisine_gives_a_point_for_each_of_its_harmonics() -> None:
    signal = Multisine(
        frequency=0.5, highest=20.0, harmonics="odd", phases="random", seed=3, offset=2.0, amplitude=1.0
    )
    u = signal(T * np.arange(SAMPLES))
    found = frequency_response(clean(u, "speed"))
    np.testing.assert_allclose(found.omega, 2 * np.pi * 0.5 * np.arange(1, 40, 2), rtol=1e-12)
    check_exact(found)
    assert found.detection is not None
    assert found.coherence.min() > 0.999


def stepped(frequencies: tuple[float, ...], each: int) -> Array:
    """Sines about 2 V, one after the other."""
    t = T * np.arange(each)
    return 2 + np.concatenate([np.sin(2 * np.pi * f * t) for f in frequencies])


def test_stepped_sines_give_a_point_for_each() -> None:
    frequencies = (0.31, 0.73, 1.37, 2.9, 5.3)
    found = frequency_response(clean(stepped(frequencies, 4000), "position"))
    np.testing.assert_allclose(found.omega, 2 * np.pi * np.array(frequencies), rtol=1e-6)
    check_exact(found)


def test_one_measured_sine_gives_one_point_and_no_fit() -> None:
    u = stepped((0.7123,), 3000) + 1e-3 * np.random.default_rng(6).standard_normal(3000)
    data = clean(u, "speed")
    found = frequency_response(data)
    assert len(found.omega) == 1
    # Frequency from 3000 noisy samples: √6 1e-3/(π 12 s √3000) = 1.2e-6 Hz.
    assert found.omega[0] == pytest.approx(2 * np.pi * 0.7123, abs=5 * 2 * np.pi * 1.2e-6)
    assert found.magnitude[0] == pytest.approx(abs(Motor().response(found.omega)[0]), rel=1e-4)
    with pytest.raises(NotIdentifiable, match="record more frequencies"):
        ESTIMATORS["frequency_response"].fit(STRUCTURES["first_order"], [data])
    with pytest.raises(NotIdentifiable, match="at least two"):
        bode_readings(found)


@pytest.mark.parametrize(
    "u", [square(SAMPLES), binary(SAMPLES, 20, RANDOM), multisine(500, np.arange(1, 9), RANDOM)]
)
def test_what_is_no_sine_is_not_taken_for_one(u: Array) -> None:
    assert sines(u) == []


def test_records_of_single_sines_are_read_together() -> None:
    delay = 0.4 * T
    records = [clean(stepped((f,), 3000), "speed", Motor(delay=delay)) for f in (0.3, 0.9, 2.2, 6.1)]
    found = bode_readings(frequency_response(records))
    # Noise of 1e-9 rad/s: what is left is the rounding of each sine's frequency, which is found to 1e-9 of a cycle a sample.
    assert found["gain"].value == pytest.approx(23.0, rel=1e-5)
    assert found["corner"].value == pytest.approx(10.0, rel=1e-4)
    assert found["time_constant_from_magnitude"].value == pytest.approx(0.1, rel=1e-4)
    assert found["time_constant_from_phase"].value == pytest.approx(0.1, rel=1e-4)
    assert found["delay_from_phase"].value == pytest.approx(delay, abs=1e-3 * T)


def test_a_motor_that_turns_the_other_way_has_a_negative_gain_and_the_same_corner() -> None:
    u = 2 + multisine(500, np.arange(1, 60, 2), np.random.default_rng(7))
    found = bode_readings(frequency_response(clean(u, "speed", Motor(gain=-23.0, speed=-30.0))))
    assert found["time_constant_from_phase"].value == pytest.approx(0.1, rel=1e-4)


def test_the_offset_that_a_response_does_not_show_is_fitted_with_the_rest_held() -> None:
    u = square(SAMPLES)
    y = Motor().states(u, RANDOM)[0] + 1e-3 * np.random.default_rng(8).standard_normal(SAMPLES)
    fit = ESTIMATORS["frequency_response"].fit(STRUCTURES["first_order"], [record(u, y, "position")])
    assert 0 < fit["offset_voltage"].sd < 0.01
    assert abs(fit["offset_voltage"].value - 0.2) < 4 * fit["offset_voltage"].sd
    # What it is uncertain by is what the gain is: the mean speed 23 (2 - 0.2) has to stay.
    correlation = fit.covariance / np.sqrt(np.outer(np.diag(fit.covariance), np.diag(fit.covariance)))
    names = list(fit.model.names)
    assert correlation[names.index("gain"), names.index("offset_voltage")] > 0.9


@pytest.mark.parametrize("digits", [16, 6])
def test_lines_that_a_tachometer_does_not_show_tell_nothing(digits: int) -> None:
    """A slope over 80 ms is silent at every odd multiple of 12.5 Hz, the 25th harmonic of the square; rounding stands there."""
    angle = Motor().states(square(SAMPLES), RANDOM)[0] + 1e-3 * np.random.default_rng(8).standard_normal(
        SAMPLES
    )
    plain = record(square(SAMPLES), angle, "position")
    sloped = record(square(SAMPLES), angle, "position", "tachometer 80 ms")
    sloped = replace(sloped, y=np.round(sloped.y, digits - 2))  # tens of rad/s
    omega = frequency_response(sloped).omega

    assert np.min(np.abs(omega - 2 * np.pi * 12.5)) > 2 * np.pi * 0.4
    fits = [
        ESTIMATORS["frequency_response"].fit(STRUCTURES["first_order"], [data]) for data in (plain, sloped)
    ]
    for name, truth in (("gain", 23.0), ("time_constant", 0.1)):
        own, behind = (fit[name] for fit in fits)
        assert abs(behind.value - truth) < 4 * behind.sd
        # The noise is the same but for what 60 degrees of freedom leave open of its level, 4 · 13 %/2, and the lines left out.
        assert behind.sd == pytest.approx(own.sd, rel=0.4)


def test_a_rational_structure_is_fitted_too() -> None:
    u = binary(SAMPLES, 20, np.random.default_rng(9))
    fit = ESTIMATORS["frequency_response"].fit(STRUCTURES["rational_1_0_integrator"], [clean(u, "position")])
    assert fit["a1"].value == pytest.approx(10.0, rel=1e-5)
    assert fit["b0"].value == pytest.approx(230.0, rel=1e-5)


def test_a_structure_that_misses_the_points_is_reported_and_its_intervals_are_wider() -> None:
    """Two lags of 100 and 30 ms, their speed by superposition: K (100 e₁ - 30 e₂)/70, and noise of 0.05 rad/s."""
    u = 2 + multisine(500, np.arange(1, 60, 2), np.random.default_rng(10))
    slow, fast = (Motor(tau=tau).states(u, RANDOM)[1] for tau in (0.1, 0.03))
    y = (0.1 * slow - 0.03 * fast) / 0.07 + 0.05 * np.random.default_rng(11).standard_normal(SAMPLES)
    data = record(u, y, "speed")
    first = ESTIMATORS["frequency_response"].fit(STRUCTURES["first_order"], [data])
    assert "response-misfit" in {finding.code for finding in first.findings}
    points = frequency_response(data)
    truth = 23.0 / ((1 + 0.1j * points.omega) * (1 + 0.03j * points.omega))
    off = np.abs(points.response - truth)
    # The points themselves are right, but for the aliases of the hold: those of a lag that isn't there, (ωT)²/12 of the point.
    assert (off <= 4 * points.sd + points.magnitude * (points.omega * T) ** 2 / 12).all()
    second = ESTIMATORS["frequency_response"].fit(STRUCTURES["rational_2_0_delay"], [data])
    assert "response-misfit" not in {finding.code for finding in second.findings}
    assert abs(second["a1"].value - (1 / 0.1 + 1 / 0.03)) < 4 * second["a1"].sd


def test_friction_with_reversals_is_reported_and_its_bias_is_there() -> None:
    """The reference motor: Coulomb friction takes 0.16 V of ±3 V; a linear response is smaller by about a twentieth."""
    t = T * np.arange(SAMPLES)
    u = binary(SAMPLES, 20, np.random.default_rng(12))
    y = march(Truth(), u, T)[:, 2]
    found = frequency_response(replace(record(u, y, "position"), t_input=t))
    assert "friction-in-response" in {finding.code for finding in found.findings}
    r, _, k, _, b, _ = Truth()
    fit = ESTIMATORS["frequency_response"].fit(STRUCTURES["first_order"], [record(u, y, "position")])
    assert 0.8 < fit["gain"].value / (k / (r * b + k * k)) < 0.98
    refused = ESTIMATORS["frequency_response"].supports(
        STRUCTURES["first_order_coulomb"], [record(u, y, "position")]
    )
    assert refused is not None
    assert "friction" in refused.sentence


def test_what_can_not_be_transformed_is_refused_with_its_reason() -> None:
    data = clean(square(SAMPLES), "position")
    with pytest.raises(NotIdentifiable, match="irregular"):
        frequency_response(
            replace(data, t_output=data.t_output + 0.3 * T * np.random.default_rng(13).random(SAMPLES))
        )
    with pytest.raises(NotIdentifiable, match="input doesn't change"):
        frequency_response(replace(data, u=np.full(SAMPLES, 2.0)))
    with pytest.raises(NotIdentifiable, match="too few"):
        frequency_response(data.part(0.0, 40 * T))
    with pytest.raises(UsageError, match="position and speed"):
        frequency_response([data, replace(clean(square(SAMPLES), "speed"), output_unit="rad")])
    with pytest.raises(UsageError, match="at least one"):
        frequency_response([])


def test_rounding_that_repeats_with_the_period_is_not_taken_for_none() -> None:
    """About standstill an ideal encoder shows every period the same, so nothing between the harmonics tells of its rounding."""
    quantum = 2 * np.pi / 2048
    u = 0.2 + 0.5 * multisine(500, np.arange(1, 40, 2), np.random.default_rng(14), 4000)
    motor = Motor(speed=0.0)
    angle, _ = motor.states(u, RANDOM)
    data = record(u, (np.floor(angle / quantum) + 0.5) * quantum, "position", quantum=quantum)
    steady = data.part(2000 * T, 4000 * T)
    points = frequency_response(steady).as_speed()
    within = np.abs(points.response - motor.response(points.omega)) <= np.sqrt(-2 * np.log(0.05)) * points.sd
    assert within.mean() >= 0.9


def test_the_figure_has_points_curve_and_coherence() -> None:
    data = clean(square(SAMPLES), "position")
    fit = ESTIMATORS["frequency_response"].fit(STRUCTURES["first_order"], [data])
    found = frequency_response(data).as_speed()
    figure = measured_bode(found, frequency_band(fit, np.geomspace(1.0, 500.0, 50)), Style())
    magnitude, phase, coherence = figure.axes
    drawn = magnitude.lines[0].get_xydata()
    np.testing.assert_allclose(drawn, np.column_stack([found.omega, 20 * np.log10(found.magnitude)]))
    assert len(phase.lines) == 4  # points, curve, the two edges of its band
    np.testing.assert_allclose(coherence.lines[0].get_ydata(), found.coherence)
    assert len(measured_bode(found, None, Style(width=400)).axes) == 3


def test_an_input_that_began_before_the_output_is_no_irregular_time() -> None:
    """A record that begins in mid-motion loses the first samples of its output, not those of its input."""
    data = dataset(seed=1, kind="prbs", samples=4000)
    later = replace(data, t_output=data.t_output[7:], y=data.y[7:])

    assert is_regular(later)
    # The lines of 7 samples less lie elsewhere by 2 parts in 1,000, and there are about as many.
    whole, part = (frequency_response(each) for each in (data, later))
    assert len(part.omega) == pytest.approx(len(whole.omega), rel=0.1)


def test_a_hole_in_the_output_is_an_irregular_time() -> None:
    data = dataset(seed=1, kind="prbs", samples=4000)

    assert not is_regular(replace(data, t_output=np.delete(data.t_output, 100), y=np.delete(data.y, 100)))
