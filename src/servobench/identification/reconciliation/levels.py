"""The levels of the input in the data, and the part of them that is lost before the motor turns."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.identification.models.motion import directions
from servobench.identification.reconciliation.base import Question

_POINTS = 21
_LOST = (
    "coulomb_voltage",
    "offset_voltage",
)  # and what friction takes in one direction, coulomb_voltage_forward


def input_loss(question: Question) -> float:
    """Return the input that friction, offset and dead band take according to the fit; 0 where it knows none for certain."""
    losses = [question.fit[name] for name in question.fit.model.names if name.startswith(_LOST)]
    sure = [estimate.value for estimate in losses if abs(estimate.value) > 2 * estimate.sd]
    return float(max(sure, default=0.0))


def loss_shares(question: Question) -> Array | None:
    """Return the part of the input that is lost, at levels from the lowest to the highest at which the motor turned (n,).

    None where nothing is lost.
    """
    lost = input_loss(question)
    if lost <= 0:
        return None
    inputs = np.concatenate([np.abs(record.data.u) for record in question.fit.records])
    turning = inputs[inputs > 1.05 * lost]
    if not len(turning):
        return None
    return np.asarray(np.linspace(lost / turning.max(), lost / turning.min(), _POINTS), dtype=np.float64)


def reverses(question: Question) -> bool:
    """Whether the motor turned both ways, for a fiftieth of the time at least."""
    senses = np.concatenate([directions(record.data) for record in question.fit.records])
    return bool(min(np.mean(senses > 0), np.mean(senses < 0)) > 0.02)
