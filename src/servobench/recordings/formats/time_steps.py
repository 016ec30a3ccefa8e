"""Columns of time steps, which hold the time from one row to the next instead of the time since the beginning."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import SHORTEST_STEP, Array
from servobench.core.units import unit
from servobench.recordings.formats.roles import plain_name, quantity_of
from servobench.recordings.recording import Series

STEP_NAMES = frozenset(
    {"dt", "delta_t", "delta_time", "timestep", "time_step", "time_steps", "sample_time", "sampling_time"}
    | {"sample_period", "sampling_period", "loop_dt", "tsample"}
)
"""The names of a column of time steps, or of one sample time, as `plain_name` gives them."""

_NAMES_WITH_UNIT = frozenset({"delta", "step", "period", "interval", "loop_time", "loop_period", "elapsed"})
_FEWEST = 10  # rows
_SPREAD = 2.0  # times the median, for nine steps of ten
_GROWING = 0.6  # of the rows that change: a column that grows more often may be times
_CHANGING = 0.1  # of the rows, below which a change or two say nothing
_LONGEST = 10.0  # s: nobody samples a motor more slowly
_SLOW = 0.5  # s: a step without a unit that would be longer is in a smaller unit


def is_named_step(series: Series) -> bool:
    """Return whether a channel is called a time step; `period` and the like count with a unit of time alone."""
    name, quantity = plain_name(series.channel.name), quantity_of(series.channel.unit)
    if series.channel.unit is not None and quantity != "time":
        return False
    return name in STEP_NAMES or (name in _NAMES_WITH_UNIT and quantity == "time")


def step_unit(series: Series, symbol: str | None = None) -> str | None:
    """Return the unit in which a channel's values are time steps; None where they can't be any.

    Steps are positive, nearly all alike, and don't grow from row to row. `symbol` is their unit if it is known; without it, and
    without the channel's own, it is the one of s, ms and us that makes them no longer than half a second.
    """
    values = series.values[np.isfinite(series.values)]
    if len(values) < _FEWEST or not _are_alike(values) or _grows(values):
        return None
    median = float(np.median(values))
    symbol = symbol or series.channel.unit
    if symbol is None:
        symbol = next((each for each in ("s", "ms", "us") if median * unit(each).factor <= _SLOW), "us")
    return symbol if SHORTEST_STEP <= median * unit(symbol).factor <= _LONGEST else None


def _grows(values: Array) -> bool:
    """Whether values grow from row to row, as times do, also where each row stands twice."""
    changes = np.diff(values)
    changes = changes[changes != 0]
    return bool(len(changes) > _CHANGING * len(values) and np.mean(changes > 0) > _GROWING)


def _are_alike(values: Array) -> bool:
    low, median, high = np.percentile(values, (5, 50, 95))
    return bool(
        values.min() >= 0 < low
        and np.ptp(values) > 0
        and median <= _SPREAD * low
        and high <= _SPREAD * median
    )


def about_steps(series: Series, symbol: str) -> str:
    """Return the sentences that say that a channel holds time steps in a unit, and what to do."""
    name, steps = series.channel.name, series.values[np.isfinite(series.values)] * unit(symbol).factor
    read = "" if series.channel.unit else f", read in {symbol}"
    return (
        f"`{name}` looks like the time from one row to the next{read}: its mean is {steps.mean():.4g} s and its sum "
        f"{steps.sum():.4g} s. If the steps are nearly even, say `sample_time={steps.mean():.4g}` (in s); otherwise add a column "
        "with the running sum and name it as the time"
    )
