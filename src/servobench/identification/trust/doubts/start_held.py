"""A long delay that only the start from rest shows, under an input that rises: static friction would look the same.

A shaft that sticks also sets off late: when the input has grown to what holds it. A step that is large enough tells the two
apart, and so does what comes after the start. So the delay's standard deviation is worked out again without the rows before the
first motion, with speed and position free there. Where the delay differs from a usual one by less than three times that, only the
start speaks for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.estimators.covariance import effective_samples
from servobench.identification.estimators.delay_prior import is_usual, prior_of_delay
from servobench.identification.estimators.sizes import WEAK, sizes
from servobench.identification.models.first_motion import rests_at_first
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

CODE: Final = "start-held"
_RISES = 0.15  # of the input at the first motion: by how much less it was a whole delay earlier, at least
_SURELY = 3.0  # standard deviations


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether static friction explains a start from rest as well as the delay does, and nothing else shows the delay."""
    names = fit.model.names
    if not {"delay", "time_constant"} <= set(names) or not fit.model.structure.friction or is_usual(fit):
        return []
    prior = prior_of_delay(fit.model.structure, [record.data for record in fit.records])
    delay = fit.model["delay"]
    if prior is None or delay <= prior.middle:
        return []
    levels = [_levels(record, prior.middle, delay) for record in fit.records]
    held = [each for each in levels if each is not None]
    if not held or delay - prior.middle > _SURELY * _sd_beside_starts(fit, levels):
        return []
    then, now = held[0]
    unit = fit.records[0].data.input_unit
    sentence = (
        f"Only the start from rest shows the delay of {with_unit(delay, 's', 2)}: the input rose from {with_unit(then, unit, 2)} "
        f"to {with_unit(now, unit, 2)} before the shaft moved, and static friction may have held it until then. Gain and "
        "friction would then be different, too. Start the motor with one large step."
    )
    return [warning(CODE, sentence, parameters=("gain", "time_constant", "coulomb_voltage", "delay"))]


def _levels(record: FittedRecord, usual: float, delay: float) -> tuple[float, float] | None:
    """The inputs a `delay` and a `usual` one [s] before the first motion; None unless it starts from rest and the input rises."""
    data, first = record.data, record.data.first_motion
    if first is None or not rests_at_first(data):
        return None
    then, now = data.u[data.hold_indices(first.effect - data.delay - np.array([delay, usual]))]
    return (float(then), float(now)) if abs(now) - then * np.sign(now) > _RISES * abs(now) else None


def _sd_beside_starts(fit: Fit, levels: Sequence[tuple[float, float] | None]) -> float:
    """The delay's standard deviation [s] from all rows but those before a first motion that static friction may have held up."""
    scale = sizes(fit)[: len(fit.model.names)]
    information = np.eye(len(scale)) / WEAK**2
    for record, held in zip(fit.records, levels, strict=True):
        j, e = _after_start(fit, record, held is not None)
        if len(e) > len(scale) and e.any():
            information += (j * scale).T @ (j * scale) * effective_samples(e) / float(e @ e)
    at = fit.model.names.index("delay")
    return float(scale[at] * np.sqrt(np.linalg.inv(information)[at, at]))


def _after_start(fit: Fit, record: FittedRecord, is_held: bool) -> tuple[Array, Array]:
    """The Jacobian (N, P) and the residual (N,) of a record, from its first motion on if it is held until then.

    What another speed and position at its beginning would make of them is taken out.
    """
    data, first = record.data, record.data.first_motion
    prediction = fit.model.structure.predict(np.append(fit.model.theta, record.nuisance), data)
    begins = first.effect if is_held and first is not None else data.t_output[0]
    use = prediction.valid & (data.t_output >= begins)
    gone = data.t_output[use] - begins
    free = np.exp(-gone / (fit.model["time_constant"] or data.sample_time))[:, None]
    if data.kind == "position":
        free = np.column_stack([free, np.ones(len(gone))])
    basis, _ = np.linalg.qr(free)
    columns = np.column_stack(
        [prediction.jacobian[use][:, : len(fit.model.names)], (data.y - prediction.y)[use]]
    )
    left = columns - basis @ (basis.T @ columns)
    return left[:, :-1], left[:, -1]


DOUBTS.member("start_held")(Doubt(codes=(CODE,), about_fit=_about_fit))
