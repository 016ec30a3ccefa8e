"""What a model's curves look like within the uncertainty of its parameters: a band of 95 % at each point.

To first order the variance of f(θ) is g Σ g', with the gradient g of f by the parameters and their covariance Σ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from servobench.channels import Array
from servobench.estimators.base import Fit
from servobench.models.base import Model, Output
from servobench.transfer_function import TransferFunction

TWO_SIDED = 1.959964  # standard deviations on each side of a 95 % interval
Complex: TypeAlias = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyBand:
    """A frequency response at ω (N,) [rad/s]: magnitude, phase [rad], and half of their 95 % intervals.

    The magnitude's is a factor's logarithm: the band goes from |G| e^(-half) to |G| e^(+half). NaN where it isn't known.
    """

    omega: Array
    magnitude: Array
    phase: Array
    magnitude_half: Array
    phase_half: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class StepBand:
    """A step response at t (N,) [s] to a step of one unit of input, with half of its 95 % interval (NaN where unknown)."""

    t: Array
    y: Array
    half: Array


@dataclass(frozen=True, kw_only=True)
class PoleBand:
    """A pole [1/s] with half of the 95 % intervals of its real and its imaginary part."""

    pole: complex
    half: complex


def frequency_band(fit: Fit, omega: Array, output: Output = "speed") -> FrequencyBand:
    """Return the frequency response of the fit's linear part at ω (N,) [rad/s], with its band."""
    system = fit.model.transfer_function(output)
    response = system.frequency_response(omega)
    # dG/G: its real part changes the magnitude's logarithm, its imaginary part the phase.
    gradient = _gradient(fit, lambda shifted: shifted.frequency_response(omega), output) / response[:, None]
    return FrequencyBand(
        omega=omega,
        magnitude=np.abs(response),
        phase=_continuous_phase(system, omega),
        magnitude_half=TWO_SIDED * _sd(_without_rounding(gradient.real, gradient), fit.covariance),
        phase_half=TWO_SIDED * _sd(_without_rounding(gradient.imag, gradient), fit.covariance),
    )


def step_band(fit: Fit, t: Array, output: Output = "speed") -> StepBand:
    """Return the response of the fit's linear part to a step of one unit at t = 0, at even times t (N,) [s] from 0 on."""

    def response(system: TransferFunction) -> Complex:
        return np.asarray(step_response(system, t), dtype=np.complex128)

    gradient = _gradient(fit, response, output)
    return StepBand(
        t=t,
        y=step_response(fit.model.transfer_function(output), t),
        half=TWO_SIDED * _sd(gradient.real, fit.covariance),
    )


def pole_bands(fit: Fit, output: Output = "speed") -> tuple[PoleBand, ...]:
    """Return the poles of the fit's linear part, slowest first, each with half of its interval."""
    poles = fit.model.transfer_function(output).poles
    gradient = _gradient(fit, lambda shifted: _matched(shifted.poles, poles), output)
    real = TWO_SIDED * _sd(gradient.real, fit.covariance)
    imaginary = TWO_SIDED * _sd(gradient.imag, fit.covariance)
    return tuple(
        PoleBand(pole=complex(pole), half=complex(a, b))
        for pole, a, b in zip(poles, real, imaginary, strict=True)
    )


def coefficient_halves(fit: Fit, output: Output = "speed") -> Array:
    """Return half of the 95 % interval of each coefficient of the transfer function: numerator, denominator, delay."""

    def coefficients(system: TransferFunction) -> Complex:
        return np.array([*system.numerator, *system.denominator, system.delay], dtype=np.complex128)

    return TWO_SIDED * _sd(_gradient(fit, coefficients, output).real, fit.covariance)


def step_response(system: TransferFunction, t: Array) -> Array:
    """Return the response (N,) to a unit step at t = 0, from rest, at times t (N,) [s].

    Exact at any times: y(t) = C ∫ e^(Ax) B dx + D, where the integral is a block of one matrix exponential (Van Loan 1978).
    """
    from scipy.linalg import expm

    # The controllable canonical form: ẋ₁ = -a·x + u, ẋₖ₊₁ = xₖ, y = c·x + d u.
    order = len(system.denominator) - 1
    a = np.array(system.denominator) / system.denominator[0]
    b = np.zeros(order + 1)
    b[order + 1 - len(system.numerator) :] = np.array(system.numerator) / system.denominator[0]
    block = np.zeros((order + 1, order + 1))
    if order:
        block[0] = [*-a[1:], 1.0]
        block[1:order, : order - 1] = np.eye(order - 1)
    later = t - system.delay
    states = expm(block * np.maximum(later, 0.0)[:, None, None])[:, :order, order]
    return np.where(later >= 0, states @ (b[1:] - b[0] * a[1:]) + b[0], 0.0)


def _gradient(fit: Fit, function: Callable[[TransferFunction], Complex], output: Output) -> Complex:
    """The derivatives of function(G) (N,) by the parameters as columns (N, P), by central differences.

    The differences are a hundredth of a standard deviation or a thousandth of the value wide, whichever is less: narrow to the
    curvature of anything that has an interval at all, and wide to the rounding of the machine.
    """
    model = fit.model
    sd = np.sqrt(np.diag(fit.covariance))
    columns = []
    for n, value in enumerate(model.theta):
        size = max(1e-3 * abs(float(value)), 1e-9)
        width = min(0.01 * sd[n], size) if np.isfinite(sd[n]) and sd[n] > 0 else size
        after, before = (function(_shifted(model, n, side * width, output)) for side in (1.0, -1.0))
        columns.append((after - before) / (2 * width))
    return np.column_stack(columns)


def _shifted(model: Model, n: int, by: float, output: Output) -> TransferFunction:
    theta = model.theta.copy()
    theta[n] += by
    return model.structure.transfer_function(theta, output, model.data)


def _matched(poles: Complex, order: Complex) -> Complex:
    """The poles in the order of those that they are nearest to: the order of a conjugate pair is arbitrary."""
    return np.array([poles[np.argmin(np.abs(poles - pole))] for pole in order], dtype=np.complex128)


def _without_rounding(part: Array, gradient: Complex) -> Array:
    """The real or imaginary part of a gradient, with zeros where nothing but rounding is left of it.

    Or a delay that nobody knows would take the magnitude's band with it, which it has no part in.
    """
    return np.where(np.abs(part) > 1e-5 * np.abs(gradient), part, 0.0)


def _sd(gradient: Array, covariance: Array) -> Array:
    """The standard deviations sqrt(g Σ g') for the rows g of a gradient (N, P); NaN where an unknown parameter matters."""
    unknown = ~np.isfinite(np.diag(covariance))
    known = np.where(unknown[:, None] | unknown[None, :], 0.0, covariance)
    variance = np.einsum("ni,ij,nj->n", gradient, known, gradient)
    matters = np.any(gradient[:, unknown] != 0.0, axis=1)
    return np.where(matters, np.nan, np.sqrt(np.maximum(variance, 0.0)))


def _continuous_phase(system: TransferFunction, omega: Array) -> Array:
    """The phase [rad] without jumps; the delay's part is added after, as it may turn fast between two frequencies."""
    ratio = np.polyval(system.numerator, 1j * omega) / np.polyval(system.denominator, 1j * omega)
    return np.asarray(np.unwrap(np.angle(ratio)) - system.delay * omega, dtype=np.float64)
