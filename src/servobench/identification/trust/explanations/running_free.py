"""A motor that runs free while it is faster than its input would make it: a driver whose current can't turn round."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.coasting import ADVICE, PARAMETERS
from servobench.identification.trust.explanations.equation import Regression, with_extra
from servobench.recordings.measurement.dataset import Dataset

_SEEN = 0.03  # of the rows, at least, in which the motor is let go of, and in which it isn't
_FALLS = 0.75  # of these rows: nothing drives the motor there, so that it slows down
_ROUNDS = 4  # in which the gain, and where the motor is let go of, agree
_FINE = 8  # parts of a sample time, in which a speed that falls is held
FREE = 0.5
"""Of what the winding brakes a motor with: as much of it has to be missing where a driver lets go."""


def _free_run(case: Case) -> CauseFit | None:
    """Whether a motor that is faster than its input would make it feels neither: τ ω' + (1 - α) ω = (K - β) u - ... there.

    A driver whose current can't turn round lets go of such a motor. Where that is needs K, which is found in turn with it.
    """
    if any(each.data.chain.linear for each in case.motions):
        return None
    speeds = [np.interp(m.t, m.data.t_output, smooth_speed(m.data)) for m in case.motions]
    pairs = list(zip(case.motions, speeds, strict=True))
    falls = let_go = [np.gradient(w, m.t) * w < 0 for m, w in pairs]
    free = _free(case, speeds, falls)
    for _ in range(_ROUNDS):
        let_go = [_is_let_go(w, m.u, float(free.coefficients[1])) for m, w in pairs]
        free = _free(case, speeds, let_go)
    gain, braking, driving = (float(free.coefficients[at]) for at in (1, 5, 6))
    where = np.concatenate(let_go)
    if gain == 0 or braking < FREE or not _SEEN < float(np.mean(where)) < 1 - _SEEN:
        return None
    if float(np.mean(np.concatenate(falls)[where])) < _FALLS:
        return None
    sentence = (
        "While it slows down the motor runs free: its driver lets go of it where it should brake it. "
        f"{ADVICE}"
    )
    return CauseFit(
        finding=warning("coasts", sentence, parameters=PARAMETERS),
        structural=True,
        misfit=free.misfit,
        chosen=2,
        remedy=lambda data: _with_hold(data, gain, braking, driving),
    )


def _free(case: Case, speeds: Sequence[Array], let_go: Sequence[NDArray[np.bool_]]) -> Regression:
    """The equation with speed and input as two further columns where the motor is `let_go` of, (N,) each a record."""
    pairs = list(zip(case.motions, speeds, let_go, strict=True))
    return case.with_columns(
        [m.filter_through_chain(np.where(free, w, 0.0)) for m, w, free in pairs],
        [m.filter_through_chain(np.where(free, m.u, 0.0)) for m, _, free in pairs],
    )


def _is_let_go(speed: Array, u: Array, gain: float) -> NDArray[np.bool_]:
    """Where a speed (N,) is beyond what an input u (N,) of the same sign makes of a gain."""
    return np.asarray((np.abs(speed) > np.abs(gain * u)) & (gain * u * speed >= 0), dtype=np.bool_)


def _with_hold(data: Dataset, gain: float, braking: float, driving: float) -> Dataset:
    """The record of a motor that isn't let go of, with an input that takes the place of what it feels then."""
    speed = smooth_speed(data)

    def brake_input(t: Array, u: Array) -> Array:
        w = np.interp(t, data.t_output, speed)
        return np.where(_is_let_go(w, u, gain), (braking * w + driving * u) / gain, 0.0)

    return with_extra(data, brake_input, fine_times(data))


def fine_times(data: Dataset) -> Array:
    """Return the times ((M - 1) · 8,) of rows (M,) with seven between each two [s], at which a falling speed is held."""
    steps = np.arange(_FINE) / _FINE
    return np.asarray((data.t_output[:-1, None] + np.diff(data.t_output)[:, None] * steps).ravel())


EXPLANATIONS.member("running_free")(_free_run)
