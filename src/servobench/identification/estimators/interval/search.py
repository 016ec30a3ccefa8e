"""The maximum of the interval likelihood over the parameters and the noise before rounding.

Near a point the predictions are treated as linear in the parameters. Then ln L has one maximum over θ/s and 1/s (Burridge
1981), and Newton steps, halved until ln L rises, find it from anywhere. A few rounds with exact predictions do the rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.estimators.covariance import inverse
from servobench.identification.estimators.interval.bins import Bins, bins
from servobench.identification.estimators.least_squares import Layout

_ROUNDS = 20
_STEPS = 30
# A step whose square, in units of the covariance, is below this changes nothing that matters: 0.01 standard deviations.
_ENOUGH = 1e-4


@dataclass(frozen=True, eq=False)
class Point:
    """A change of the parameters and an s, with ln L and its derivatives.

    Those of the `log_likelihood` are its gradient and information by the parameters, slope and curvature by ln s.
    """

    change: Array
    s: float
    log_likelihood: float
    gradient: Array
    information: Array
    slope: float
    curvature: float

    @property
    def deviance(self) -> float:
        """-2 ln L, adjusted for the parameters having been fitted: + ln |J'hJ|."""
        informed = np.flatnonzero(np.diag(self.information) > 0)
        part = self.information[np.ix_(informed, informed)]
        scale = np.sqrt(np.diag(part))
        values = np.maximum(np.linalg.eigvalsh(part / np.outer(scale, scale)), 1e-14)
        return -2 * self.log_likelihood + float(np.sum(np.log(values)) + 2 * np.sum(np.log(scale)))


@dataclass(frozen=True, eq=False)
class Near:
    """Records near a vector of the parameters, their predictions taken for linear: there ln L has one maximum (Burridge 1981).

    `theta` (P + ΣQ,) is that vector. Of each record, `offsets` (M,) are prediction - y, `jacobians` (M, P + Q) those of the
    prediction, `quanta` its encoder's step, `places` (P + Q,) where its columns stand in the vector. `free` (P + ΣQ,) says
    which entries may move: not those at a bound that the likelihood pushes outwards.
    """

    theta: Array
    offsets: tuple[Array, ...]
    jacobians: tuple[Array, ...]
    quanta: tuple[float, ...]
    places: tuple[NDArray[np.int64], ...]
    free: NDArray[np.bool_]

    def at(self, change: Array, s: float) -> Point:
        """Return the likelihood at a change of the parameters (P + ΣQ,) and a noise s."""
        size = len(self.theta)
        h, g, total, slope, curvature = np.zeros((size, size)), np.zeros(size), 0.0, 0.0, 0.0
        for j, place, each in zip(self.jacobians, self.places, self._bins(change, s), strict=True):
            h[np.ix_(place, place)] += (j * each.information[:, None]).T @ j
            g[place] += j.T @ each.score
            total += each.log_likelihood
            slope += each.slope
            curvature += each.curvature
        held = ~self.free
        h[held], h[:, held], g[held] = 0.0, 0.0, 0.0
        return Point(change, s, total, g, h, slope, curvature)

    def bins_at(self, point: Point) -> tuple[Bins, ...]:
        """Return what the bins of each record say of the positions at a point."""
        return self._bins(point.change, point.s)

    def _bins(self, change: Array, s: float) -> tuple[Bins, ...]:
        return tuple(
            bins(x + j @ change[place], quantum, s)
            for x, j, quantum, place in zip(
                self.offsets, self.jacobians, self.quanta, self.places, strict=True
            )
        )

    def climb(self, point: Point, floor: float | None = None) -> Point:
        """Return the maximum from a point, by Newton steps that are halved until they climb; s stays unless a floor is given.

        Parameters and ln s have no common information where the positions are spread over the bins, so each has its own step.
        """
        for _ in range(_STEPS):
            step = inverse(point.information) @ point.gradient
            by = _noise_step(point, floor)
            gain = float(point.gradient @ step) + by * point.slope
            if gain <= _ENOUGH:
                return point
            for halving in range(_STEPS):
                part = 0.5**halving
                trial = self.at(point.change + part * step, point.s * float(np.exp(part * by)))
                if trial.log_likelihood >= point.log_likelihood:
                    break
            else:
                return point
            point = trial
        return point


def _noise_step(point: Point, floor: float | None) -> float:
    """The Newton step of ln s, at most a factor of 3 and not below the floor; 0 without a floor."""
    if floor is None:
        return 0.0
    step = point.slope / point.curvature if point.curvature > 0 else np.sign(point.slope)
    return float(max(np.clip(step, -1.1, 1.1), np.log(floor / point.s)))


@dataclass(frozen=True, eq=False)
class Optimum:
    """The end of a search: the records `near` it, the maximum, whether it `converged`, and a sentence on its course, `status`.

    `at_kink` says that the exact predictions get worse whichever way the linear ones point, as where a shaft is about to stick.
    """

    near: Near
    point: Point
    converged: bool
    status: str
    at_kink: bool = False


def search_maximum(layout: Layout, theta: Array, s: float, floor: float) -> Optimum:
    """Return the maximum over the parameters and s, from theta (P + ΣQ,), by linear predictions in turns with exact ones."""
    near = _near(layout, theta, s)
    here = near.at(np.zeros(len(theta)), max(s, floor))
    for step in range(1, _ROUNDS + 1):
        best = near.climb(here, floor)
        moved = _move_on(layout, near, best)
        if moved is None:
            return Optimum(near, replace(here, s=best.s), True, f"converged in {step} rounds", at_kink=True)
        change = moved[0].theta - near.theta
        near, here = moved
        if float(change @ here.information @ change) <= _ENOUGH:
            return Optimum(near, here, True, f"converged in {step} rounds")
    return Optimum(near, here, False, f"did not converge within {_ROUNDS} rounds")


def _near(layout: Layout, theta: Array, s: float) -> Near:
    """The records near theta, with those entries held that stand at a bound which the likelihood pushes them against."""
    places = tuple(layout.columns())
    predictions = [
        layout.structure.predict(theta[place], record)
        for record, place in zip(layout.data, places, strict=True)
    ]
    everything = Near(
        theta=theta,
        offsets=tuple(p.y - record.y for p, record in zip(predictions, layout.data, strict=True)),
        jacobians=tuple(p.jacobian for p in predictions),
        quanta=tuple(float(record.quantum or np.nan) for record in layout.data),
        places=places,
        free=np.ones(len(theta), dtype=bool),
    )
    lower, upper = layout.bounds()
    if np.all((theta > lower) & (theta < upper)):
        return everything
    push = everything.at(np.zeros(len(theta)), s).gradient
    return replace(everything, free=~(((theta <= lower) & (push < 0)) | ((theta >= upper) & (push > 0))))


def _move_on(layout: Layout, near: Near, best: Point) -> tuple[Near, Point] | None:
    """The records near a maximum, or on the way to it, where their exact predictions are likelier; None for nowhere."""
    lower, upper = layout.bounds()
    still = np.zeros(len(near.theta))
    before = near.at(still, best.s).log_likelihood
    for halving in range(_STEPS):
        moved = _near(layout, np.clip(near.theta + 0.5**halving * best.change, lower, upper), best.s)
        here = moved.at(still, best.s)
        if here.log_likelihood >= before - 1e-9 * abs(before):
            return moved, here
    return None
