"""Whether a fit confirms a cause: the motor is fitted with and without it, and the residuals are compared.

Noise biases the motor's equation (`equation`), and one more column absorbs some of that bias, so a cause may improve it
although nothing is wrong. The simulation of a fit has no such bias. A cause is confirmed if

    Σ r₀² / Σ r₁² ≥ 1/0.6   and   (T/τ) ln(Σ r₀² / Σ r₁²) ≥ 20,

r₀ and r₁ being the residuals of the speed, over a time constant τ, of the fits without it and with it, T the time recorded. The
residual due to a random torque is worth T/τ independent values, so the second is a likelihood ratio (Wilks 1938): a cause with
thirty sizes and two free parameters reaches 20 by chance once in a thousand records (2 ln 30 + 2 · 6.9 = 20.6).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.errors import NotIdentifiable
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.identification.models.motion import turns_both_ways
from servobench.recordings.measurement.dataset import Dataset

if TYPE_CHECKING:
    from servobench.identification.trust.explanations.cause import CauseFit

_LEFT = 0.6  # of the squared residuals may be left with the cause
_LIKELIER = 20.0
_FITS = 50.0  # percent of the output that a fit with the cause explains at least
_LONGEST = 0.1  # of the record: the longest lag over which residuals are differenced


def is_confirmed(cause: CauseFit, records: Sequence[Dataset], without: Fit | None) -> bool:
    """Return whether the motor with the cause, in the records or in its structure, simulates the data better.

    `without` is the fit without any cause, as `fit_plainly` gives it.
    """
    motors = _motors(records)
    treated = [cause.remedy(each) for each in records] if cause.remedy else list(records)
    with_it = _best(treated, (cause.structure,) if cause.structure else motors)
    if with_it is None or not with_it.fit_percent > _FITS:
        return False
    if without is None:
        return True
    lag = _lag(with_it, without)
    before, after = _misfit(without, lag), _misfit(with_it, lag)
    if not after < _LEFT * before:
        return False
    time = sum(each.duration for each in records)
    return after == 0 or time / lag * float(np.log(before / after)) >= _LIKELIER


def fit_plainly(records: Sequence[Dataset], known: Mapping[str, Fit]) -> Fit | None:
    """Return the fit of a motor that nothing is wrong with, None where the records support none.

    `known` are output error's fits of these records by the names of their structures, as far as they have been made.
    """
    return _best(records, _motors(records), known)


def _motors(records: Sequence[Dataset]) -> tuple[str, ...]:
    if turns_both_ways(records):
        return ("first_order_coulomb", "first_order")
    return ("first_order_one_way_rest", "first_order_one_way")


def _best(
    records: Sequence[Dataset], structures: Sequence[str], known: Mapping[str, Fit] | None = None
) -> Fit | None:
    """The fit that leaves least; None where the records support none of the structures."""
    fits = []
    for name in structures:
        if known and name in known:
            fits.append(known[name])
            continue
        method, structure = ESTIMATORS["output_error"], STRUCTURES[name]
        if method.supports(structure, records) is not None:
            continue
        try:
            fits.append(method.fit(structure, records))
        except NotIdentifiable:
            continue
    fits = [each for each in fits if np.isfinite(each.fit_percent)]
    return max(fits, key=lambda each: each.fit_percent, default=None)


def _lag(*fits: Fit) -> float:
    """The longest time constant [s] of the fits that have one, between a sample time and a tenth of the longest record."""
    data = [record.data for record in fits[0].records]
    longest, step = max(each.duration for each in data), max(each.sample_time for each in data)
    time_constants = [fit.model["time_constant"] for fit in fits if "time_constant" in fit.model.names]
    return max(min([max(time_constants, default=np.inf), _LONGEST * longest]), step)


def _misfit(fit: Fit, lag: float) -> float:
    """The sum of squares of what a fit leaves over of the speed, of positions as differences over a time [s]."""
    total = 0.0
    for record in fit.records:
        rest = np.where(record.valid, record.residual, 0.0)
        if record.data.kind == "position":
            across = max(1, round(lag / record.data.sample_time))
            rest = rest[across:] - rest[:-across]
        total += float(rest @ rest) / max(len(rest), 1) * record.data.duration
    return total
