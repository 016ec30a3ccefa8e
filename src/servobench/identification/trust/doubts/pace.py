"""An input so slow that the motor follows it without a measurable lag."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_LEAST = 0.08  # of the input's own spread: what the lag makes of the input; a square wave of 25 time constants makes 0.2


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether u - u/(τ s + 1), what the lag holds back of the input, is small compared with the input's spread in all records."""
    if "time_constant" not in fit.model.names:
        return []
    estimate = fit["time_constant"]
    tau = estimate.value + 2 * estimate.sd
    if not np.isfinite(tau):
        return []
    if any(np.ptp(record.data.u) == 0.0 for record in fit.records):
        return []  # a step before the first row, whose lag is in the record all the same
    held_back = spread = 0.0
    for record in fit.records:
        data = record.data
        steps = np.diff(data.t_input, append=data.t_input[-1] + data.sample_time)
        held_back += float(np.sum(steps * (data.u - _lag_input(data, tau)) ** 2))
        spread += float(np.sum(steps * (data.u - data.u.mean()) ** 2))
    if spread == 0 or held_back > _LEAST**2 * spread:
        return []
    sentence = (
        "The input changes so slowly that the motor follows it almost without lag: the lag accounts for only "
        f"{100 * np.sqrt(held_back / spread):.1f} % of the input. The gain is well determined; the sum of time constant and "
        "delay is known better than either of them. Record steps."
    )
    return [info("input-too-slow", sentence, parameters=("time_constant", "delay"))]


def _lag_input(data: Dataset, tau: float) -> Array:
    """The input behind a first-order lag of τ, at its own times, from a settled start."""
    from servobench.identification.models import kernels

    decays = np.exp(-np.diff(data.t_input) / max(tau, 1e-12))
    return kernels.lag_input(data.u, data.input_before, decays)


DOUBTS.member("pace")(Doubt(codes=("input-too-slow",), about_fit=_about_fit))
