"""Frequency response: points of G(jω) with their bands, and a linear structure fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable
from servobench.core.finding import Finding, warning
from servobench.identification.estimators.base import ESTIMATORS, Abilities, Fit, hindrance
from servobench.identification.estimators.covariance import conservative, inverse, plain, sandwich
from servobench.identification.estimators.least_squares import (
    Layout,
    Minimum,
    information,
    minimise,
    square_jacobians,
)
from servobench.identification.estimators.output_error import simulations
from servobench.identification.estimators.spectral.detection import DetectionLines
from servobench.identification.estimators.spectral.fitting import PointFit, fit_points
from servobench.identification.estimators.spectral.readings import bode_readings
from servobench.identification.estimators.spectral.response import (
    FrequencyResponse,
    frequency_response,
    remarks,
)
from servobench.identification.models.base import STRUCTURES, Model, Structure
from servobench.recordings.measurement.dataset import Dataset

__all__ = ["DetectionLines", "FrequencyResponse", "ResponseFit", "bode_readings", "frequency_response"]

_UNLIKELY = 5.0  # standard deviations of the misfit beyond which the structure isn't that of the points


class ResponseFit:
    """Fits the transfer function to points of the frequency response, each weighted with the noise around its lines.

    The noise may have any colour, as its level is measured at each frequency; leakage is fitted, not windowed. What a frequency
    response doesn't show, such as an offset of the input, is then found by output error with the rest held.
    In a closed loop the noise comes back through the input, and the estimate is biased. Source: see `estimators.spectral.local`.
    """

    abilities = Abilities(
        method=(
            "fits the transfer function to points of the frequency response, weighted by the noise measured "
            "around each line"
        ),
        noise="any stationary noise: its spectrum is measured",
        interval="covers for noise of any colour; wider where the structure misses the points",
        position=True,
        speed=True,
        chain=True,
        irregular_times=False,
        several_records=True,
        closed_loop=False,
        delay=True,
        friction=False,
        disturbance=False,
    )

    def supports(self, structure: Structure, data: Sequence[Dataset]) -> Finding | None:
        """Return a refusal for friction and irregular times, None otherwise."""
        return hindrance("frequency_response", self.abilities, structure, data)

    def fit(
        self, structure: Structure, data: Sequence[Dataset], starts: Sequence[Array] | None = None
    ) -> Fit:
        """Return the fit to the points of all records; raises `NotIdentifiable` where they show too few of them."""
        lacking = self.supports(structure, data)
        if lacking is not None:
            raise NotIdentifiable(lacking.sentence.rstrip("."))
        guess = structure.guesses(data)[0]
        return _fit(structure, data, fit_points(structure, data, starts[0] if starts else guess), guess)


ESTIMATORS.member("frequency_response")(ResponseFit())


def _fit(structure: Structure, data: Sequence[Dataset], point_fit: PointFit, guess: Array) -> Fit:
    """The fit that settled points stand for, with records simulated by it.

    A guess (P + ΣQ,) has the nuisance parameters, and those that a frequency response doesn't show.
    """
    start = np.concatenate(
        [
            np.where(point_fit.seen, point_fit.theta, guess[: len(point_fit.theta)]),
            guess[len(point_fit.theta) :],
        ]
    )
    free = np.ones(len(start), dtype=bool)
    free[: len(point_fit.theta)] = ~point_fit.seen
    minimum = minimise(structure, data, start, free)
    sd = float(np.sqrt(minimum.cost / max(sum(int(p.valid.sum()) for p in minimum.predictions), 1)))
    records = simulations(structure, data, minimum.theta)
    return Fit(
        model=Model(structure=structure, theta=minimum.theta[: len(point_fit.theta)], data=data[0]),
        covariance=_with_unseen(point_fit, Layout(structure, tuple(data)), minimum),
        estimator="frequency_response",
        structure=STRUCTURES.name_of(structure),
        converged=point_fit.converged,
        status="converged" if point_fit.converged else "did not converge",
        residual_sd=sd,
        records=tuple(replace(record, innovations=record.residual / (sd or 1.0)) for record in records),
        findings=(*remarks(data, point_fit.points), *_about(data, point_fit)),
    )


def _with_unseen(point_fit: PointFit, layout: Layout, minimum: Minimum) -> Array:
    """The covariance (P, P) with that of the parameters that the frequency response doesn't show.

    They follow the others as the sum of squares wants it, by -H_uu⁻¹ H_us with the nuisance parameters among the u, and are
    uncertain by themselves as output error is with the others held.
    """
    visible, count = point_fit.seen, len(point_fit.seen)
    if visible.all():
        return point_fit.covariance
    h = information(layout, square_jacobians(layout, minimum.predictions))
    own, shown = np.flatnonzero(~visible), np.flatnonzero(visible)
    hidden = np.concatenate([own, np.arange(count, len(h))])
    part = h[np.ix_(hidden, hidden)]
    spread = np.zeros((count, len(shown)))
    spread[shown] = np.eye(len(shown))
    spread[own] = -(inverse(part) @ h[np.ix_(hidden, shown)])[: len(own)]
    covariance = spread @ point_fit.covariance[np.ix_(shown, shown)] @ spread.T
    scores, variance = _scores(layout, minimum)
    alone = conservative(plain(part, variance), sandwich(part, [s[:, hidden] for s in scores]))
    covariance[np.ix_(own, own)] += alone[: len(own), : len(own)]
    return np.asarray(covariance, dtype=np.float64)


def _scores(layout: Layout, minimum: Minimum) -> tuple[list[Array], float]:
    """J_k r_k of each record over the joint vector, (N, P + ΣQ), and the variance of the residuals."""
    scores, total, used = [], 0.0, 0
    for record, prediction, place in zip(layout.data, minimum.predictions, layout.columns(), strict=True):
        residual = (record.y - prediction.y)[prediction.valid]
        s = np.zeros((len(residual), len(minimum.theta)))
        s[:, place] = prediction.jacobian[prediction.valid] * residual[:, None]
        scores.append(s)
        total, used = total + float(residual @ residual), used + len(residual)
    return scores, total / max(used, 1)


def _about(data: Sequence[Dataset], point_fit: PointFit) -> list[Finding]:
    """Findings from the fit itself."""
    findings = []
    if not point_fit.converged:
        findings.append(
            warning(
                "search-not-settled", "The search for the parameters did not converge; they may be wrong."
            )
        )
    if point_fit.misfit > 1 + _UNLIKELY * np.sqrt(2 / max(point_fit.freedom, 1)):
        findings.append(
            warning(
                "response-misfit",
                f"The structure misses the points of the frequency response by {np.sqrt(point_fit.misfit):.2g} times "
                "the noise; the intervals are wider by that factor. Look at the Bode figure, or use a structure of "
                "higher order.",
            )
        )
    if any(record.reference is not None for record in data):
        findings.append(
            warning(
                "loop-closed",
                "The data have a reference, so the loop was closed and noise biases the frequency response. Use "
                "clsrivc or prediction_error.",
            )
        )
    return findings
