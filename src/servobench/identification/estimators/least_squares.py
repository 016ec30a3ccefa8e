"""Nonlinear least squares over several records: Levenberg-Marquardt with exact Jacobians, bounds and fixed parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.models.base import Prediction, Structure, as_protocol
from servobench.recordings.measurement.dataset import Dataset

_STEPS = 100
_MOST_TIMES = 20  # that a search begins anew
_IN_VAIN = 4  # times of these that may come down by little
_MUCH_LOWER = 0.5  # of the cost: what comes down to less is worth another time
_STEPS_TO_VALLEY = 25
_AS_LOW = 0.01  # of a residual's variance: a sum of squares that is higher by less is as low
_SAME_PLACE = 1e-5  # two sums of squares that differ by less, relatively, are the same minimum
_LEAST_DAMPING = 1e-12
_SLOWLY = 0.3  # times the damping
_BENT = 4  # refused steps
_FIRST_REFUSED = 1e-3  # damping that the first refused step is taken back from, at least
_FAR_BEHIND = 10.0  # times where another one settled: a search that is still there won't catch up
_VALLEYS = 2  # of the starts into curved valleys are followed to their ends
_ENOUGH = 1e-3  # a step below this many standard deviations changes nothing that matters
_HARDLY = 1e-2  # damping beside which the quadratic model is what it foretells


@dataclass(frozen=True, kw_only=True, eq=False)
class Minimum:
    """The end of a search: the joint vector `theta` (P + ΣQ,), the predictions of all records there, the sum of squares `cost`.

    `converged` says whether it came to a minimum, `status` in words how it ended. `others` are the ends that other starts led to,
    settled or not, with the sum of squares of each.
    """

    theta: Array
    predictions: tuple[Prediction, ...]
    cost: float
    converged: bool
    status: str
    others: tuple[tuple[Array, float], ...] = ()


@runtime_checkable
class NormalEquations(Protocol):
    """A structure that can add up the normal equations of a record without holding its Jacobian, which is much faster."""

    def normal(self, theta: Array, data: Dataset) -> tuple[Array, Array, float] | None:
        """Return J'J, J'r and r'r, r = y - prediction, for theta (P + Q,); None where that data need `predict`."""
        ...


@runtime_checkable
class CurvedValley(Protocol):
    """A structure whose sum of squares has a curved valley, and which knows how to get into it and how to follow it."""

    @property
    def held_at_first(self) -> NDArray[np.bool_]:
        """The parameters to hold while the others approach their values, (P,)."""
        ...

    def move(self, theta: Array, change: Array) -> Array:
        """Return where a change leads from theta, both (P + ΣQ,): theta + change to first order."""
        ...


@runtime_checkable
class SlowMotor(Protocol):
    """A structure whose parameters lie along a curved valley where the input changes faster than the motor follows."""

    def move_if_slow(self, theta: Array, change: Array, mean_input: float) -> Array:
        """Return where a change leads from theta, both (P + ΣQ,), along that valley: theta + change to first order.

        `mean_input` is the mean of the records' inputs [input unit].
        """
        ...


