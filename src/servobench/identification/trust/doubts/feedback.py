"""An input that a controller computed from the output of the same row: the noise of the sensor goes round in the loop."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.echo import row_by_row
from servobench.recordings.measurement.dataset import Dataset

_WELL = 90.0  # percent of the output: what is explained so well isn't the noise of a sensor
_FEWEST = 30  # rows in which the input changes
# The correlation of changes in the same row. A motor answers in the rows after a change of its input, and in its direction.
_AGAINST = -0.7


def answers_to_output(data: Dataset) -> bool:
    """Return whether the input of each row goes against the speed of the same row, as a controller has it."""
    if data.kind != "speed":
        return False
    u, begun = row_by_row(data)
    inputs, speeds = np.diff(u[begun:]), np.diff(data.y[begun:])
    if np.count_nonzero(inputs) < _FEWEST or not (np.ptp(inputs) > 0 and np.ptp(speeds) > 0):
        return False  # a ramp changes by as much in each row
    return bool(_sense(data) * np.corrcoef(inputs, speeds)[0, 1] < _AGAINST)


def _sense(data: Dataset) -> float:
    """The sense in which a positive input turns the motor: it turns where it is driven, on the whole."""
    return float(np.sign(row_by_row(data)[0] @ data.y))


def _about(fit: Fit) -> list[Finding]:
    records = [record.data for record in fit.records]
    if any(data.closed_loop for data in records) or not any(map(answers_to_output, records)):
        return []
    is_motor = "gain" not in fit.model.names or all(fit.model["gain"] * _sense(data) > 0 for data in records)
    if fit.fit_percent >= _WELL and is_motor:  # the controller's law read backward explains as much
        return []
    sentence = (
        "The input goes against the speed of the same row: a controller computed it from there, and the noise of the sensor "
        "drives the motor. What comes out may be the controller's law and not the motor. Name what the loop follows with "
        "`reference=COL`, record steps of it that are much larger than the noise, or leave the controller out."
    )
    return [warning("feedback-unnamed", sentence, parameters=("gain", "time_constant", "delay"))]


DOUBTS.member("feedback")(Doubt(codes=("feedback-unnamed",), about_fit=_about))
