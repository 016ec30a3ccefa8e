"""What a measurement chain that nobody told of costs: how far it moves a time constant that is fitted without it.

A speed that went through a chain of mean delay L and spread V (first moment and variance of its impulse response) looks like
that of a slower motor. The moments of lag and chain add up, by algebra, as those of any two responses one after the other do:
mean τ + L, variance τ² + V. A model K e^(-ds)/(τ's + 1) has mean τ' + d and variance τ'². Without a delay the fit has to take
the whole lag for its own: τ' = τ + L, exactly so where the area above the step response is compared. With one, the moments give
τ' = √(τ² + V), and the rest of the lag goes to the delay; least squares, which see more of the bend at the beginning of a step,
come out somewhat higher. What they come out at is computed here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.measurement.base import Chain

_SPAN = 8.0  # time constants and lags that a step is followed for: e^-8 is left
_POINTS = 1500
_ROUNDS = 30

TYPICAL = (
    ("a 50 rad/s low-pass filter", "lowpass 50 rad/s"),
    ("an average over 20 ms", "average 20 ms"),
    ("an average over 100 ms", "average 100 ms"),
    ("a smart motor controller's difference over 100 ms and 64-sample average", "talon-srx"),
)
"""What speeds commonly come through, beside the difference of the samples' positions: name and chain."""


class ChainCost(NamedTuple):
    """What a chain is, its `name` in words, and the relative error `bias` of a time constant fitted as if it weren't there."""

    name: str
    bias: float


def chain_cost(tau: float, sample_time: float) -> tuple[ChainCost, ...]:
    """Return what typical chains cost in the time constant, where nobody says that they are there.

    `tau` is the time constant [s], `sample_time` that of the record [s]. The bias is (τ' - τ)/τ with τ' from least squares on the
    response to a step with the delay fitted, too. The first entry is the difference of the record's own samples.
    """
    typical = (("differenced counts", f"tachometer {sample_time!r} s"), *TYPICAL)
    return tuple(ChainCost(name=name, bias=bias_of(Chain.parse(text), tau)) for name, text in typical)


def bias_of(chain: Chain, tau: float) -> float:
    """Return (τ' - τ)/τ, where τ' is fitted by least squares, with a delay, to the step response of 1/(τs + 1) behind a chain.

    `tau` is the time constant [s]. Of the chain the linear stages count; it must not change the gain.
    """
    t, seen = _step_response(chain.linear, tau)
    return _first_order(t, seen, tau) / tau - 1.0


def lag_of(chain: Chain, tau: float) -> float:
    """Return how much a chain delays a speed that moves with the time constant `tau` [s]: the first moment of its response [s].

    Without a fitted delay a time constant comes out too long by about this.
    """
    t, seen = _step_response(chain.linear, tau)
    return _area_above(t, seen) - tau


def _area_above(t: Array, seen: Array) -> float:
    """The area between a step response and where it ends, by the trapezoid rule: the first moment of the impulse response."""
    return float(np.trapezoid(1.0 - seen, t))


def _step_response(chain: Chain, tau: float) -> tuple[Array, Array]:
    """The response (N,) of a first-order lag of gain 1 and a chain to a step at time zero, at times (N,) [s] from zero on."""
    span = _SPAN * tau
    for _ in range(3):  # the lag isn't known before the first look, nor all of a long one
        t = np.linspace(-span, span, 2 * _POINTS + 1)
        moved = np.maximum(t, 0.0)
        # The mean slope over a window is that of the position, which is the integral of the speed.
        what = moved + tau * np.expm1(-moved / tau) if chain.takes == "position" else -np.expm1(-moved / tau)
        seen = chain(what, t)
        span = _SPAN * max(tau, _area_above(t[_POINTS:], seen[_POINTS:]))
    return t[_POINTS:], seen[_POINTS:]


def _first_order(t: Array, seen: Array, tau: float) -> float:
    """The time constant [s] of the 1 - e^(-(t - d)/τ) that is nearest to a response (N,) by least squares (Gauss-Newton)."""
    fitted, delay = tau, 0.0
    for _ in range(_ROUNDS):
        since = np.maximum(t - delay, 0.0) / fitted
        decay = np.where(t >= delay, np.exp(-since), 0.0)
        model = np.where(t >= delay, 1.0 - decay, 0.0)
        jacobian = np.column_stack([-decay * since / fitted, -decay / fitted])
        step = np.linalg.lstsq(jacobian, seen - model)[0]
        fitted, delay = max(fitted + float(step[0]), 0.1 * fitted), delay + float(step[1])
    return fitted
