"""The channel of a recording that holds the measured armature current, and its values at the samples of the output."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info
from servobench.recordings.formats.roles import ARMATURE_CURRENT, plain_name, quantity_of
from servobench.recordings.measurement.column import si_factor
from servobench.recordings.recording import Recording, Series

CURRENT_NAMES = frozenset({
    "current", "i", "ia", "im", "curr", "amps", "motor_current", "armature_current", "measured_current", "actual_current",
    "current_measured", "current_actual", "stator_current", "winding_current",
})  # fmt: skip
"""The names by which a measured current is recognised, in lower case and without a unit."""
_SAME = 0.01  # of a sample time: two channels that are latched that close together belong to the same sample


def armature_current(recording: Recording, t_output: Array) -> tuple[Array | None, list[Finding]]:
    """Return the armature's current [A] at the times t_output (M,) [s], NaN where it isn't known, and what to know of it.

    It is the one channel, neither input nor output, whose unit is a current's and whose name is `ARMATURE_CURRENT`, or else
    one of `CURRENT_NAMES`.
    Without such a channel it is None, and with several too: then a finding names them. Nothing is interpolated: a sample
    counts where it was taken at the time of one of the output.
    """
    candidates = [series for series in recording.series if _is_current(recording, series)]
    candidates = [series for series in candidates if series.channel.name == ARMATURE_CURRENT] or candidates
    if not candidates:
        return None, []
    if len(candidates) > 1:
        names = ", ".join(repr(series.channel.name) for series in candidates)
        sentence = (
            f"{recording.name}: {names} could each be the armature's current, so none of them is used; say which with "
            "`current=COL` to learn resistance and torque constant, too."
        )
        return None, [info("current-ambiguous", sentence)]
    series = candidates[0]
    current = _at(series, t_output)
    if np.isnan(current).all():
        sentence = (
            f"{recording.name}: the current {series.channel.name!r} has no sample at the time of one of the output, "
            "so it isn't used; record both at the same times."
        )
        return None, [info("current-at-other-times", sentence)]
    return current, _find_current(recording, series)


def _is_current(recording: Recording, series: Series) -> bool:
    channel = series.channel
    other_role = channel.name in {recording.input, recording.output}
    return (
        not other_role
        and plain_name(channel.name) in CURRENT_NAMES
        and quantity_of(channel.unit) == "current"
    )


def _find_current(recording: Recording, series: Series) -> list[Finding]:
    """A device of ours says itself which of its channels is the current; of any other file it has to be said."""
    if any(finding.code == "current-named" for finding in recording.findings):
        return []
    if recording.info is not None and recording.info.channel(series.channel.name) is not None:
        return []
    name = series.channel.name
    sentence = (
        f"`{name}` is recognised as the armature's current by its name and unit; otherwise say `current=COL`."
    )
    return [info("current-recognised", sentence)]


def _at(series: Series, t_output: Array) -> Array:
    """The current [A] at times (M,), NaN where the channel has no finite sample within a hundredth of a sample time."""
    out = np.full(len(t_output), np.nan)
    if series.t is None or series.channel.unit is None or len(t_output) < 2:
        return out
    finite = np.isfinite(series.t) & np.isfinite(series.values)
    t, values = series.t[finite], series.values[finite]
    if not len(t):
        return out
    order = np.argsort(t, kind="stable")
    t, values = t[order], values[order]
    after = (
        np.clip(np.searchsorted(t, t_output), 1, max(len(t) - 1, 1))
        if len(t) > 1
        else np.zeros(len(t_output), int)
    )
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(t[after] - t_output) < np.abs(t[before] - t_output), after, before)
    same = np.abs(t[nearest] - t_output) <= _SAME * float(np.median(np.diff(t_output)))
    out[same] = values[nearest[same]] * si_factor(series.channel.unit)[0]
    return out
