"""A speed without a sign, of a sensor that doesn't tell the direction, under an input that turns the motor both ways."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.chance import least_misfit
from servobench.recordings.measurement.dataset import Dataset

_WELL = 90.0  # percent: what is explained so well has the sign that its input gives it
_BOTH = 0.2  # of the largest input, in either direction
_NOTHING = 0.02  # of the largest speed: what an unsigned speed may be below zero
_LEFT = 0.5  # of the misfit: what the size of the input leaves, or less
_SAMPLES = 2000  # from the beginning of each record


def _about(fit: Fit) -> list[Finding]:
    records = [record.data for record in fit.records]
    if fit.fit_percent >= _WELL or not any(map(_is_unsigned, records)):
        return []
    inputs = [data.input_at_output[:_SAMPLES] for data in records]
    sizes = [np.abs(u) if _is_unsigned(data) else u for data, u in zip(records, inputs, strict=True)]
    if not least_misfit(records, sizes) < _LEFT * least_misfit(records, inputs):
        return []
    sentence = (
        "The speed keeps one sign although the input changes its own, and follows the input's size: this sensor doesn't tell "
        "the direction. Give the speed the sign of the input, or identify a part of the record in which the motor turns one way."
    )
    return [warning("speed-unsigned", sentence, parameters=("gain", "time_constant", "coulomb_voltage"))]


def _is_unsigned(data: Dataset) -> bool:
    """Whether a speed keeps one sign under an input of both."""
    most = float(np.abs(data.u).max(initial=0.0))
    low, high = float(data.y.min()), float(data.y.max())
    one_sign = -_NOTHING * high <= low or high <= -_NOTHING * low
    return (
        data.kind == "speed"
        and one_sign
        and bool(data.u.min() < -_BOTH * most and data.u.max() > _BOTH * most)
    )


DOUBTS.member("unsigned_speed")(Doubt(codes=("speed-unsigned",), about_fit=_about))
