"""Speed estimates: a speed from a position, sample by sample."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from servobench.core.channels import Array


@runtime_checkable
class SpeedEstimate(Protocol):
    """A causal map from positions to speeds, linear in the positions: a `Chain` that yields a speed, or a tracking filter."""

    def __call__(self, x: Array, t: Array) -> Array:
        """Return the speeds [rad/s] for positions x [rad] at times t (N,) [s]; x is (N,), or (N, P) for P signals."""
        ...
