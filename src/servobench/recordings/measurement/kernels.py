"""The loops of the stages, compiled; each stage's file states the law. Times t and a window are in s."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.compiled import compiled


@compiled
def first_order_recursion(decay: Array, drive: Array) -> Array:
    """Return y (N, P) of y[k] = decay[k] y[k-1] + drive[k], from y[-1] = 0; decay is (N,), drive is (N, P)."""
    samples, signals = drive.shape
    y = np.empty((samples, signals))
    for p in range(signals):
        before = 0.0
        for k in range(samples):
            before = decay[k] * before + drive[k, p]
            y[k, p] = before
    return y


@compiled
def unwrap_block(x: Array, before: float, turns: float, modulus: float) -> tuple[float, Array]:
    """Return the wraps so far and samples x (N,) without them; there were `turns`, and the sample `before`, until now."""
    y = np.empty(len(x))
    for k in range(len(x)):
        turns -= np.rint((x[k] - before) / modulus)
        before = x[k]
        y[k] = before + modulus * turns
    return turns, y


@compiled
def slopes(x: Array, before: float, dt: Array, known: int) -> Array:
    """Return (x[k] - x[k-1])/dt[k] (N,) from sample `known` on, and 0 before; x[-1] is `before`."""
    y = np.zeros(len(x))
    for k in range(known, len(x)):
        y[k] = (x[k] - (x[k - 1] if k else before)) / dt[k]
    return y


@compiled
def tustin_lowpass(x: Array, dt: Array, cutoff: float, y_before: float, x_before: float) -> Array:
    """Return y (N,) of the low-pass filter by the trapezoid rule for samples x (N,), dt (N,) [s] after the one before."""
    y = np.empty(len(x))
    for k in range(len(x)):
        half = 0.5 * cutoff * dt[k]
        y_before = ((1.0 - half) * y_before + half * (x[k] + x_before)) / (1.0 + half)
        x_before = x[k]
        y[k] = y_before
    return y


@compiled
def moving_mean(x: Array, t: Array, window: float) -> Array:
    """Return the mean (N, P) of the straight lines between samples x (N, P) at t (N,) over the time before each sample.

    The sum over whole intervals is carried along with its rounding error (Neumaier 1974), so that it doesn't drift.
    """
    samples, signals = x.shape
    y = np.empty((samples, signals))
    for p in range(signals):
        total, lost, oldest = 0.0, 0.0, 0
        for k in range(samples):
            if k == 0:
                y[k, p] = x[k, p]
                continue
            total, lost = _add(total, lost, 0.5 * (x[k, p] + x[k - 1, p]) * (t[k] - t[k - 1]))
            while oldest < k and t[k] - t[oldest + 1] >= window:
                total, lost = _add(
                    total, lost, -0.5 * (x[oldest + 1, p] + x[oldest, p]) * (t[oldest + 1] - t[oldest])
                )
                oldest += 1
            excess, width = _before_window(t, k, oldest, window)
            slope = (x[oldest + 1, p] - x[oldest, p]) / (t[oldest + 1] - t[oldest])
            y[k, p] = (total + lost - excess * (x[oldest, p] + 0.5 * slope * excess)) / width
    return y


@compiled
def mean_slope(x: Array, t: Array, window: float) -> Array:
    """Return the mean slope (N, P) of the straight lines between samples x (N, P) at t (N,) over the time before each sample."""
    samples, signals = x.shape
    y = np.zeros((samples, signals))
    oldest = 0
    for k in range(1, samples):
        while oldest < k and t[k] - t[oldest + 1] >= window:
            oldest += 1
        excess, width = _before_window(t, k, oldest, window)
        part = excess / (t[oldest + 1] - t[oldest])
        for p in range(signals):
            y[k, p] = (x[k, p] - x[oldest, p] - part * (x[oldest + 1, p] - x[oldest, p])) / width
    return y


@compiled
def line_slope(x: Array, t: Array, window: float) -> Array:
    """Return the slope (N, P) of the straight line nearest to the samples x (N, P) at t (N,) of the time before each sample.

    Each window is summed anew, from values less the newest one: no sum is carried along that could drift.
    """
    samples, signals = x.shape
    y = np.zeros((samples, signals))
    oldest = 0
    for k in range(1, samples):
        while oldest < k - 1 and t[k] - t[oldest] > window:
            oldest += 1
        count = k - oldest + 1
        middle = 0.0
        for i in range(oldest, k + 1):
            middle += (t[i] - t[k]) / count
        spread = 0.0
        for i in range(oldest, k + 1):
            spread += (t[i] - t[k] - middle) ** 2
        for p in range(signals):
            moment = 0.0
            for i in range(oldest, k + 1):
                moment += (t[i] - t[k] - middle) * (x[i, p] - x[k, p])
            y[k, p] = moment / spread
    return y


@compiled
def _before_window(t: Array, k: int, oldest: int, window: float) -> tuple[float, float]:
    """The part of the oldest interval before the window that ends at sample k, and the time from there to sample k."""
    reach = t[k] - t[oldest]
    return (reach - window, window) if reach > window else (0.0, reach)


@compiled
def _add(total: float, lost: float, term: float) -> tuple[float, float]:
    """One more term in a sum, and what rounding has taken from the sum so far."""
    new = total + term
    if abs(total) >= abs(term):
        return new, lost + ((total - new) + term)
    return new, lost + ((term - new) + total)
