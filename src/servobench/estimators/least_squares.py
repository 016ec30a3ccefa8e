"""Non-linear least squares over several records: Levenberg-Marquardt with exact Jacobians, bounds and held parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servobench.channels import Array
from servobench.measurement.dataset import Dataset
from servobench.models.base import Prediction, Structure

_STEPS = 60
_ENOUGH = 1e-3  # a step below this many standard deviations changes nothing that matters


@dataclass(frozen=True, kw_only=True, eq=False)
class Minimum:
    """Where a search ended: the vector, the predictions of all records there, the sum of squares, and how it went."""

    theta: Array
    predictions: tuple[Prediction, ...]
    cost: float
    converged: bool
    status: str


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the parameters of each record stand in the joint vector: the shared ones first, then each record's own."""

    structure: Structure
    data: tuple[Dataset, ...]

    @property
    def shared(self) -> int:
        """The number of shared parameters."""
        return len(self.structure.parameters)

    def columns(self) -> list[NDArray[np.int64]]:
        """Return, for each record, the places of its parameters in the joint vector."""
        places, start = [], self.shared
        for record in self.data:
            own = len(self.structure.nuisance(record))
            places.append(np.r_[np.arange(self.shared), np.arange(start, start + own)])
            start += own
        return places

    def bounds(self) -> tuple[Array, Array]:
        """Return the lower and the upper bounds of the joint vector."""
        lower, upper = self.structure.bounds(self.data)
        own = [p for record in self.data for p in self.structure.nuisance(record)]
        return np.append(lower, [p.lower for p in own]), np.append(upper, [p.upper for p in own])


def minimise(
    structure: Structure, data: Sequence[Dataset], start: Array, free: NDArray[np.bool_] | None = None
) -> Minimum:
    """Return the minimum of the sum of squared residuals from a start vector; `free` says which entries may move (all).

    Levenberg (1944) and Marquardt (1963), with the damping of Nielsen (1999); a step that leaves the bounds is cut at them.
    """
    layout = Layout(structure, tuple(data))
    lower, upper = layout.bounds()
    moves = np.ones(len(start), dtype=bool) if free is None else free
    theta = np.clip(start, lower, upper)
    predictions, cost = _evaluate(layout, theta)
    damping, growth = 1e-6, 2.0
    for step in range(1, _STEPS + 1):
        h, g = normal_equations(layout, predictions)
        at_bound = ((theta <= lower) & (g < 0)) | ((theta >= upper) & (g > 0))
        active = np.flatnonzero(moves & ~at_bound & (np.diag(h) > 0))
        if not len(active):
            return _ended(theta, predictions, cost, True, "every parameter is at a bound")
        change = np.zeros_like(theta)
        change[active] = _damped_step(h[np.ix_(active, active)], g[active], damping)
        trial = np.clip(theta + change, lower, upper)
        new_predictions, new_cost = _evaluate(layout, trial)
        if new_cost <= cost:
            done = _small(h, trial - theta, cost, layout) or cost - new_cost <= 1e-13 * cost
            theta, predictions, cost = trial, new_predictions, new_cost
            damping, growth = max(damping / 5, 1e-12), 2.0
            if done:
                return _ended(theta, predictions, cost, True, f"converged in {step} steps")
        else:
            if _small(h, trial - theta, cost, layout):
                return _ended(theta, predictions, cost, True, f"converged in {step} steps")
            damping, growth = max(damping, 1e-9) * growth, 2 * growth
    return _ended(theta, predictions, cost, False, f"did not settle within {_STEPS} steps")


def normal_equations(layout: Layout, predictions: Sequence[Prediction]) -> tuple[Array, Array]:
    """Return J'J and J'r of all records, r = y - prediction, over the joint vector."""
    places = layout.columns()
    size = int(places[-1][-1]) + 1
    h, g = np.zeros((size, size)), np.zeros(size)
    for record, prediction, place in zip(layout.data, predictions, places, strict=True):
        j = prediction.jacobian[prediction.valid]
        r = (record.y - prediction.y)[prediction.valid]
        h[np.ix_(place, place)] += j.T @ j
        g[place] += j.T @ r
    return h, g


def _evaluate(layout: Layout, theta: Array) -> tuple[tuple[Prediction, ...], float]:
    places = layout.columns()
    predictions = tuple(
        layout.structure.predict(theta[place], record)
        for record, place in zip(layout.data, places, strict=True)
    )
    cost = sum(
        float(np.sum((record.y - p.y)[p.valid] ** 2))
        for record, p in zip(layout.data, predictions, strict=True)
    )
    return predictions, cost if np.isfinite(cost) else np.inf


def _damped_step(h: Array, g: Array, damping: float) -> Array:
    """The step of (H + λ diag H) s = g, in scaled parameters, so that their units don't matter."""
    scale = 1.0 / np.sqrt(np.diag(h))
    scaled = h * np.outer(scale, scale) + damping * np.eye(len(g))
    return np.asarray(scale * np.linalg.lstsq(scaled, scale * g, rcond=None)[0], dtype=np.float64)


def _small(h: Array, change: Array, cost: float, layout: Layout) -> bool:
    """Whether a change moves the sum of squares by less than `_ENOUGH`² of the residual's variance."""
    samples = sum(len(record.y) for record in layout.data)
    return float(change @ h @ change) <= _ENOUGH**2 * cost / max(samples, 1)


def _ended(
    theta: Array, predictions: tuple[Prediction, ...], cost: float, converged: bool, status: str
) -> Minimum:
    return Minimum(theta=theta, predictions=predictions, cost=cost, converged=converged, status=status)
