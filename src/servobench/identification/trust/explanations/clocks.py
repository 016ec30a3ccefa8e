"""Two clocks that don't agree: the output's times run faster or slower than the input's."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.core.rounding import plain
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import (
    Motion,
    Regression,
    input_at,
    regression,
    sweep_count,
)
from servobench.recordings.measurement.dataset import Dataset

_RATES = np.array([3e-4, 6e-4, 1e-3, 1.5e-3, 2e-3, 3e-3, 5e-3, 7e-3, 1e-2, 1.5e-2, 2e-2, 3e-2])
_SWEPT = (
    6.0  # times through its range: of an input that changes once or twice, a lag that grows is any other lag
)
_AHEAD = 3.0  # sample times: an output that comes so much before its cause is out of step


def _drift(case: Case) -> CauseFit | None:
    """The best rate by which the input's clock goes wrong beside the output's, where its changes can show a lag that grows."""
    if max(sweep_count(each.u) for each in case.motions) < _SWEPT:
        return None
    tried = [(case.with_input(partial(_at_rate, rate=rate)), rate) for rate in (*-_RATES, *_RATES)]
    best_regression, rate = min(tried, key=lambda each: each[0].misfit)
    longest = max(float(each.t[-1] - each.t[0]) for each in case.motions)
    if abs(rate) * longest < max(each.data.sample_time for each in case.motions):
        return None  # less than the times of any one row may be out by
    sentence = (
        "The delay between input and output changes steadily, by about "
        f"{1000 * abs(rate) * longest:.2g} ms over the record: their times come from two clocks, "
        f"one of them {plain(100 * abs(rate), 2)} % faster. Time-stamp both with one clock."
    )
    return CauseFit(
        finding=warning("clock-drift", sentence, parameters=("delay", "time_constant", "gain")),
        misfit=best_regression.misfit,
        chosen=1,
        remedy=lambda data: _by_clock(data, rate),
    )


def _by_clock(data: Dataset, rate: float) -> Dataset:
    """A record whose input's times are those of the output's clock."""
    start = float(data.t_output[0])
    return replace(data, t_input=start + (data.t_input - start) / (1 + rate), reference=None)


def _at_rate(m: Motion, rate: float) -> Array:
    """The input of a record by a clock that goes faster by a rate."""
    return input_at(m.data, m.t[0] + (m.t - m.t[0]) * (1 + rate))


def _constant_shift(case: Case) -> CauseFit | None:
    """The best constant shift that puts the input before the output that it causes."""
    step = max(each.data.sample_time for each in case.motions)
    spans = step * np.unique(np.round(_AHEAD * 1.4 ** np.arange(16)))
    shortest = min(float(each.t[-1] - each.t[0]) for each in case.motions)
    best, ahead = 1.0, 0.0
    for span in spans[spans < 0.1 * shortest].tolist():
        share, trial = _shift_inputs(case, span)
        if share < best and trial.coefficients[1]:
            # What is left of the shift stands in the column of the input's derivative: K d.
            best, ahead = share, span - trial.coefficients[2] / trial.coefficients[1]
    if ahead < (_AHEAD - 1.5) * step:
        return None
    least = best * case.plain.misfit
    sentence = (
        f"The output comes about {1000 * ahead:.3g} ms before the input that causes it: the two "
        "columns are misaligned (a row was lost in one of them, or they were filtered "
        "differently). Shift one of them."
    )
    return CauseFit(
        finding=warning("delay-negative", sentence, parameters=("delay",)),
        misfit=least,
        chosen=1,
        remedy=lambda data: replace(data, t_input=data.t_input - ahead, reference=None),
    )


def _shift_inputs(case: Case, span: float) -> tuple[float, Regression]:
    """The misfit with inputs that act earlier by a span, where they are known at both times."""
    known = np.concatenate([(each.t <= each.t[-1] - span)[each.rows] for each in case.motions])
    columns, speed = case.base
    plain = regression(columns[known], speed[known])
    moved = columns.copy()
    inputs = [(each, input_at(each.data, each.t + span)) for each in case.motions]
    moved[:, 1] = np.concatenate([each.filter_through_chain(u) for each, u in inputs])
    moved[:, 2] = -np.concatenate([each.filter_through_chain(u, 1) for each, u in inputs])
    shifted_regression = regression(moved[known], speed[known])
    return shifted_regression.misfit / plain.misfit if plain.misfit > 0 else 1.0, shifted_regression


EXPLANATIONS.member("clock_drift")(_drift)
EXPLANATIONS.member("out_of_step")(_constant_shift)
