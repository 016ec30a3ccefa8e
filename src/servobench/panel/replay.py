"""An earlier recording, as scopes show it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.panel.columns import apply_mapping
from servobench.panel.frames import COLUMNS, Scope, encode
from servobench.panel.library import MAPPING
from servobench.recordings.native.reader import read
from servobench.recordings.recording import Recording
from servobench.rig.experiment import read_experiment

MOST_ROWS = 20_000


def frame_of(path: Path) -> bytes:
    """Return the frame of the recording in a native file, thinned to 20,000 rows; raises `UsageError` where it has no times."""
    recording = read(path)[0]
    if (path.parent / MAPPING).is_file():
        recording = apply_mapping(recording, path.parent)
        roles = {recording.input, recording.output, recording.reference}
        recording = replace(
            recording, series=tuple(each for each in recording.series if each.channel.name in roles)
        )
    return encode(0, thin_rows(scope_rows(recording)))


def scope_rows(recording: Recording) -> Array:
    """Return what scopes show of a recording, (N, 13) in the order of `COLUMNS`; what it hasn't got is NaN.

    Raises `UsageError` for channels without times, or with different ones.
    """
    t = recording.series[0].t
    if t is None or any(each.t is None or len(each.t) != len(t) for each in recording.series):
        raise UsageError(
            f"{recording.name}: its channels have no times, or different ones, so they can't be drawn"
        )
    if "counts" in recording:
        chain = read_experiment(recording.experiment, recording.name).chain if recording.experiment else ""
        return Scope(recording, chain).take(np.column_stack([t, *(each.values for each in recording.series)]))
    values = np.full((len(t), len(COLUMNS)), np.nan)
    values[:, 0] = t
    for role, column in ((recording.input, "applied"), (recording.reference, "reference")):
        if role is not None:
            values[:, COLUMNS.index(column)] = recording[role].values
    _put_output(recording, values)
    return values


def _put_output(recording: Recording, values: Array) -> None:
    """Put the output of an imported recording in the place that its unit says."""
    from servobench.core.units import unit

    if recording.output is None or (symbol := recording[recording.output].channel.unit) is None:
        return
    kind = unit(symbol)
    column = {"position": "position", "speed": "speed"}.get(kind.quantity)
    if column is not None and kind.si in ("rad", "rad/s"):
        values[:, COLUMNS.index(column)] = recording[recording.output].values * kind.factor


def thin_rows(values: Array, most: int = MOST_ROWS) -> Array:
    """Return rows (N, C) as at most `most`: of each stretch its first row and, of each column, the least and the largest value.

    Two rows stand for a stretch, in which a column has its least value first where that came first; their times are the
    stretch's first and last.
    """
    if len(values) <= most:
        return values
    stretches = np.array_split(values, most // 2)
    out = np.empty((2 * len(stretches), values.shape[1]))
    for k, stretch in enumerate(stretches):
        known = np.where(np.isnan(stretch), np.inf, stretch)
        low, high = known.argmin(axis=0), np.where(np.isnan(stretch), -np.inf, stretch).argmax(axis=0)
        columns = np.arange(values.shape[1])
        out[2 * k] = stretch[np.minimum(low, high), columns]
        out[2 * k + 1] = stretch[np.maximum(low, high), columns]
        out[2 * k, 0], out[2 * k + 1, 0] = stretch[0, 0], stretch[-1, 0]
    return out
