"""Readings of a Bode diagram: gain and time constant from the magnitude alone and from the phase alone, side by side.

    |G| = K/√(1 + ω²τ²): 3 dB below K at ω = 1/τ;   arg G = -atan(ωτ) - ωd: without the delay, -45° there

Both follow from G = K e^(-jωd)/(1 + jωτ). If the two time constants differ by more than their intervals, the motor isn't of
first order, or there is friction.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.estimate import Estimate
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.covariance import inverse
from servobench.identification.estimators.spectral.path import Complex
from servobench.identification.estimators.spectral.response import FrequencyResponse

_CLEAR = (
    0.2  # of a magnitude: points with a larger standard deviation have no logarithm that is near to normal
)
_STEPS = 50


def bode_readings(response: FrequencyResponse) -> dict[str, Estimate]:
    """Return what is read off the points of a frequency response, by name, each with its 95 % interval.

    Of the magnitude: `gain`, `corner` [rad/s], the frequency of the -3 dB point, and its inverse, `time_constant_from_magnitude`.
    Of the phase: `time_constant_from_phase` and `delay_from_phase` [s], as a delay shows in every phase. Each is the likeliest
    for all points, not for the one that happens to be next to the corner. Points with a standard deviation above a fifth of their
    magnitude are left out. Raises `NotIdentifiable` for less than two points.
    """
    speed = response.as_speed()
    clear = speed.sd < _CLEAR * speed.magnitude
    if clear.sum() < 2:
        raise NotIdentifiable(
            f"{int(clear.sum())} points of the frequency response are clear of noise, and at least two are needed: "
            "record more frequencies"
        )
    omega, g = speed.omega[clear], speed.response[clear]
    relative = speed.sd[clear] / np.abs(g)
    by_magnitude = _from_magnitude(omega, np.log(np.abs(g)), relative, speed.unit)
    tau = by_magnitude["time_constant_from_magnitude"].value
    return by_magnitude | _from_phase(omega, g, relative, tau)


def _from_magnitude(omega: Array, level: Array, sd: Array, unit: str) -> dict[str, Estimate]:
    """Fit ln K and ln τ to ln |G|."""

    def model(p: Array) -> tuple[Array, Array]:
        square = (omega * np.exp(p[1])) ** 2
        return p[0] - 0.5 * np.log1p(square), np.column_stack([np.ones(len(omega)), -square / (1 + square)])

    middle = float(np.sqrt(omega[0] * omega[-1]))
    starts = [np.array([level.max(), -np.log(w)]) for w in (omega[0], middle, omega[-1])]
    p, covariance = min((_search(model, level, sd, start) for start in starts), key=lambda end: end[2])[:2]
    spread = np.sqrt(np.diag(covariance))
    return {
        "gain": _positive(p[0], spread[0], unit),
        "corner": _positive(-p[1], spread[1], "rad/s"),
        "time_constant_from_magnitude": _positive(p[1], spread[1], "s"),
    }


def _from_phase(omega: Array, g: Complex, sd: Array, tau: float) -> dict[str, Estimate]:
    """Fit ln τ and d to the phase, which is counted from that of the model, so that no jump of a turn matters."""
    sign = 1.0 if np.sum((g / sd * (1 + 1j * omega * tau)).real) >= 0 else -1.0
    phase = np.angle(sign * g * (1 + 1j * omega * tau))
    phase = np.unwrap(phase) - np.arctan(omega * tau)

    def model(p: Array) -> tuple[Array, Array]:
        x = omega * np.exp(p[0])
        return -np.arctan(x) - omega * p[1], np.column_stack([-x / (1 + x**2), -omega])

    if len(omega) < 2:
        raise NotIdentifiable("a time constant and a delay need the phase at two frequencies or more")
    p, covariance, _ = _search(model, phase, sd, np.array([np.log(tau), 0.0]))
    spread = np.sqrt(np.diag(covariance))
    delay, half = float(p[1]), float(TWO_SIDED * spread[1])
    return {
        "time_constant_from_phase": _positive(p[0], spread[0], "s"),
        "delay_from_phase": Estimate(
            value=delay, sd=float(spread[1]), interval=(delay - half, delay + half), level=0.95, unit="s"
        ),
    }


def _search(
    model: Callable[[Array], tuple[Array, Array]], y: Array, sd: Array, start: Array
) -> tuple[Array, Array, float]:
    """Weighted least squares by damped Gauss-Newton: parameters, covariance, sum of squares."""
    p, damping = start, 1e-3
    value, slopes = model(p)
    errors = (y - value) / sd
    cost = float(errors @ errors)
    for _ in range(_STEPS):
        j = slopes / sd[:, None]
        h = j.T @ j
        trial = p + inverse(h + damping * np.diag(np.diag(h))) @ (j.T @ errors)
        new_value, new_slopes = model(trial)
        new_errors = (y - new_value) / sd
        new_cost = float(new_errors @ new_errors)
        if new_cost <= cost:
            settled = cost - new_cost <= 1e-12 * (1 + cost)
            p, slopes, errors, cost, damping = trial, new_slopes, new_errors, new_cost, damping / 10
            if settled:
                break
        else:
            damping *= 10
    j = slopes / sd[:, None]
    return p, inverse(j.T @ j), cost


def _positive(logarithm: float, spread: float, unit: str) -> Estimate:
    """A positive quantity from its logarithm and that one's standard deviation."""
    value, factor = float(np.exp(logarithm)), float(np.exp(TWO_SIDED * spread))
    return Estimate(
        value=value,
        sd=value * float(spread),
        interval=(value / factor, value * factor),
        level=0.95,
        unit=unit,
    )
