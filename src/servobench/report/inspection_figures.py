"""The figures of an inspection: what was recorded over time, and how the samples are spaced."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.channels import measurable
from servobench.core.rounding import count_text, handy_unit, plain, with_unit
from servobench.recordings.formats.inspection import Intervals
from servobench.recordings.recording import Recording, Series
from servobench.report import figures
from servobench.report.decimation import hold_line
from servobench.report.figures import Course, Curve, Panel
from servobench.report.illustrations import Illustration
from servobench.report.palette import Style, axes, sheet, whole, x_label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEIGHT = 190.0


def over_time(recording: Recording, names: tuple[str, ...], number: int) -> Illustration | None:
    """Return some channels over time, below each other; None where there is nothing to be drawn."""
    panels = tuple(panel for name in names if (panel := _panel(recording, recording[name])) is not None)
    if not panels:
        return None
    timed = any(recording[name].t is not None for name in names)
    unit = "" if timed else " The file has no times: one second is one sample."
    return Illustration(
        name=f"course-{number}",
        title="What was recorded",
        caption=f"Time is counted from the first sample.{unit}",
        description=" ".join(_words(recording[name]) for name in names),
        draw=partial(figures.time_courses, (Course(panels=panels),)),
    )


def spacing(intervals: Intervals, number: int) -> Illustration:
    """Return how the intervals between samples are spread."""
    low, high = (with_unit(float(edge), "s", 3) for edge in (intervals.edges[0], intervals.edges[-1]))
    beyond = ""
    if intervals.beyond:
        verb = "is" if intervals.beyond == 1 else "are"
        beyond = f" {count_text(intervals.beyond, 'gap')} beyond {high} {verb} not shown."
    return Illustration(
        name=f"intervals-{number}",
        title="Intervals between samples",
        caption=f"Their median is {with_unit(intervals.median, 's', 4)}.{beyond}",
        description=f"The intervals lie between {low} and {high}, most of them near {with_unit(intervals.median, 's', 3)}.",
        draw=partial(_histogram, intervals),
    )


def _panel(recording: Recording, series: Series) -> Panel | None:
    channel = series.channel
    t = np.arange(len(series.values), dtype=np.float64) if series.t is None else series.t
    t, y = measurable(t), measurable(series.values)
    usable = np.isfinite(t) & np.isfinite(y)
    t, y = t[usable], y[usable]
    forward = np.maximum.accumulate(t) if len(t) else t  # a time that goes back is drawn where it was before
    if len(t) < 2 or not forward[-1] > forward[0]:
        return None
    t = forward - forward[0]
    is_input = channel.name == recording.input
    if is_input:
        t, y = hold_line(t, y, float(y[0]), float(t[-1]))
    curve = Curve(t=t, y=y, look="input" if is_input else "measured")
    return Panel(title=channel.name, unit=channel.unit or "unit unknown", curves=(curve,), height=120.0)


def _words(series: Series) -> str:
    finite = series.values[np.isfinite(series.values)]
    if not len(finite):
        return f"{series.channel.name} has no finite value."
    unit = series.channel.unit or ""
    low, high = (f"{plain(float(end), 3)} {unit}".strip() for end in (finite.min(), finite.max()))
    return f"{series.channel.name} lies between {low} and {high}."


def _histogram(intervals: Intervals, style: Style) -> Figure:
    from matplotlib.ticker import NullLocator

    factor, unit = handy_unit("s", float(intervals.edges[-1]))
    figure = sheet(style, _HEIGHT)
    ax = axes(figure, whole(style, _HEIGHT), style.palette, "Number of intervals (logarithmic)")
    ax.stairs(
        intervals.counts,
        intervals.edges / factor,
        fill=True,
        color=style.palette.measured,
        linewidth=0,
        baseline=0.5,
    )
    ax.axvline(intervals.median / factor, color=style.palette.model, linewidth=1.5)
    ax.set_yscale("log")
    ax.set(
        ylim=(0.5, 2.0 * max(float(intervals.counts.max()), 1.0)),
        xlim=tuple(intervals.edges[[0, -1]] / factor),
    )
    ax.yaxis.set_minor_locator(NullLocator())
    x_label(ax, f"interval ({unit})", style.palette)
    return figure
