"""A sensor of the speed that doesn't show zero while the shaft stands."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

_STANDS = 0.05  # of the samples, in which the model's shaft stands
_PLAIN = 0.02  # of the largest speed
_LEAST = 0.002  # of it: what is less matters to nobody
_BEYOND = 3.0  # standard deviations
_EVEN = 0.3  # of what is shown: its medians lie within so much
_PARTS = 5  # of the time at rest, each with a median


def _about_fit(fit: Fit) -> list[Finding]:
    names = set(fit.model.names)
    known = {"gain", "coulomb_voltage"} <= names and fit.model["gain"] != 0.0
    # A reading that is worth more of the input than friction is known to.
    least = _BEYOND * fit.sd("coulomb_voltage") * abs(fit.model["gain"]) if known else np.inf
    # A variance below zero tells nothing of friction either.
    return [
        finding for record in fit.records for finding in _of(record, np.inf if np.isnan(least) else least)
    ]


def _of(record: FittedRecord, least: float) -> list[Finding]:
    """The finding on a record whose speed at rest reads at least that much, or so much of its largest."""
    data = record.data
    if data.kind != "speed":
        return []
    # What friction holds stands; a model without any, or that turns slowly, never is at zero itself.
    shown = data.y[record.valid & (record.prediction == 0.0)]
    if len(shown) < _STANDS * len(data.y):
        return []
    medians = [float(np.median(part)) for part in np.array_split(shown, _PARTS)]
    middle, top = float(np.median(shown)), float(np.percentile(np.abs(data.y), 99))
    if abs(middle) < min(_PLAIN * top, max(_LEAST * top, least)) or np.ptp(medians) > _EVEN * abs(middle):
        return []
    sentence = (
        f"{data.name}: while friction holds the model's shaft, the speed reads {with_unit(middle, data.output_unit, 3)} all the "
        "time. That is probably the zero of the sensor rather than a motion; the offset of the input makes up for it here, and "
        "offset and friction may both be wrong. Subtract it from the column."
    )
    return [warning("sensor-zero", sentence, parameters=("offset_voltage", "coulomb_voltage"))]


DOUBTS.member("sensor_zero")(Doubt(codes=("sensor-zero",), about_fit=_about_fit))
