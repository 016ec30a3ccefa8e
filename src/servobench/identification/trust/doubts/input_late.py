"""An output that answers to a change of the input before the row that shows it."""

from __future__ import annotations

import numpy as np

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


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether the residual of a motor that no loop drives follows changes of the input in the row after.

    A delay is one number for all changes. Where a logger keeps every n-th row of a controller, each change lies somewhere between
    two rows, and some of the answers to it are in the row before the one that shows it.
    """
    sense = np.sign(fit.model["gain"]) if "gain" in fit.model.names else 0.0
    late = [
        record
        for record in fit.records
        if not (record.data.closed_loop or answers_to_output(record.data)) and _is_ahead(record, sense)
    ]
    if not late:
        return []
    step = with_unit(late[0].data.sample_time, "s", 2)
    sentence = (
        f"The output answers to some changes of the input before the row that shows them, which no delay explains. Between rows, "
        f"{step} apart, the input was another one than the file says: maybe the log keeps every n-th row of the controller. "
        "Record each row in which the input changes."
    )
    return [warning("input-late", sentence, parameters=("gain", "time_constant", "delay"))]


def _is_ahead(record: FittedRecord, sense: float) -> bool:
    """Whether changes of the input explain a part of the residual one row before them, in the direction of the change."""
    changes = np.diff(record.data.input_at_output, prepend=record.data.input_at_output[0])
    rows = np.arange(1, len(changes) - 2)
    if len(rows) <= 2 * _FEWEST or np.count_nonzero(changes) < _FEWEST:
        return False
    rows = rows[record.valid[rows]]
    x = np.column_stack([np.ones(len(rows)), *(changes[rows + lag] for lag in _NEARBY)])
    # What a position has missed stays missing: of that, what comes in each row is looked at.
    position = record.data.kind == "position"
    residual = (np.diff(record.residual, prepend=np.nan) if position else record.residual)[rows]
    coefficients, _, rank, _ = np.linalg.lstsq(x, residual, rcond=None)
    if rank < x.shape[1]:
        return False
    rest = residual - x @ coefficients
    bread = np.linalg.inv(x.T @ x)
    at = 1 + _NEARBY.index(1)
    white = bread[at, at] * (rest @ rest) / (len(rows) - x.shape[1])
    # Where noise is larger at changes of the input than elsewhere (White 1980).
    influence = (bread[at] @ x.T) * rest
    uneven = float(influence @ influence)
    along = sense * float(coefficients[at])
    explained = along**2 / bread[at, at]
    return bool(along > _SURE * np.sqrt(max(white, uneven)) and explained > _PART * (residual @ residual))


DOUBTS.member("input_late")(Doubt(codes=("input-late",), about_fit=_about_fit))
