"""A sensor of the speed that doesn't show zero while the shaft stands."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

_STANDS = 0.05  # of the samples, in which the model's shaft stands
_PLAIN = 0.02  # of the largest speed
_EVEN = 0.3  # of what is shown: nine tenths of it lie within so much


def _about_fit(fit: Fit) -> list[Finding]:
    return [finding for record in fit.records for finding in _of(record)]


def _of(record: FittedRecord) -> list[Finding]:
    data = record.data
    if data.kind != "speed":
        return []
    # What friction holds stands; a model without any, or that turns slowly, never is at zero itself.
    shown = data.y[record.valid & (record.prediction == 0.0)]
    if len(shown) < _STANDS * len(data.y):
        return []
    low, middle, high = (float(each) for each in np.percentile(shown, (5, 50, 95)))
    top = float(np.percentile(np.abs(data.y), 99))
    if abs(middle) < _PLAIN * top or high - low > _EVEN * abs(middle):
        return []
    sentence = (
        f"{data.name}: while friction holds the model's shaft, the speed reads {with_unit(middle, data.output_unit, 3)} all the "
        "time. That is the zero of the sensor rather than a motion; the offset of the input makes up for it here, and offset and "
        "friction may both be wrong. Subtract it from the column."
    )
    return [warning("sensor-zero", sentence, parameters=("offset_voltage", "coulomb_voltage"))]


DOUBTS.member("sensor_zero")(Doubt(codes=("sensor-zero",), about_fit=_about_fit))