@dataclass(frozen=True, eq=False)
class Layout:
    """The layout of the joint vector: the P shared parameters first, then each record's own Q.

    `structure` says which those are, `data` are the records.
    """

    structure: Structure
    data: tuple[Dataset, ...]

    @property
    def shared(self) -> int:
        """The number of shared parameters."""
        return len(self.structure.parameters)

    def columns(self) -> list[NDArray[np.int64]]:
        """Return, for each record, the places of its parameters in the joint vector."""
        return self._places

    @cached_property
    def _places(self) -> list[NDArray[np.int64]]:
        places, start = [], self.shared
        for record in self.data:
            own = len(self.structure.nuisance(record))
            places.append(np.append(np.arange(self.shared), np.arange(start, start + own)))
            start += own
        return places

    def normal(self, theta: Array, record: Dataset) -> tuple[Array, Array, float]:
        """Return J'J, J'r and r'r of a record for its own part (P + Q,) of the joint vector, as fast as the structure can."""
        summed = self._summing.normal(theta, record) if self._summing else None
        return summed or _sums(record, self.structure.predict(theta, record))

    @cached_property
    def _summing(self) -> NormalEquations | None:
        return as_protocol(self.structure, NormalEquations)

    def move(self, theta: Array, change: Array) -> Array:
        """Return where a change leads from a joint vector (P + ΣQ,), along the structure's valley where it knows one."""
        return self._curved.move(theta, change) if self._curved else theta + change

    @cached_property
    def moves(self) -> tuple[Callable[[Array, Array], Array] | None, ...]:
        """The ways in which a change may lead from a joint vector: `move`, and that of a slow motor if the structure has it.

        None stands for a change that is added.
        """
        own = self._curved.move if self._curved else None
        slow = as_protocol(self.structure, SlowMotor)
        if slow is None:
            return (own,)
        mean = float(np.mean(np.concatenate([record.u for record in self.data])))
        return own, partial(slow.move_if_slow, mean_input=mean)

    @cached_property
    def samples(self) -> int:
        """The number of samples of all records, one at least."""
        return max(sum(len(record.y) for record in self.data), 1)

    @property
    def held_at_first(self) -> NDArray[np.bool_] | None:
        """The parameters that a search should hold at first, (P,); None if the structure has none."""
        return self._curved.held_at_first if self._curved else None

    @cached_property
    def _curved(self) -> CurvedValley | None:
        return as_protocol(self.structure, CurvedValley)

    def bounds(self, free: NDArray[np.bool_] | None = None) -> tuple[Array, Array]:
        """Return the lower and the upper bounds of the joint vector; what isn't `free` (P + ΣQ,) stays where it is, unbounded."""
        if free is None:
            return self._bounds
        # Nobody needs the bounds of a motor that is held, and they take a while.
        held = np.full(self.shared, np.inf)
        lower, upper = self._bounds if free[: self.shared].any() else self._with_own_bounds(-held, held)
        return np.where(free, lower, -np.inf), np.where(free, upper, np.inf)

    @cached_property
    def _bounds(self) -> tuple[Array, Array]:
        return self._with_own_bounds(*self.structure.bounds(self.data))

    def _with_own_bounds(self, lower: Array, upper: Array) -> tuple[Array, Array]:
        """Bounds of the shared parameters (P,), and behind them those of each record's own (P + ΣQ,)."""
        own = [p for record in self.data for p in self.structure.nuisance(record)]
        return np.append(lower, [p.lower for p in own]), np.append(upper, [p.upper for p in own])


@dataclass(frozen=True, kw_only=True, eq=False)
class Point:
    """A joint vector `theta` (P + ΣQ,) that a search came by: J'J (`h`), J'r (`g`) and r'r (`cost`) of all records there."""

    theta: Array
    h: Array
    g: Array
    cost: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Descent:
    """The course of a search: the best point, a last change too small to evaluate, and how it ended.

    `converged` and `status` as in `Minimum`.
    """

    point: Point
    change: Array
    converged: bool
    status: str


def minimise(
    structure: Structure,
    data: Sequence[Dataset],
    start: Array,
    free: NDArray[np.bool_] | None = None,
    steps: int = _STEPS,
) -> Minimum:
    """Return the minimum of the sum of squared residuals from a start vector (P + ΣQ,).

    `start` is in the units of the parameters; `free` (P + ΣQ,) says which entries may move (all). After so many `steps` a search
    begins anew, and at last ends unsettled.
    """
    return lowest(structure, data, (start,), free, steps)


