"""A random torque on the shaft beside the noise of the measurement: its likelihood, and what it does to a structure.

The output is what the model simulates, plus what a white torque adds (a speed that decays with τ, and its integral), plus white
measurement noise of variance r. With q the intensity of the acceleration [1/s³ of the output's unit squared], only the
ratio q/r shapes the filter; r follows from the size of the innovations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from servobench.channels import Array
from servobench.measurement.dataset import Dataset
from servobench.models.base import Output, Parameter, Prediction, Structure
from servobench.transfer_function import TransferFunction

# The grid of ln(q/r) in the profile, from nothing to a disturbance that drowns the measurement noise within a sample.
_GRID = np.linspace(-10.0, 30.0, 21)
_SETTLED = 0.02  # of ln(q/r)


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """The noise model of one data set: time constant τ [s], ratio q/r, measurement noise variance r."""

    tau: float
    ratio: float
    variance: float

    @property
    def wander(self) -> float:
        """The standard deviation of the speed that the torque causes in the long run, √(q τ / 2), in output units a second."""
        return float(np.sqrt(0.5 * self.ratio * self.variance * self.tau))


@dataclass(frozen=True, kw_only=True)
class Profile:
    """The most likely disturbance behind residuals, and twice the gain in log-likelihood over none at all."""

    disturbance: Disturbance
    likelihood_ratio: float


def profile(
    residuals: Sequence[Array], data: Sequence[Dataset], moving: Sequence[Array], tau: float
) -> Profile:
    """Return the disturbance that makes residuals (M,) of several records most likely, for a given τ.

    The likelihood is profiled over q/r on a grid and then by a bounded search; r is never taken smaller than the encoder's
    rounding, Q²/12, where that is known. No disturbance is on the edge of what can be, so the likelihood ratio
    exceeds 2.71 in 5 % of the records without one, and 5.41 in 1 % (Self and Liang 1987).
    """
    from scipy.optimize import minimize_scalar

    def cost(ratio: float) -> tuple[float, float]:
        return _negative_log_likelihood(residuals, data, moving, tau, ratio)

    costs = np.array([cost(float(np.exp(level)))[0] for level in _GRID])
    best = int(np.argmin(costs))
    ends = (_GRID[max(best - 1, 0)], _GRID[min(best + 1, len(_GRID) - 1)])
    found = minimize_scalar(
        lambda level: cost(float(np.exp(level)))[0],
        bounds=ends,
        method="bounded",
        options={"xatol": _SETTLED},
    )
    ratio = float(np.exp(found.x))
    without, _ = cost(0.0)
    within, variance = cost(ratio)
    return Profile(
        disturbance=Disturbance(tau=tau, ratio=ratio, variance=variance),
        likelihood_ratio=2 * (without - within),
    )


def whitened(x: Array, data: Dataset, moving: Array, disturbance: Disturbance) -> Array:
    """Return columns x (M,) or (M, K) as innovations of unit variance."""
    flat = np.array(x, dtype=np.float64, order="C").reshape(len(x), -1)
    _filter(flat, data, moving, disturbance.tau, disturbance.ratio)
    return np.asarray((flat / np.sqrt(disturbance.variance)).reshape(x.shape), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Whitened:
    """A structure whose predictions are innovations: least squares on it is maximum likelihood under the disturbance.

    Wraps another structure; the data that go with it are `whitened_data`. `moving` holds where the shaft slides, for each of
    the records `data`; a record is known by its times, which whitening leaves alone.
    """

    structure: Structure
    disturbance: Disturbance
    data: tuple[Dataset, ...]
    moving: tuple[Array, ...]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those of the structure."""
        return self.structure.parameters

    @property
    def friction(self) -> bool:
        """That of the structure."""
        return self.structure.friction

    def nuisance(self, data: Dataset) -> tuple[Parameter, ...]:
        """Those of the structure."""
        return self.structure.nuisance(data)

    def bounds(self, data: Sequence[Dataset]) -> tuple[Array, Array]:
        """Those of the structure."""
        return self.structure.bounds(data)

    def guesses(self, data: Sequence[Dataset]) -> tuple[Array, ...]:
        """Those of the structure."""
        return self.structure.guesses(data)

    def predict(self, theta: Array, data: Dataset) -> Prediction:
        """Return the innovations of the prediction and of its Jacobian, the filter held fixed."""
        plain = self.structure.predict(theta, data)
        both = self._filtered(np.column_stack([plain.y, plain.jacobian]), data)
        return Prediction(y=both[:, 0], jacobian=both[:, 1:], valid=plain.valid)

    def unmodelled(self, theta: Array, data: Dataset) -> Array:
        """Return the innovations of what the structure knows that it may be wrong by."""
        return self._filtered(self.structure.unmodelled(theta, data), data)

    def transfer_function(self, theta: Array, output: Output, data: Dataset) -> TransferFunction:
        """That of the structure."""
        return self.structure.transfer_function(theta, output, data)

    @property
    def whitened_data(self) -> tuple[Dataset, ...]:
        """The records with the innovations of their outputs in place of the outputs."""
        return tuple(replace(record, y=self._filtered(record.y, record)) for record in self.data)

    def sliding(self, theta: Array, data: Dataset) -> Array:
        """That of the structure."""
        return self.structure.sliding(theta, data)

    def _filtered(self, x: Array, data: Dataset) -> Array:
        moving = next(
            m for m, record in zip(self.moving, self.data, strict=True) if record.t_output is data.t_output
        )
        return whitened(x, data, moving, self.disturbance)


def _negative_log_likelihood(
    residuals: Sequence[Array], data: Sequence[Dataset], moving: Sequence[Array], tau: float, ratio: float
) -> tuple[float, float]:
    """-ln p of the residuals at the most likely measurement noise, which comes with it."""
    squares, logarithms, samples = 0.0, 0.0, 0
    for residual, record, slides in zip(residuals, data, moving, strict=True):
        column = residual[:, None].copy()
        logarithms += float(np.sum(np.log(_filter(column, record, slides, tau, ratio))))
        squares += float(np.sum(column**2))
        samples += len(residual)
    quanta = [record.quantum or 0.0 for record in data]
    variance = max(squares / samples, min(quanta) ** 2 / 12, 1e-300)
    return 0.5 * (squares / variance + samples * np.log(variance) + logarithms), variance


def _filter(x: Array, data: Dataset, moving: Array, tau: float, ratio: float) -> Array:
    """Run columns through the filter in place, and return the variances of the innovations, for r = 1."""
    from servobench.estimators import kernels

    spread = np.empty(len(x))
    position = 1.0 if data.kind == "position" else 0.0
    kernels.innovations(data.t_output, tau, ratio, moving, position, 1.0 - position, x, spread)
    return spread
