"""An example of a finding: what raises it, and the like of it that must not."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from servobench.core.finding import Finding
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset

TIME = 0.002 * np.arange(5000)


@dataclass(frozen=True, kw_only=True)
class Example:
    """One code of a finding, and what two cases that differ in what the finding is about say."""

    code: str
    raised: Callable[[], Sequence[Finding]]
    absent: Callable[[], Sequence[Finding]]


@cache
def sound(seed: int = 3, samples: int = 5000) -> Dataset:
    """The reference motor behind its encoder, driven by a PRBS of ±3 V."""
    return dataset(seed=seed, kind="prbs", hold=20, samples=samples)


def driven(u: NDArray[np.float64]) -> Dataset:
    """The reference motor driven by u (N,) [V], 2 ms apart."""
    return dataset(seed=1, samples=len(u), u=u)


def told(said: NDArray[np.float64], applied: NDArray[np.float64]) -> Dataset:
    """The motor driven by one voltage (N,), in whose file stands another."""
    return replace(driven(applied), u=said)


def sprung(rate: float) -> Dataset:
    """A motor of 20 rad/(s·V) and 0.1 s at rest for half a second, at 3 V and at 0 V for 0.2 and 0.8 s, on a spring [V/rad]."""
    u = np.repeat([0.0, 3.0, 0.0], [250, 100, 400])
    angle, state = np.zeros(len(u)), np.zeros(2)
    step = 2e-5
    for k in range(1, len(u)):
        for _ in range(
            100
        ):  # Euler's steps of a hundredth of a sample: their error is far below a count's effect here
            state = state + step * np.array(
                [state[1], (20.0 * (u[k - 1] - rate * state[0]) - state[1]) / 0.1]
            )
        angle[k] = state[0]
    return dataset(seed=1, samples=len(u), u=u, y=(np.floor(angle / QUANTUM) + 0.5) * QUANTUM)


def staircase() -> NDArray[np.float64]:
    """Six levels between -3 and 3 V, five times each in random order, 0.2 s each."""
    levels = np.repeat([-3.0, -2.0, -1.0, 1.0, 2.0, 3.0], 5)
    return np.repeat(np.random.default_rng(1).permutation(levels), 100)


def sines() -> NDArray[np.float64]:
    """Five sines of 1 V each [V]."""
    return np.sum([np.sin(2 * np.pi * f * TIME + 7 * f) for f in (0.3, 0.7, 1.1, 1.9, 3.1)], axis=0)


def fitted(data: Dataset, structure: str = "first_order_coulomb") -> Fit:
    """The fit of a structure by output error."""
    return ESTIMATORS["output_error"].fit(STRUCTURES[structure], [data])


@cache
def sound_fit() -> Fit:
    """The fit of the reference motor's structure to a sound record."""
    return fitted(sound(samples=2000))


def with_values(fit: Fit, **values: float) -> Fit:
    """The fit with other values of its parameters."""
    theta = fit.model.theta.copy()
    for name, value in values.items():
        theta[fit.model.names.index(name)] = value
    return replace(fit, model=replace(fit.model, theta=theta))


def with_sd(fit: Fit, **shares: float) -> Fit:
    """The fit with standard deviations of so many parts of the values of its parameters, correlated with nothing."""
    covariance = fit.covariance.copy()
    for name, share in shares.items():
        at = fit.model.names.index(name)
        covariance[at, :] = covariance[:, at] = 0.0
        covariance[at, at] = (share * fit.model[name]) ** 2
    return replace(fit, covariance=covariance)
