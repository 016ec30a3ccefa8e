"""A model's curves within the uncertainty of its parameters: a band of 95 % at each point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import Fit
from servobench.identification.models.base import Model, Output
from servobench.identification.uncertainty.propagation import (
    Propagation,
    deviation,
    gradient,
    match_order,
    propagate,
)
from servobench.systems.responses import step_response
from servobench.systems.transfer_function import TransferFunction

__all__ = [
    "FrequencyBand",
    "PoleBand",
    "StepBand",
    "coefficient_halves",
    "frequency_band",
    "pole_bands",
    "step_band",
]


@dataclass(frozen=True, kw_only=True, eq=False)
class FrequencyBand:
    """A frequency response at `omega` (N,) [rad/s]: magnitude, phase [rad], and half of their 95 % intervals.

    `phase_half` is in rad, `magnitude_half` is a factor's logarithm: the band goes from |G| e^(-half) to |G| e^(+half). NaN
    where it isn't known.
    """

    omega: Array
    magnitude: Array
    phase: Array
    magnitude_half: Array
    phase_half: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class StepBand:
    """A step response y (N,) at t (N,) [s] to a step of one unit of input, with half of its 95 % interval (NaN where unknown)."""

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

    def logarithm(model: Model) -> Array:
        system = model.transfer_function(output)
        ratio = _rational(system, omega)
        # The delay's part comes after: it has none in the magnitude, and may turn fast between two frequencies.
        return np.concatenate([np.log(np.abs(ratio)), np.unwrap(np.angle(ratio)) - system.delay * omega])

    propagation = propagate(fit, logarithm)
    half = _half(propagation)
    count = len(omega)
    return FrequencyBand(
        omega=omega,
        magnitude=np.exp(propagation.value[:count]),
        phase=propagation.value[count:],
        magnitude_half=half[:count],
        phase_half=half[count:],
    )


def step_band(fit: Fit, t: Array, output: Output = "speed") -> StepBand:
    """Return the response of the fit's linear part to a step of one unit at t = 0, at times t (N,) [s] from 0 on."""
    propagation = propagate(fit, lambda model: step_response(model.transfer_function(output), t))
    return StepBand(t=t, y=propagation.value, half=_half(propagation))


def pole_bands(fit: Fit, output: Output = "speed") -> tuple[PoleBand, ...]:
    """Return the poles of the fit's linear part, slowest first, each with half of its interval."""
    poles = fit.model.transfer_function(output).poles

    def parts(model: Model) -> Array:
        now = match_order(model.transfer_function(output).poles, poles)
        return np.concatenate([now.real, now.imag])

    real, imaginary = np.split(_half(propagate(fit, parts)), 2)
    return tuple(
        PoleBand(pole=complex(pole), half=complex(a, b))
        for pole, a, b in zip(poles, real, imaginary, strict=True)
    )


def coefficient_halves(fit: Fit, output: Output = "speed") -> Array:
    """Return half of the 95 % interval of each coefficient (N,) of the transfer function: numerator, denominator, delay."""

    def coefficients(model: Model) -> Array:
        system = model.transfer_function(output)
        return np.array([*system.numerator, *system.denominator, system.delay])

    return TWO_SIDED * deviation(gradient(fit, coefficients), fit.covariance)


def _half(propagation: Propagation) -> Array:
    """The larger of the two sides of each interval: a band that is drawn evenly about its curve holds the whole interval."""
    return np.maximum(propagation.high - propagation.value, propagation.value - propagation.low)


def _rational(system: TransferFunction, omega: Array) -> NDArray[np.complex128]:
    ratio = np.polyval(system.numerator, 1j * omega) / np.polyval(system.denominator, 1j * omega)
    return np.asarray(ratio, dtype=np.complex128)
