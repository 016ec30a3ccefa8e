"""The question about the times of a recording that has none, with the answer that its columns suggest."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.units import unit
from servobench.recordings.formats.choice import long_columns
from servobench.recordings.formats.clock_columns import clock_of, clock_unit, repeats_rows
from servobench.recordings.formats.columns import TIME_NAMES, heading, quote
from servobench.recordings.formats.roles import ColumnSpec, plain_name, shell_text
from servobench.recordings.formats.time_steps import about_steps, is_named_step, step_unit
from servobench.recordings.formats.times import mean_step
from servobench.recordings.recording import Recording, Series

_FEW = 3  # columns; of more the sentence would be a list
_GROWING = 0.95  # of the steps
_COARSE = 0.05  # of a mean step: what is less certain is no suggestion


def question(recording: Recording) -> str:
    """Return the sentence that asks for the times: for the unit of what may be the time, for a sample time, or for a column."""
    named = [each for each in recording.series if plain_name(each.channel.name) in TIME_NAMES]
    unnamed = [each for each in recording.series if each.channel.unit is None]
    return (
        _about_candidates(named, "by its name" if len(named) == 1 else "by their names")
        or _about_clocks(recording, named)
        or _about_steps(recording)
        or _about_candidates(unnamed, "as it grows from row to row")
        or _open_question(recording)
    )


def _about_candidates(candidates: list[Series], why: str) -> str:
    """The sentence on columns that grow as times do; empty where there is none, or too many."""
    growing = [each for each in candidates if _runs(each.values)]
    if not 0 < len(growing) <= _FEW:
        return ""
    names = [each.channel.name for each in growing]
    known = [clock_unit(each) for each in growing]
    options = [
        f"`time={shell_text(str(ColumnSpec(column=name, unit=symbol or 's')))}`"
        for name, symbol in zip(names, known, strict=True)
    ]
    named = all(each.channel.unit or heading(each.channel.name).unit for each in growing)
    others = "" if named else ", or what the unit is" if "ms" in known else ", or :ms, or what the unit is"
    return f"the times: {quote(names)} may be the time {why}: say {' or '.join(options)}{others}; otherwise `sample_time=SECONDS`"


def _about_clocks(recording: Recording, named: list[Series]) -> str:
    """The sentence on a time that stays the same from one row to the next; empty where there is none with a known unit."""
    for each in named:
        name, values, symbol = each.channel.name, clock_of(each), clock_unit(each)
        step = None if values is None or symbol is None else mean_step(values * unit(symbol).factor)
        if values is None or step is None or not (np.diff(values) == 0).any():
            continue
        if repeats_rows(recording, name):
            option = shell_text(f"{name}:{symbol}")
            return f"the times: rows with the same `{name}` are repeated: say `time={option}`, and the repeats are left out"
        low, high = step.step - step.resolution, step.step + step.resolution
        figure = f"{step.figure:.6g}" if step.resolution <= _COARSE * step.step else "SECONDS"
        return (
            f"the times: `{name}` is too coarse for that, but its mean step is {low:.4g} to {high:.4g} s. If the samples are "
            f"evenly spaced, say `sample_time={figure}` (in s), or the exact value"
        )
    return ""


def _about_steps(recording: Recording) -> str:
    """The sentence on a column of time steps; empty where there is none."""
    for each in recording.series:
        symbol = step_unit(each) if is_named_step(each) else None
        if symbol is not None:
            return f"the times: {about_steps(each, symbol)}"
    return ""


def _open_question(recording: Recording) -> str:
    sentence = "the times: say `sample_time=SECONDS` for evenly spaced samples, or `time=COL:UNIT`"
    columns = long_columns(recording)
    if columns and len(recording.series) > 1:
        sentence += f", one of {columns}"
    return sentence


def _runs(values: Array) -> bool:
    """Whether a column can be times: it grows all the way, but for a few slips, and doesn't just count the rows."""
    values = values[np.isfinite(values)]
    if len(values) < 3:
        return False
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.diff(values)
    return bool(np.mean(steps > 0) > _GROWING and not (steps == 1.0).all())
