"""The delay of a measurement chain for a speed: the first moment of its impulse response.

The first moments of responses in series add up, by algebra. A model K/(τ's + 1) fitted without a delay has to include the whole
lag: τ' = τ + L, exactly if the area above the step response is compared.
"""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.measurement.base import Chain

_SPAN = 8.0  # time constants and lags that a step is followed for: e^-8 is left
_POINTS = 1500


def lag_of(chain: Chain, tau: float) -> float:
    """Return how much a chain delays a speed that moves with the time constant `tau` [s]: the first moment of its response [s].

    Without a fitted delay a time constant comes out too long by about this.
    """
    t, response = _step_response(chain.linear, tau)
    return _area_above(t, response) - tau


def _area_above(t: Array, response: Array) -> float:
    """The area between a step response and where it ends, by the trapezoid rule: the first moment of the impulse response."""
    return float(np.trapezoid(1.0 - response, t))


def _step_response(chain: Chain, tau: float) -> tuple[Array, Array]:
    """The response (N,) of a first-order lag of gain 1 and a chain to a step at time zero, at times (N,) [s] from zero on."""
    span = _SPAN * tau
    for _ in range(3):  # the lag isn't known before the first look, nor all of a long one
        t = np.linspace(-span, span, 2 * _POINTS + 1)
        moved = np.maximum(t, 0.0)
        # The mean slope over a window is that of the position, which is the integral of the speed.
        what = moved + tau * np.expm1(-moved / tau) if chain.takes == "position" else -np.expm1(-moved / tau)
        response = chain(what, t)
        span = _SPAN * max(tau, _area_above(t[_POINTS:], response[_POINTS:]))
    return t[_POINTS:], response[_POINTS:]
