"""A motor that coasts while its input is zero: a bridge that is switched off there instead of braking.

    τ ω' + ω = K (u - ...) under an input,   τ ω' + (1 - α) ω = K (-...) without one

α is the part of the braking that is the winding's, and missing while the bridge is off: it follows from the motor's equation
with an open circuit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.coasting import PARAMETERS
from servobench.identification.trust.explanations.equation import with_extra
from servobench.identification.trust.explanations.running_free import FREE, fine_times
from servobench.recordings.measurement.dataset import Dataset

_ZERO = 1e-3  # of the largest input: a smaller one is none
_SEEN = 0.02  # of the rows, at least, in which the motor coasts, and in which it is driven
_MOVES = 0.02  # of the largest speed: below it friction may hold the shaft


def _coast_at_zero(case: Case) -> CauseFit | None:
    """Whether the winding brakes under an input only; whether it does where the motor outruns one is `running_free`."""
    if any(each.data.chain.linear for each in case.motions):
        return None
    speeds = [np.interp(m.t, m.data.t_output, smooth_speed(m.data)) for m in case.motions]
    off = [_is_off(m.u, m.data) for m in case.motions]
    coasts = [zero & _moves(w) for zero, w in zip(off, speeds, strict=True)]
    if not _SEEN < float(np.mean(np.concatenate(coasts))) < 1 - _SEEN:
        return None
    free = case.with_columns(
        [
            m.filter_through_chain(np.where(zero, w, 0.0))
            for m, w, zero in zip(case.motions, speeds, off, strict=True)
        ]
    )
    gain, braking = (float(free.coefficients[at]) for at in (1, 5))
    if gain == 0 or braking < FREE:
        return None
    sentence = (
        "While its input is zero the motor coasts: its driver switches off there and doesn't brake. Let it brake at zero duty "
        "(both ends of the bridge low), or leave the stretches without an input out."
    )
    return CauseFit(
        finding=warning("coasts", sentence, parameters=PARAMETERS),
        structural=True,
        misfit=free.misfit,
        chosen=1,
        remedy=lambda data: _with_missing_brake(data, braking / gain),
    )


def _is_off(u: Array, data: Dataset) -> NDArray[np.bool_]:
    """Where an input (N,) of a record is zero."""
    return np.asarray(np.abs(u) <= _ZERO * np.abs(data.u).max(initial=0.0), dtype=np.bool_)


def _moves(speed: Array) -> NDArray[np.bool_]:
    return np.asarray(np.abs(speed) > _MOVES * np.abs(speed).max(initial=0.0), dtype=np.bool_)


def _with_missing_brake(data: Dataset, by_speed: float) -> Dataset:
    """The record with an input for the braking that is missing while the driver is off: so many units of the input by speed."""
    speed = smooth_speed(data)

    def brake_input(t: Array, u: Array) -> Array:
        return np.where(_is_off(u, data), by_speed * np.interp(t, data.t_output, speed), 0.0)

    return with_extra(data, brake_input, fine_times(data))


EXPLANATIONS.member("released")(_coast_at_zero)