def lowest(
    structure: Structure,
    data: Sequence[Dataset],
    starts: Sequence[Array],
    free: NDArray[np.bool_] | None = None,
    steps: int = _STEPS,
    worth: float = 0.0,
) -> Minimum:
    """Return the lowest of the minima that start vectors lead to; `free` (P + ΣQ,), `steps` and `worth` as in `descent`."""
    layout = Layout(structure, tuple(data))
    nearer = _far_ones_last(layout, _in_the_valley(layout, starts, free), free)
    ends: list[Descent] = []
    for start in nearer:
        end = descent(layout, start, free, steps, worth, ends)
        if end not in ends:
            ends.append(end)
    others = [(end.point.theta, end.point.cost) for end in ends]
    enough = min(end.point.cost for end in ends) * (1 + _AS_LOW / layout.samples)
    # Of ends that are as good as each other, one where the search has settled.
    best = min(ends, key=lambda end: (end.point.cost > enough, not end.converged, end.point.cost))
    in_vain = 0
    for _ in range(_MOST_TIMES):
        if best.converged or in_vain == _IN_VAIN:
            break
        # Along a valley full of kinks steps have become short, and are long again when the search begins anew.
        before = best.point.cost
        best = descent(layout, best.point.theta, free, steps, worth)
        in_vain += best.point.cost > _MUCH_LOWER * before
    theta = best.point.theta + best.change
    predictions, cost = _evaluate(layout, theta)
    if not cost <= best.point.cost * (1 + _ENOUGH**2):
        # A kink lay within the last small change.
        theta = best.point.theta
        predictions, cost = _evaluate(layout, theta)
    return Minimum(
        theta=theta,
        predictions=predictions,
        cost=cost,
        converged=best.converged,
        status=best.status,
        others=tuple(other for other in others if other[0] is not best.point.theta),
    )


def _in_the_valley(
    layout: Layout, starts: Sequence[Array], free: NDArray[np.bool_] | None
) -> Sequence[Array]:
    """The start vectors, or where the best of them lead to while the parameters that shape a curved valley are held.

    One start by itself is where an earlier search ended.
    """
    held = layout.held_at_first
    if held is None or len(starts) == 1:
        return starts
    moves = np.ones(len(starts[0]), dtype=bool) if free is None else free.copy()
    if not (moves[: len(held)] & held).any():
        return starts
    moves[: len(held)] &= ~held
    points = (descent(layout, start, moves, _STEPS_TO_VALLEY).point for start in starts)
    ends = sorted(points, key=lambda point: point.cost)
    distinct = [
        end for n, end in enumerate(ends) if n == 0 or end.cost > (1 + _SAME_PLACE) * ends[n - 1].cost
    ]
    return [end.theta for end in distinct[:_VALLEYS]]


def _far_ones_last(
    layout: Layout, starts: Sequence[Array], free: NDArray[np.bool_] | None
) -> Sequence[Array]:
    """The start vectors in their order, but for those far behind the best: they come when it is known how far others get."""
    if len(starts) == 1:
        return starts
    bounds = layout.bounds(free)
    costs = [at(layout, np.clip(start, *bounds)).cost for start in starts]
    best = min(costs)
    order = sorted(range(len(starts)), key=lambda n: costs[n] > _FAR_BEHIND * best)
    return [starts[n] for n in order]


