"""A structure fitted to the points of a frequency response: the likeliest parameters for their covariance.

The points of a window have circular, normal errors, so that the likelihood is exp(-Σ e* C⁻¹ e), e = ρ - G(θ)/M at the points of
each window, G with hold, delay and chain as they were in the data (Pintelon and Schoukens 2012, section 9.11, with the noise
levels from the lines themselves). The covariance of θ is (2 Re Σ J* C⁻¹ J)⁻¹, and larger where the structure misses the points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.rounding import count_text
from servobench.identification.estimators.covariance import inverse
from servobench.identification.estimators.spectral.lines import Stretch, stretches
from servobench.identification.estimators.spectral.local import Block, Local, local_fits
from servobench.identification.estimators.spectral.path import Complex, Path
from servobench.identification.models.base import Structure
from servobench.recordings.measurement.dataset import Dataset
from servobench.systems.transfer_function import TransferFunction

_ROUNDS = 3  # of points and fit; each makes the model that the points lean on a hundred times better
_STEPS = 40
_NOTHING = "the output doesn't respond to the input at any frequency: excite the motor more strongly"
_ENOUGH = 1e-3  # a step below this many standard deviations changes nothing that matters
_WIDTH = 1e-4  # of a parameter: the differences for the Jacobian, whose error is the square of that


@dataclass(frozen=True, kw_only=True, eq=False)
class Points:
    """The local fits of all stretches of all records, `locals`, and the models, input to shaft, that they lean on, `shapes`."""

    locals: tuple[Local, ...]
    shapes: tuple[TransferFunction, ...]

    @property
    def count(self) -> int:
        """The number of points."""
        return sum(len(block.ratio) for local in self.locals for block in local.blocks)


@dataclass(frozen=True, kw_only=True, eq=False)
class PointFit:
    """Points and the structure's parameters `theta` (P,) that suit them; the points lean on the parameters of the round before.

    `seen` (P,) says which parameters the frequency response depends on at all; `covariance` (P, P) is zero for the others.
    `misfit` is the sum of squares over its expectation, with `freedom` degrees of freedom; `converged` says that
    points and parameters suit each other.
    """

    points: Points
    theta: Array
    covariance: Array
    seen: NDArray[np.bool_]
    misfit: float
    freedom: int
    converged: bool


def fit_points(structure: Structure, data: Sequence[Dataset], start: Array) -> PointFit:
    """Return the points of all records and the structure fitted to them.

    The search starts from parameters `start` (P,), or (P + ΣQ,) with nuisance parameters, each in its own SI unit.

    Raises `NotIdentifiable` where the data have no frequency response, or too few points for the structure's parameters.
    """
    parts = [stretch for record in data for stretch in stretches(record)]
    theta = start[: len(structure.parameters)]
    for _ in range(_ROUNDS):
        result = _fit_once(structure, data, _points(structure, theta, parts), theta)
        theta = result.theta
    return result


def points_near(structure: Structure, data: Sequence[Dataset]) -> Points:
    """Return the points of all records, leaning on a structure that is fitted to them where they determine it.

    Where they don't, as one sine doesn't, they lean on the structure's guess. Raises `NotIdentifiable` where there are no points.
    """
    parts = [stretch for record in data for stretch in stretches(record)]
    theta = structure.guesses(data)[0][: len(structure.parameters)]
    points = _points(structure, theta, parts)
    for _ in range(_ROUNDS - 1):
        try:
            theta = _fit_once(structure, data, points, theta).theta
        except NotIdentifiable:
            break
        points = _points(structure, theta, parts)
    if not points.count:
        raise NotIdentifiable(_NOTHING)
    return points


def _points(structure: Structure, theta: Array, parts: Sequence[Stretch]) -> Points:
    shapes = tuple(shape_of(structure, theta, part.data) for part in parts)
    return Points(
        locals=tuple(local_fits(part, s) for part, s in zip(parts, shapes, strict=True)), shapes=shapes
    )


def shape_of(structure: Structure, theta: Array, data: Dataset) -> TransferFunction:
    """Return the transfer function for theta (P,) from the input to what of the shaft enters the chain."""
    return structure.transfer_function(theta, data.shaft_kind, data)


@dataclass(frozen=True, eq=False)
class _Part:
    """All points (m,) of one stretch: their path, ratios and models, and roots of the inverse covariances, with √2 in them.

    `roots` (m, L) has a row for each point, and `window` (m, L) says which points of its window the row multiplies.
    """

    data: Dataset
    path: Path
    ratio: Complex
    model: Complex
    roots: Complex
    window: NDArray[np.int64]

    @classmethod
    def of(cls, data: Dataset, blocks: Sequence[Block]) -> _Part:
        """The points of windows, one after the other."""
        sizes = [len(block.ratio) for block in blocks]
        starts = np.concatenate([[0], np.cumsum(sizes)])
        roots = np.zeros((starts[-1], max(sizes)), dtype=np.complex128)
        window = np.zeros((starts[-1], max(sizes)), dtype=np.int64)
        for block, start, size in zip(blocks, starts, sizes, strict=False):
            roots[start : start + size, :size] = np.sqrt(2) * np.linalg.inv(
                np.linalg.cholesky(block.covariance)
            )
            window[start : start + size, :size] = np.arange(start, start + size)
        return cls(
            data=data,
            path=replace(blocks[0].path, omega=np.concatenate([block.path.omega for block in blocks])),
            ratio=np.concatenate([block.ratio for block in blocks]),
            model=np.concatenate([block.model for block in blocks]),
            roots=roots,
            window=window,
        )

    def errors(self, shape: TransferFunction) -> Complex:
        """The errors (m,) of a model, whitened."""
        off = self.ratio - self.path.full(shape) / self.model
        return np.asarray(np.sum(self.roots * off[self.window], axis=1), dtype=np.complex128)


@dataclass(frozen=True, eq=False)
class _Problem:
    """Whitened errors over the parameters that a frequency response depends on."""

    structure: Structure
    parts: tuple[_Part, ...]

    def errors(self, theta: Array) -> Array:
        """All errors, real parts and imaginary parts, each of unit variance."""
        whole = np.concatenate(
            [part.errors(shape_of(self.structure, theta, part.data)) for part in self.parts]
        )
        return np.concatenate([whole.real, whole.imag])

    def jacobian(self, theta: Array, widths: Array) -> Array:
        """Minus the derivatives of the errors by the parameters, by central differences."""
        columns = []
        for n, width in enumerate(widths):
            shift = np.zeros(len(theta))
            shift[n] = width
            columns.append((self.errors(theta - shift) - self.errors(theta + shift)) / (2 * width))
        return np.column_stack(columns)


def _fit_once(structure: Structure, data: Sequence[Dataset], points: Points, theta: Array) -> PointFit:
    problem = _Problem(
        structure,
        tuple(_Part.of(local.stretch.data, local.blocks) for local in points.locals if local.blocks),
    )
    if not points.count:
        raise NotIdentifiable(_NOTHING)
    widths = _widths(structure, data, theta)
    lower, upper = structure.bounds(data)
    theta, cost, converged = _search(problem, np.clip(theta, lower, upper), widths, (lower, upper))
    j = problem.jacobian(theta, widths)
    visible = np.asarray(np.abs(j).max(axis=0) * widths > 1e-12, dtype=np.bool_)
    freedom = 2 * points.count - int(visible.sum())
    if (
        freedom < 0
        or np.linalg.matrix_rank(j[:, visible] / np.abs(j[:, visible]).max(axis=0), tol=1e-9) < visible.sum()
    ):
        raise NotIdentifiable(
            f"{count_text(points.count, 'point')} of a frequency response can't determine {int(visible.sum())} parameters: "
            "record more frequencies"
        )
    misfit = cost / freedom if freedom else 1.0
    return PointFit(
        points=points,
        theta=theta,
        covariance=max(misfit, 1.0) * inverse(j.T @ j),
        seen=visible,
        misfit=misfit,
        freedom=freedom,
        converged=converged,
    )


def _widths(structure: Structure, data: Sequence[Dataset], theta: Array) -> Array:
    """The steps of the differences: a part of the value, and for a delay, which may be zero, of a sample time."""
    step = min(record.sample_time for record in data)
    least = [step if parameter.name == "delay" else 1e-6 for parameter in structure.parameters]
    return _WIDTH * np.maximum(np.abs(theta), least)


def _search(
    problem: _Problem, theta: Array, widths: Array, bounds: tuple[Array, Array]
) -> tuple[Array, float, bool]:
    """Levenberg and Marquardt's search: the parameters, the sum of squares, and whether it settled."""
    errors = problem.errors(theta)
    cost, damping = float(errors @ errors), 1e-6
    for _ in range(_STEPS):
        j = problem.jacobian(theta, widths)
        h, g = j.T @ j, j.T @ errors
        at_bound = ((theta <= bounds[0]) & (g < 0)) | ((theta >= bounds[1]) & (g > 0))
        active = np.flatnonzero(~at_bound & (np.diag(h) > 0))
        change = np.zeros(len(theta))
        part = h[np.ix_(active, active)]
        change[active] = inverse(part + damping * np.diag(np.diag(part))) @ g[active]
        trial = np.clip(theta + change, *bounds)
        small = float((trial - theta) @ h @ (trial - theta)) <= _ENOUGH**2 * max(1.0, cost / len(errors))
        new_errors = problem.errors(trial)
        new_cost = float(new_errors @ new_errors)
        if new_cost <= cost:
            theta, errors, cost, damping = trial, new_errors, new_cost, max(damping / 5, 1e-12)
        else:
            damping = max(damping, 1e-9) * 10
        if small:
            return theta, cost, True
    return theta, cost, False
