"""Columns that show how far apart samples are, though they aren't used as the times: rounded times and time steps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.units import unit
from servobench.recordings.formats.columns import TIME_NAMES, heading, time_unit
from servobench.recordings.formats.epoch import epoch_unit
from servobench.recordings.formats.roles import plain_name
from servobench.recordings.formats.time_steps import is_named_step, step_unit
from servobench.recordings.formats.times import MeanStep, mean_step
from servobench.recordings.recording import Recording, Series

_BACKWARD = 0.1  # of the steps; a column that goes back more often is no clock
_FEWEST = 10  # rows that differ elsewhere, before it is worth a word that none of the repeated ones does
_UNITS = ("s", "ms", "us", "ns")  # that a column without a unit may be in


@dataclass(frozen=True, kw_only=True)
class ClockColumn:
    """A column, by its `name`, and the `steps` between its samples: one, or one for each unit that the column may be in."""

    name: str
    steps: tuple[MeanStep, ...]

    def nearest(self, step: float) -> MeanStep:
        """Return the one of the steps that lies nearest to a sample time [s]."""
        return min(self.steps, key=lambda each: abs(np.log(each.step / step)))


def clock_columns(recording: Recording) -> tuple[ClockColumn, ...]:
    """Return the columns with a row for each sample that are called a time or a time step, as their values confirm."""
    most = max((len(each.values) for each in recording.series), default=0)
    clocks = []
    for each in recording.series:
        steps = _steps(each) if len(each.values) == most else ()
        if steps:
            clocks.append(ClockColumn(name=each.channel.name, steps=steps))
    return tuple(clocks)


def _steps(series: Series) -> tuple[MeanStep, ...]:
    if is_named_step(series) and step_unit(series) is not None:
        mean = float(np.nanmean(series.values))
        symbols = _UNITS if series.channel.unit is None else (series.channel.unit,)
        return tuple(MeanStep(step=mean * unit(each).factor, resolution=0.0) for each in symbols)
    clock = clock_of(series)
    if clock is None:
        return ()
    own = clock_unit(series)
    steps = [mean_step(clock * unit(each).factor) for each in (_UNITS if own is None else (own,))]
    return tuple(each for each in steps if each is not None)


def clock_of(series: Series) -> Array | None:
    """Return the values (N,) of a channel that is called a time, in its own unit; None where it isn't, or they go back."""
    if plain_name(series.channel.name) not in TIME_NAMES:
        return None
    values = series.values[np.isfinite(series.values)]
    steps = np.diff(values)
    return values if len(steps) and np.mean(steps < 0) <= _BACKWARD and (steps > 0).any() else None


def clock_unit(series: Series) -> str | None:
    """Return the unit of a channel that is called a time: its own, that by convention or that of its dates."""
    parsed = heading(series.channel.name)
    return time_unit(replace(parsed, unit=series.channel.unit or parsed.unit)) or epoch_unit(series.values)


def repeats_rows(recording: Recording, name: str) -> bool:
    """Return whether a file has rows twice: wherever the time in a column stays the same, every other column does too."""
    clock = recording[name].values
    same = np.diff(clock) == 0
    others = [
        np.diff(each.values) != 0
        for each in recording.series
        if each.channel.name != name and len(each.values) == len(clock) and np.isfinite(each.values).all()
    ]
    if not others or not same.any():
        return False
    changed = np.any(others, axis=0)
    return not changed[same].any() and int(changed[~same].sum()) >= _FEWEST
