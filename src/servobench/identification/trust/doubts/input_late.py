"""An input that changed at other times than its rows say, as where a log keeps every n-th row of its controller.

A delay is one number for all changes. Where each change lies somewhere between two rows, some of the answers to it are in the row
before the one that shows it; and as no two come by the same time, what the model misses lies around the changes, a different part
of each.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.feedback import answers_to_output

_SURE = 4.0  # standard errors: one in 15,000 records by chance
_PART = 0.1  # of the residual's square: less isn't what limits the result
_FEWEST = 8  # changes of the input
# Rows from a sample to the change: what a wrong lag leaves beside the change isn't ahead of it.
_NEARBY = (-1, 0, 1, 2)
_ALONE = 1.5  # times the changes in the rows beside it: a change by itself, not one of a gradual course
_CLEAR = 0.05  # of the largest change, or of the input's range: a smaller one shifts nothing
_AS_OFTEN = 0.75  # of the sample time: an input whose rows lie nearer is known between those of the output
_COARSE = 0.3  # of all lags: rows that lie nearer leave little room between them
_UNEVEN = 4.0  # times the square of what is missed elsewhere: twice as much in each row
_MOST = 0.5  # of what is missed


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether what a motor that no loop drives does beyond its model shows changes of the input between the rows."""
    records = [
        each
        for each in fit.records
        if not (each.data.closed_loop or answers_to_output(each.data))
        # Of an output that is renewed now and then the file knows the input in between.
        and each.data.input_step > _AS_OFTEN * each.data.sample_time
    ]
    looked_at = [(record, around) for record in records if (around := _around_changes(record)) is not None]
    sense = np.sign(fit.model["gain"]) if "gain" in fit.model.names else 0.0
    ahead = [record for record, around in looked_at if _is_ahead(around, sense)]
    if ahead:
        return [
            _finding(
                "The output answers to some changes of the input before the row that shows them", ahead[0]
            )
        ]
    late = [record for record, around in looked_at if _is_coarse(fit, record) and _differs_at_changes(around)]
    return [
        _finding("The output answers to no two changes of the input after the same time", record)
        for record in late[:1]
    ]


def _finding(symptom: str, record: FittedRecord) -> Finding:
    step = with_unit(record.data.sample_time, "s", 2)
    sentence = (
        f"{symptom}, which no delay explains. Between rows, {step} apart, the input was another one than the file says: maybe "
        "the log keeps every n-th row of the controller. Record each row in which the input changes."
    )
    return warning("input-late", sentence, parameters=("gain", "time_constant", "delay"))


class _Around(NamedTuple):
    """The changes of the input [V] before each sample (M,), the samples that are looked at, and what the model leaves there.

    `changes` (M,) stand at the first sample that they act on; `rows` (N,) are numbers of samples, `residual` (N,) is that of the
    output, of a position what comes in each row, as what it has missed stays missing. `beside` (N, 5) are a constant and the
    changes near each row, `coefficients` (5,) what the residual has of them, and `rest` (N,) is without that.
    """

    changes: Array
    rows: NDArray[np.int64]
    residual: Array
    beside: Array
    coefficients: Array
    rest: Array


def _around_changes(record: FittedRecord) -> _Around | None:
    """The residual around the changes of the input; None where there are too few of them, or nothing else."""
    changes = np.diff(record.data.input_at_output, prepend=record.data.input_at_output[0])
    rows = np.arange(1, len(changes) - 2)
    # Of an input that changes gradually, what the model misses near rest or at speed looks like that.
    size, before, after = (np.abs(changes[rows + lag]) for lag in (0, -1, 1))
    least = _CLEAR * float(np.ptp(record.data.u))
    alone = size > np.maximum(_ALONE * np.maximum(before, after), least)
    if len(rows) <= 2 * _FEWEST or np.count_nonzero(alone) < _FEWEST:
        return None
    rows = rows[record.valid[rows]]
    beside = np.column_stack([np.ones(len(rows)), *(changes[rows + lag] for lag in _NEARBY)])
    position = record.data.kind == "position"
    residual = (np.diff(record.residual, prepend=np.nan) if position else record.residual)[rows]
    coefficients, _, rank, _ = np.linalg.lstsq(beside, residual, rcond=None)
    if rank < beside.shape[1]:
        return None
    return _Around(
        changes=changes,
        rows=rows,
        residual=residual,
        beside=beside,
        coefficients=np.asarray(coefficients, dtype=np.float64),
        rest=residual - beside @ coefficients,
    )


def _is_ahead(around: _Around, sense: float) -> bool:
    """Whether changes of the input explain a part of the residual one row before them, in the direction of the change."""
    x, rest = around.beside, around.rest
    bread = np.linalg.inv(x.T @ x)
    at = 1 + _NEARBY.index(1)
    white = bread[at, at] * (rest @ rest) / (len(rest) - x.shape[1])
    # Where noise is larger at changes of the input than elsewhere (White 1980).
    influence = (bread[at] @ x.T) * rest
    uneven = float(influence @ influence)
    along = sense * float(around.coefficients[at])
    explained = along**2 / bread[at, at]
    residual = around.residual
    return bool(along > _SURE * np.sqrt(max(white, uneven)) and explained > _PART * (residual @ residual))


def _is_coarse(fit: Fit, record: FittedRecord) -> bool:
    """Whether the rows are so far apart that what happens between them matters to the motor."""
    lags = sum(fit.model[name] for name in ("time_constant", "delay") if name in fit.model.names)
    return "time_constant" in fit.model.names and record.data.sample_time > _COARSE * lags


def _differs_at_changes(around: _Around) -> bool:
    """Whether most of the residual lies around changes of the input, and isn't the same part of each."""
    from scipy.stats import f, norm

    clear = np.flatnonzero(np.abs(around.changes) > _CLEAR * np.abs(around.changes).max())
    beside = np.zeros(len(around.changes), dtype=bool)
    beside[clear] = beside[clear - 1] = True
    at_changes = around.rest[beside[around.rows]]
    elsewhere = around.rest[~beside[around.rows]]
    if min(len(clear), len(at_changes), len(elsewhere)) < _FEWEST:
        return False
    ratio = np.mean(at_changes**2) / max(np.mean(elsewhere**2), np.finfo(float).tiny)
    by_chance = f.isf(2.0 * norm.sf(_SURE), len(at_changes), len(elsewhere))
    most = at_changes @ at_changes > _MOST * (around.residual @ around.residual)
    return bool(ratio > max(_UNEVEN, by_chance) and most)


DOUBTS.member("input_late")(Doubt(codes=("input-late",), about_fit=_about_fit))
