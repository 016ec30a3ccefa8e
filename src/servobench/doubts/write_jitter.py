"""Voltages that acted at other times than the data say, by an amount that changes from tick to tick.

Sample k is latched at t_k, and identification takes u_k to act from then on; it acts from t_k + w_k, when the device was given
it. A constant w goes into the delay, where that is estimated. What changes of it puts the steps of the input at wrong times: to
first order, from step k on the position has -K (u_k - u_k-1) (w_k - w) (1 - e^(-(t - t_k)/τ)) that the model lacks. Scatter
of w is one more noise then, and moves a parameter by its mean over few steps; drift of w bends. What either does to
the time constant is computed rather than guessed: the model is simulated with the input at the times of writing and with that
at the times of the samples, and the difference is carried through the linear map from an error in the output to the
parameters, (J'J)⁻¹ J', of which the delay is one where it is estimated. Where nobody noted the times of writing nothing is said.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.channels import Array
from servobench.doubts.base import DOUBTS, Doubt
from servobench.estimators.base import Fit, FittedRecord
from servobench.finding import Finding, info, warning
from servobench.score_test import ScoreTest

_WORTH_A_WORD = 0.5  # standard deviations: of 95 intervals of 100 that hold the truth, 92 are left
_MISLEADING = 1.0  # 83 are left


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether the time constant was moved by more than a part of its standard deviation."""
    if "time_constant" not in fit.model.names or all(record.data.written is None for record in fit.records):
        return []
    sd = fit["time_constant"].sd
    if not (sd > 0 and np.isfinite(sd)):
        return []
    moved = moved_by_jitter(fit)
    if not abs(moved) > _WORTH_A_WORD * sd:
        return []
    tell = warning if abs(moved) > _MISLEADING * sd else info
    return [tell("write-jitter", _sentence(fit, moved, sd), parameters=("time_constant",))]


def moved_by_jitter(fit: Fit) -> float:
    """Return how far the estimated time constant is off [s] because voltages acted later than their samples, to first order."""
    largest = max(float(np.abs(record.data.u).max()) for record in fit.records)
    if largest == 0:
        return 0.0
    # A delay that is estimated has the usual wait in it already: to put it in a second time would be far from first order.
    waits = np.concatenate(_waits(fit))
    usual = float(waits.mean()) if "delay" in fit.model.names else 0.0
    lacking = [_lacking(fit, record, usual) for record in fit.records]
    return float(ScoreTest(fit, largest).shift(lacking)[fit.model.names.index("time_constant")])


def _waits(fit: Fit) -> list[Array]:
    """How long after its sample each voltage was written [s], of the records in which that was noted."""
    return [r.data.written - r.data.t_input for r in fit.records if r.data.written is not None]


def _lacking(fit: Fit, record: FittedRecord, usual: float) -> Array:
    """What the output has (M,) because the input acted when it was written, less the usual wait, and not when it is said to."""
    data = record.data
    if data.written is None:
        return np.zeros(len(data.y))
    theta = np.concatenate([fit.model.theta, record.nuisance])
    acted = fit.model.structure.predict(theta, replace(data, t_input=data.written - usual)).y
    return np.asarray(acted - fit.model.structure.predict(theta, data).y, dtype=np.float64)


def _sentence(fit: Fit, moved: float, sd: float) -> str:
    least, median, most = 1e6 * np.quantile(np.concatenate(_waits(fit)), (0.0, 0.5, 1.0))
    cure = (
        "Let the loop run with real-time priority, with less beside it, or by the device's own clock"
        if "delay" in fit.model.names
        else "Identify the delay, too, or make the time between sample and voltage shorter"
    )
    return (
        f"The voltages were written {least:.0f} to {most:.0f} µs after their samples, {median:.0f} µs in the median, and the "
        "model takes each to act as long after its sample as any other: that moved the time constant by about "
        f"{1000 * moved:+.2g} ms, {abs(moved) / sd:.1f} of its standard deviations. {cure}."
    )


DOUBTS.member("write_jitter")(Doubt(codes=("write-jitter",), about_fit=_about_fit))
