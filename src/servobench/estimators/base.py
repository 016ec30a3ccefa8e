"""The kind `estimators`: from data and a structure to a model with its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from servobench.channels import Array
from servobench.estimators.disturbance import Disturbance
from servobench.finding import Finding
from servobench.measurement.dataset import Dataset
from servobench.models.base import Model, Structure
from servobench.registry import Registry


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedRecord:
    """One record behind a fit: its data, the nuisance parameters (Q,), the prediction and the residual y - prediction (M,).

    `innovations` (M,) are what the estimator minimised, of unit variance: white where its noise model is right.
    `valid` (M,) is False where the chain still looks back before the record; those samples carry no weight.
    """

    data: Dataset
    nuisance: Array
    prediction: Array
    residual: Array
    innovations: Array
    valid: np.ndarray[tuple[int], np.dtype[np.bool_]]


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """One parameter's value, standard deviation and two-sided interval at a level (0.95), with its unit."""

    value: float
    sd: float
    interval: tuple[float, float]
    level: float
    unit: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """What an estimator gives: a model, and how well it is known.

    `covariance` (P, P) belongs to the model's parameters; `status` says in one sentence how the search ended, `converged` whether
    it did. `residual_sd` is in the unit of the output;
    `disturbance` is the noise model, None for white measurement noise alone.
    """

    model: Model
    covariance: Array
    estimator: str
    structure: str
    converged: bool
    status: str
    residual_sd: float
    records: tuple[FittedRecord, ...]
    disturbance: Disturbance | None = None
    findings: tuple[Finding, ...] = ()

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a parameter, with its 95 % interval."""
        return self.estimates[name]

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The estimates by name, each with its 95 % interval, value ± 1.96 sd."""
        sd = np.sqrt(np.diag(self.covariance))
        return {
            name: Estimate(
                value=float(value),
                sd=float(s),
                interval=(float(value - 1.959964 * s), float(value + 1.959964 * s)),
                level=0.95,
                unit=unit,
            )
            for name, value, s, unit in zip(
                self.model.names, self.model.theta, sd, self.model.units, strict=True
            )
        }

    @property
    def fit_percent(self) -> float:
        """How much of the output's variation the simulation explains, 100 (1 - |y - ŷ| / |y - mean|), over all records."""
        return fit_percent(self.records)


def fit_percent(records: Sequence[FittedRecord]) -> float:
    """Return 100 (1 - |y - ŷ| / |y - mean(y)|) over all records, each with its own mean; NaN where nothing varies."""
    misfit = sum(float(np.sum(r.residual[r.valid] ** 2)) for r in records)
    total = sum(float(np.sum((r.data.y[r.valid] - r.data.y[r.valid].mean()) ** 2)) for r in records)
    return 100.0 * (1.0 - float(np.sqrt(misfit / total))) if total > 0 else float("nan")


@runtime_checkable
class Estimator(Protocol):
    """A method of identification."""

    def supports(self, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
        """Return None where the method can do this, or a refusal that says why it can't."""
        ...

    def fit(
        self, structure: Structure, data: Sequence[Dataset], starts: Sequence[Array] | None = None
    ) -> Fit:
        """Return the fit of a structure to several datasets jointly.

        `starts` are vectors to begin from, in place of the structure's own guesses: the parameters, then the nuisance
        parameters of each record. Raises `NotIdentifiable` where the data don't determine the parameters.
        """
        ...


ESTIMATORS: Registry[Estimator] = Registry("estimator", "servobench.estimators")
