"""Truth: the algebra of a first-order lag, G = K e^(-ds)/(τs + 1), and of textbook step responses."""

import numpy as np
import pytest

from servobench.core.rounding import TWO_SIDED
from servobench.identification.uncertainty.bands import (
    coefficient_halves,
    frequency_band,
    pole_bands,
    step_band,
)
from servobench.systems.responses import step_response
from servobench.systems.transfer_function import TransferFunction
from tests.report.makers import fit_of

K, TAU, OFFSET, D = 20.0, 0.1, 0.3, 0.002
OMEGA = np.geomspace(0.1, 1000, 50)
COVARIANCE = np.array(
    [
        [4e-2, 1e-4, 0.0, 1e-6],
        [1e-4, 1e-6, 0.0, -2e-8],
        [0.0, 0.0, 1e-4, 0.0],
        [1e-6, -2e-8, 0.0, 1e-8],
    ]
)
FIT = fit_of((K, TAU, OFFSET, D), COVARIANCE)
# Central differences a thousandth of a value wide: their error is about the square of that.
TOLERANCE = 1e-5


def halves(gradient: np.ndarray) -> np.ndarray:
    """Half of the 95 % interval for a gradient (N, 4)."""
    return TWO_SIDED * np.sqrt(np.einsum("ni,ij,nj->n", gradient, COVARIANCE, gradient))


def test_the_magnitude_s_band_is_that_of_the_algebra() -> None:
    # ln|G| = ln K - ln(1 + ω²τ²)/2
    gradient = np.zeros((len(OMEGA), 4))
    gradient[:, 0], gradient[:, 1] = 1 / K, -(OMEGA**2) * TAU / (1 + (OMEGA * TAU) ** 2)

    band = frequency_band(FIT, OMEGA)

    np.testing.assert_allclose(band.magnitude, K / np.sqrt(1 + (OMEGA * TAU) ** 2), rtol=1e-12)
    np.testing.assert_allclose(band.magnitude_half, halves(gradient), rtol=TOLERANCE)


def test_the_phase_and_its_band_are_those_of_the_algebra() -> None:
    # arg G = -atan(ωτ) - ωd
    gradient = np.zeros((len(OMEGA), 4))
    gradient[:, 1], gradient[:, 3] = -OMEGA / (1 + (OMEGA * TAU) ** 2), -OMEGA

    band = frequency_band(FIT, OMEGA)

    np.testing.assert_allclose(band.phase, -np.arctan(OMEGA * TAU) - OMEGA * D, rtol=1e-12)
    np.testing.assert_allclose(band.phase_half, halves(gradient), rtol=TOLERANCE)


def test_the_step_response_and_its_band_are_those_of_the_algebra() -> None:
    t = np.linspace(0.01, 0.5, 40)
    decay = np.exp(-(t - D) / TAU)
    gradient = np.zeros((len(t), 4))
    gradient[:, 0] = 1 - decay
    gradient[:, 1] = -K * decay * (t - D) / TAU**2
    gradient[:, 3] = -K * decay / TAU

    band = step_band(FIT, t)

    np.testing.assert_allclose(band.y, K * (1 - decay), rtol=1e-12)
    np.testing.assert_allclose(band.half, halves(gradient), rtol=TOLERANCE)


def test_the_pole_is_at_minus_one_over_tau_and_its_interval_follows() -> None:
    (band,) = pole_bands(FIT)

    assert band.pole == pytest.approx(-1 / TAU)
    assert band.half.real == pytest.approx(TWO_SIDED * 1e-3 / TAU**2, rel=TOLERANCE)
    assert band.half.imag == 0


def test_the_coefficients_have_the_intervals_of_their_parameters() -> None:
    # K; τ and 1; d
    assert coefficient_halves(FIT) == pytest.approx(
        TWO_SIDED * np.array([0.2, 1e-3, 0.0, 1e-4]), rel=TOLERANCE
    )


def test_a_covered_share_of_95_percent_lies_within_the_band() -> None:
    # Parameters drawn from the covariance: at each frequency 95 % of the curves lie within, ± 3 sd of the share's own error.
    draws = np.random.default_rng(3).multivariate_normal((K, TAU, OFFSET, D), COVARIANCE, 4000)
    band = frequency_band(FIT, OMEGA)
    magnitudes = draws[:, :1] / np.sqrt(1 + (OMEGA * draws[:, 1:2]) ** 2)

    within = np.abs(np.log(magnitudes / band.magnitude)) <= band.magnitude_half

    # sqrt(0.95 · 0.05 / 4000) = 0.0034; the curvature of ln|G| over two standard deviations of 1 % takes another 0.003
    assert np.abs(within.mean(axis=0) - 0.95).max() < 3 * 0.0034 + 0.003


def test_where_an_unknown_parameter_matters_there_is_no_band() -> None:
    covariance = COVARIANCE.copy()
    covariance[3, 3] = np.inf

    band = frequency_band(fit_of((K, TAU, OFFSET, D), covariance), OMEGA)

    assert np.isnan(band.phase_half).all()
    # The delay doesn't change the magnitude, and the row of the delay in the covariance is all that is left out.
    np.testing.assert_allclose(band.magnitude_half, frequency_band(FIT, OMEGA).magnitude_half, rtol=1e-9)


@pytest.mark.parametrize(
    ("numerator", "denominator", "expected"),
    [
        ((1.0,), (1.0, 2.0, 1.0), lambda t: 1 - (1 + t) * np.exp(-t)),  # a double pole
        ((1.0,), (1.0, 0.0), lambda t: t),  # an integrator
        ((2.0,), (1.0, 0.0, 4.0), lambda t: 0.5 * (1 - np.cos(2 * t))),  # no damping
        ((1.0, 0.0), (1.0, 1.0), lambda t: np.exp(-t)),  # a zero at the origin: it jumps
        ((3.0,), (1.0,), lambda t: 3.0 + 0 * t),  # a mere gain
    ],
)
def test_step_responses_of_other_systems_are_those_of_the_textbook(numerator, denominator, expected) -> None:  # type: ignore[no-untyped-def]
    t = np.linspace(0, 6, 25)

    response = step_response(TransferFunction(numerator=numerator, denominator=denominator, delay=0.5), t)

    np.testing.assert_allclose(response[t >= 0.5], expected(t[t >= 0.5] - 0.5), atol=1e-12)
    np.testing.assert_array_equal(response[t < 0.5], 0.0)
