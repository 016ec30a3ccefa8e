"""The window of a stage that looks back over a fixed time: which samples lie in it."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from servobench.core.channels import Array

# (age [s], value) of the last samples, oldest first: those in the window, and one at its edge or before it.
Samples: TypeAlias = tuple[tuple[float, float], ...]


def slide(samples: Samples, x: float, dt: float, window: float) -> Samples:
    """Return the samples of the window [s] after one more, dt [s] after the last."""
    aged = [(age + dt, value) for age, value in samples]
    aged.append((0.0, x))
    while len(aged) > 1 and aged[1][0] >= window:
        del aged[0]
    return tuple(aged)


def edge(samples: Samples, window: float) -> tuple[float, float]:
    """Return (time the samples reach back, at most the window [s]; value there, on the straight line between samples)."""
    (age, value), (next_age, next_value) = samples[0], samples[1]
    excess = age - window
    if excess <= 0.0:
        return age, value
    return window, value + excess * (next_value - value) / (age - next_age)


def first_filled(first: int, t: Array, window: float) -> int:
    """Return the index of the first sample whose window [s] holds no sample before the number `first`; times t (N,) [s]."""
    if first >= len(t):
        return first
    # Sample times are rounded: a window that is full but for a part in a billion counts as full.
    return int(np.searchsorted(t, t[first] + window * (1.0 - 1e-9)))
