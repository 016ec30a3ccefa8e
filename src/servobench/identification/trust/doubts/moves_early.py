"""A shaft that stands, and sets off before the input changes for the first time: the two columns are out of step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_STANDS = 3  # samples in which the shaft is seen to stand
_EARLY = 2.0  # sample times: a row may be latched before its input is written
_NO_INPUT = 0.02  # of the largest: what an amplifier puts out without an input
_TURNS = 0.05  # of the top speed: a shaft that is pushed as it is touched, or creeps, is slower
_CLEAR = 3.0  # times the noise that a position has to be off by


def _about(records: Sequence[Dataset]) -> list[Finding]:
    return [finding for record in records for finding in _of(record)]


def _of(data: Dataset) -> list[Finding]:
    """Whether a shaft without an input stands, then turns as it goes on to do, and only then the input changes."""
    changes = np.flatnonzero(data.u != data.u[0])
    largest = float(np.abs(data.u).max(initial=0.0))
    if data.closed_loop or not len(changes) or abs(float(data.u[0])) > _NO_INPUT * largest:
        return []  # a controller answers to what somebody else does to the shaft
    change = float(data.t_input[changes[0]])
    before = int(np.searchsorted(data.t_output, change))
    off = _distance_from_start(data)
    away = np.flatnonzero(off[:before] > data.noise)
    if not len(away) or away[0] < _STANDS or before >= len(data.y):
        return []
    half_way = (int(away[0]) + before) // 2
    if data.kind == "position" and abs(float(data.y[half_way] - data.y[away[0]])) <= data.noise:
        # A reading that flickered, or a shaft that was touched: it stands again.
        off = np.abs(data.y - data.y[half_way])
        away = half_way + np.flatnonzero(off[half_way:before] > data.noise)
        if not len(away):
            return []
    start = float(data.t_output[away[0]])
    early = change - start
    # An input that is written row by row may have changed anywhere between two of its rows.
    unseen = change - float(data.t_input[changes[0] - 1])
    steps = np.diff(data.t_input)
    in_every_row = unseen <= _EARLY * float(np.median(steps))
    if early < _EARLY * data.sample_time or (in_every_row and early < _EARLY * unseen):
        return []
    if not _turns_as_later(data, before, off):
        return []
    sentence = (
        f"{data.name}: the shaft stands without an input and sets off at {data.in_seconds(start)}, {with_unit(early, 's', 2)} "
        f"before the input changes, at {data.in_seconds(change)}: the two columns are out of step by at least that. Shift one of "
        "them, or log both in the same row."
    )
    return [warning("moves-before-input", sentence, parameters=("delay", "time_constant"))]


def _distance_from_start(data: Dataset) -> Array:
    """How far each output (M,) is from what it was while the shaft stood: from its place, or from no speed."""
    stood = float(np.median(data.y[:_STANDS])) if data.kind == "position" else 0.0
    return np.abs(data.y - stood)


def _turns_as_later(data: Dataset, before: int, off: Array) -> bool:
    """Whether by the sample `before` the shaft is clear of noise, and as fast as it is when driven, in the same direction."""
    if off[before - 1] <= _CLEAR * data.noise:
        return False
    speed = smooth_speed(data)
    top = float(np.percentile(np.abs(speed), 95))
    later = float(np.median(speed[before : before + max(before, _STANDS)]))
    return bool(speed[before - 1] * np.sign(later) > _TURNS * top)


DOUBTS.member("moves_early")(Doubt(codes=("moves-before-input",), about_data=_about))