def descent(
    layout: Layout,
    start: Array,
    free: NDArray[np.bool_] | None = None,
    steps: int = _STEPS,
    worth: float = 0.0,
    ends: Sequence[Descent] = (),
) -> Descent:
    """Go from a start vector to a minimum of the sum of squared residuals; `free` (P + ΣQ,) says which entries may move (all).

    Levenberg (1944) and Marquardt (1963). The damping follows how well the quadratic model foretold the change of the cost: down
    to a hundredth at once where it did, up ten times and more where the cost rose. A step that leaves the bounds is cut at them;
    what may not move stays where it is, even beyond what these records would allow.
    Where steps are refused again and again the valley bends, and each refused one is tried along the next of `Layout.moves`.
    `start` (P + ΣQ,) is in the units of the parameters. Where the quadratic model, hardly damped, foretells a decrease of the
    cost that is less than a part `worth` of it, the search ends. At one of the settled `ends` of other starts, that is returned;
    far behind one, the search ends unsettled.
    """
    lower, upper = layout.bounds(free)
    moves = np.ones(len(start), dtype=bool) if free is None else free
    point, damping, least = at(layout, np.clip(start, lower, upper)), 1e-6, _FIRST_REFUSED
    refusals, refused = 0, 0.0
    for step in range(1, steps + 1):
        ahead = _damped_step(point, damping, lower, upper, moves)
        if ahead is None:
            return _end_descent(point, None, True, "every parameter is at a bound")
        if ahead.bend <= _ENOUGH**2 * point.cost / layout.samples:
            return _end_descent(point, ahead.change, True, f"converged in {step} steps")
        if 0.0 <= ahead.foretold < worth * point.cost and damping <= _HARDLY:
            return _end_descent(point, None, True, f"converged in {step} steps")
        reached = ahead.reached
        move = layout.moves[max(refusals - _BENT, 0) % len(layout.moves)]
        if move is not None:
            reached = np.minimum(np.maximum(move(point.theta, ahead.change), lower), upper)
        trial = at(layout, reached)
        if trial.cost <= point.cost:
            gained = point.cost - trial.cost
            done, point = gained <= 1e-13 * point.cost, trial
            damping = _lower_damping(damping, refused, gained, ahead.foretold)
            if done:
                return _end_descent(point, None, True, f"converged in {step} steps")
            elsewhere = _beside(ends, point, step, layout)
            if elsewhere is not None:
                return elsewhere
        else:
            refusals += 1
            # Of a motor with gravity leaps from a rough slope find more than small steps.
            refused = damping if refusals > _BENT and len(layout.moves) > 1 else 0.0
            damping = max(damping, least) * _after_a_rise(trial.cost, point.cost)
            # In a narrow valley that bends, the right damping is small, and found by now.
            least = 0.0
    return _end_descent(point, None, False, f"did not converge within {steps} steps")


def _beside(ends: Sequence[Descent], point: Point, step: int, layout: Layout) -> Descent | None:
    """How a search ends at a point because of the settled ends of others: at one, or too far behind; None where it goes on.

    `step` is the number of steps so far.
    """
    settled = [end for end in ends if end.converged]
    known = next((end for end in settled if _is_at(point, end, layout)), None)
    if (
        known is None
        and step >= _STEPS_TO_VALLEY
        and any(_FAR_BEHIND * s.point.cost < point.cost for s in settled)
    ):
        return _end_descent(point, None, False, f"far behind another start after {step} steps")
    return known


def at(layout: Layout, theta: Array) -> Point:
    """Return the normal equations and the sum of squares at a joint vector (P + ΣQ,)."""
    from servobench.identification.estimators import kernels

    if len(layout.data) == 1:
        h, g, cost = layout.normal(theta, layout.data[0])
    else:
        h, g, cost = np.zeros((len(theta), len(theta))), np.zeros(len(theta)), 0.0
        for record, place in zip(layout.data, layout.columns(), strict=True):
            own_h, own_g, own_cost = layout.normal(theta[place], record)
            with np.errstate(over="ignore", invalid="ignore"):  # far from any motor, as in `_sums`
                h[place[:, None], place] += own_h
                g[place] += own_g
            cost += own_cost
    return Point(theta=theta, h=h, g=g, cost=cost if kernels.is_finite(h, cost) else np.inf)


def information(layout: Layout, squares: Sequence[Array]) -> Array:
    """Return J'J (P + ΣQ, P + ΣQ) of all records; `squares` are the records' own, as `square_jacobians` gives them."""
    places = layout.columns()
    size = int(places[-1][-1]) + 1
    h = np.zeros((size, size))
    for square, place in zip(squares, places, strict=True):
        h[place[:, None], place] += square
    return h


