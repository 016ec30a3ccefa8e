"""The host's clock and a device's, compared by samples stamped by one and received by the other.

A sample of the device's time t_k arrives at the host's time h_k = t_k + offset + drift t_k + w_k, with w_k >= 0 its transfer
time: the cable, the driver, and the late wake-up of the computer. Transfer times are never negative, so the line below all h_k
- t_k that is closest to them on average is that of the shortest transfers (Moon, Skelly and Towsley 1999, Estimation and
removal of clock skew from network delay measurements, INFOCOM, section IV). A few late samples don't move it, unlike a
least-squares fit.
"""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array

MOST_DRIFT = 0.01
"""The largest drift of a clock: twice what a ceramic resonator is off by. What drifts more doesn't tell the same time."""
_CLOSE = 1e-9  # s; the resolution of a computer's clock


def in_device_time(host: Array, received: Array, t: Array) -> Array | None:
    """Return times of the host's clock, `host` (M,) [s], in the device's count [s].

    The samples of the device's times t (N,) [s], which increase, were `received` (N,) [s] at the host. What comes out is too
    early by the shortest way of a sample, which nobody can tell from an offset. None for fewer than two samples, and for clocks
    that drift apart by more than `MOST_DRIFT`, as where a recording is played faster than it was made.
    """
    if len(t) < 2:
        return None
    middle = float(t.mean())
    drift, offset = _line_below(t - middle, received - t)
    if abs(drift) > MOST_DRIFT:
        return None
    return np.asarray(middle + (host - middle - offset) / (1.0 + drift))


def _line_below(x: Array, y: Array) -> tuple[float, float]:
    """Return slope and height at x = 0 of the line that no point is below, and that is highest at x = 0, the mean of x (N,).

    It is the edge of the lower hull above x = 0, found from both sides: the point that is lowest below the line replaces the
    one on its side, until there is none. Each step lowers the line at 0, so that it ends.
    """
    split = int(np.searchsorted(x, 0.0))
    left, right = int(np.argmin(y[:split])), split + int(np.argmin(y[split:]))
    while True:
        slope = float((y[right] - y[left]) / (x[right] - x[left]))
        heights = y - slope * x
        lowest = int(np.argmin(heights))
        if heights[lowest] > min(heights[left], heights[right]) - _CLOSE:
            return slope, float(heights[lowest])
        left, right = (lowest, right) if lowest < split else (left, lowest)
