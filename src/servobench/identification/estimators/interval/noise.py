"""The noise before the rounding: its likelihood, and the effect of its uncertainty on the parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.covariance import inverse
from servobench.identification.estimators.interval.search import Optimum, Point

# Standard deviations of ln s at which the parameters are tried: three equal steps of √3 integrate a normal density to 1e-3.
_TRIALS = np.sqrt(3.0) * np.array([-1.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class NoiseProfile:
    """The likelihood of s: its best value and 95 % interval, and trials around it with their weights.

    `best` is the maximum over the parameters at that s; `at_floor` says that s is the smallest that is tried.
    """

    best: Point
    interval: tuple[float, float]
    at_floor: bool
    trials: tuple[Point, ...]
    weights: Array

    def widen(self, covariance: Array) -> Array:
        """Return a covariance (P, P) at the best s, the doubt about s added: Σ w (C + δ δ'), δ the parameters' change with s."""
        own = np.diag(inverse(self.best.information))
        each = [np.diag(inverse(trial.information)) for trial in self.trials]
        mean = np.sum([w * d for w, d in zip(self.weights, each, strict=True)], axis=0)
        scale = np.sqrt(np.where(own > 0, mean / np.where(own > 0, own, 1.0), 1.0))
        moved = np.array([trial.change - self.best.change for trial in self.trials])
        return np.asarray(
            covariance * np.outer(scale, scale) + (moved * self.weights[:, None]).T @ moved, dtype=np.float64
        )


def profile_noise(optimum: Optimum, floor: float) -> NoiseProfile:
    """The likelihood of s, adjusted for the fitted parameters and computed on a grid around the maximum.

    ln |J'hJ| is what makes the likelihood of s that of the data alone, after the parameters: -2 ln L + ln |J'hJ|, as
    parameters and s have no common information (Cox and Reid 1987). Without it s comes out too small.
    """
    point = optimum.point
    sd = float(np.clip(point.curvature**-0.5 if point.curvature > 0 else 1.0, 0.01, 1.0))
    freedom = np.count_nonzero(np.diag(point.information))
    # |J'hJ| falls by at least s^-1 for each parameter: that much the adjusted maximum lies above this one.
    middle = np.log(point.s) + 0.5 * freedom * sd**2
    levels = np.unique(np.maximum(middle + sd * _TRIALS, np.log(floor)))
    trials = [optimum.near.climb(optimum.near.at(point.change, float(np.exp(level)))) for level in levels]
    deviances = np.array([trial.deviance for trial in trials])
    weights = np.exp(-0.5 * (deviances - deviances.min()))
    weights /= weights.sum()
    mean = float(weights @ levels)
    spread = float(np.sqrt(weights @ (levels - mean) ** 2))
    best = optimum.near.climb(optimum.near.at(point.change, float(np.exp(mean))))
    return NoiseProfile(
        best=best,
        interval=(float(np.exp(mean - TWO_SIDED * spread)), float(np.exp(mean + TWO_SIDED * spread))),
        at_floor=bool(mean - TWO_SIDED * spread <= np.log(floor)),
        trials=tuple(trials),
        weights=weights,
    )