def square_jacobians(layout: Layout, predictions: Sequence[Prediction]) -> list[Array]:
    """Return J'J (P + Q, P + Q) of each record."""
    jacobians = [jacobian_and_residual(r, p)[0] for r, p in zip(layout.data, predictions, strict=True)]
    # Far from any motor a pendulum's sensitivities may grow beyond all numbers.
    with np.errstate(over="ignore", invalid="ignore"):
        return [jacobian.T @ jacobian for jacobian in jacobians]


def jacobian_and_residual(record: Dataset, prediction: Prediction) -> tuple[Array, Array]:
    """Return the Jacobian (V, P + Q) and the residual (V,) of the V samples that are valid."""
    residual = record.y - prediction.y
    if prediction.valid.all():
        return prediction.jacobian, residual
    return prediction.jacobian[prediction.valid], residual[prediction.valid]


def _sums(record: Dataset, prediction: Prediction) -> tuple[Array, Array, float]:
    """J'J, J'r and r'r of a record."""
    j, r = jacobian_and_residual(record, prediction)
    # Far from any motor a pendulum's sensitivities may grow beyond all numbers: `at` takes such a place for infinitely bad.
    with np.errstate(over="ignore", invalid="ignore"):
        return j.T @ j, j.T @ r, float(r @ r)


def _evaluate(layout: Layout, theta: Array) -> tuple[tuple[Prediction, ...], float]:
    """The predictions at a joint vector, and their sum of squares."""
    predictions = tuple(
        layout.structure.predict(theta[place], record)
        for record, place in zip(layout.data, layout.columns(), strict=True)
    )
    residuals = [jacobian_and_residual(r, p)[1] for r, p in zip(layout.data, predictions, strict=True)]
    cost = sum(float(r @ r) for r in residuals)
    return predictions, cost if np.isfinite(cost) else np.inf


def _lower_damping(damping: float, refused: float, gained: float, foretold: float) -> float:
    """The damping after a step that lowered the cost; towards that of the last `refused` step it falls slowly."""
    ratio = gained / foretold if foretold > 0 else 0.0
    factor = 0.01 if ratio > 0.9 else 0.1 if ratio > 0.5 else 1.0 if ratio > 0.25 else 4.0
    if factor < 1.0 and damping * factor <= refused:
        factor = max(factor, _SLOWLY)
    return max(damping * factor, _LEAST_DAMPING)


def _after_a_rise(cost: float, before: float) -> float:
    """The factor for the damping after a refused step: ten, and more if the cost rose by orders of magnitude."""
    return 10 * min((cost / before) ** 0.25, 100.0) if before > 0 else 1000.0


@dataclass(frozen=True, slots=True)
class _Step:
    """A step from a point: its `change` (P + ΣQ,), where it leads to (`reached`), the fall that is foretold, and s'H s."""

    change: Array
    reached: Array
    foretold: float
    bend: float


def _damped_step(
    point: Point, damping: float, lower: Array, upper: Array, moves: NDArray[np.bool_]
) -> _Step | None:
    """The step of (H + λ diag H) s = g, cut at the bounds; None where every parameter is at one."""
    from servobench.identification.estimators import kernels

    change, reached = np.empty(len(point.theta)), np.empty(len(point.theta))
    count, foretold, bend = kernels.damped_step(
        point.h, point.g, damping, point.theta, lower, upper, moves, change, reached
    )
    return _Step(change, reached, foretold, bend) if count else None


def _is_at(point: Point, end: Descent, layout: Layout) -> bool:
    """Whether a point lies where another search ended: as low, and nearer than would show, measured by the curvature there."""
    enough = _AS_LOW * end.point.cost / layout.samples
    if point.cost > end.point.cost + enough:
        return False
    apart = point.theta - end.point.theta
    return float(apart @ end.point.h @ apart) <= enough


def _end_descent(point: Point, change: Array | None, converged: bool, status: str) -> Descent:
    still = np.zeros_like(point.theta)
    return Descent(
        point=point, change=still if change is None else change, converged=converged, status=status
    )
