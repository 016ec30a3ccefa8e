"""Figures: from values to Matplotlib figures, which a report, an export or a panel can use.

Nothing here depends on recordings or results, or changes Matplotlib's global state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from servobench.core.channels import Array
from servobench.core.palette import Palette
from servobench.core.rounding import plain
from servobench.report.decimation import decimate
from servobench.report.palette import (
    BOTTOM,
    LEFT,
    RIGHT,
    SECOND_SCALE,
    TITLE,
    Box,
    Style,
    axes,
    handy,
    heading,
    legend,
    plain_ticks,
    second_scale,
    sheet,
    whole,
    x_label,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Look: TypeAlias = Literal["input", "measured", "model", "residual"]

SOONEST = 1e-7  # s: what is earlier is as good as on time, and a logarithm needs an end
_GUTTER = 28.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A line through y (N,) at t (N,) [s], with the look of what it is; the legend calls it by its `label`, if any."""

    t: Array
    y: Array
    look: Look
    label: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """Curves of one quantity: the title says what it is; its unit, the height in pixels.

    `quantum` adds a scale in counts on the right, and shades half a count on either side of zero.
    """

    title: str
    unit: str
    curves: tuple[Curve, ...]
    height: float = 150.0
    quantum: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """The data of one record: panels above each other with a common time axis, under a title."""

    panels: tuple[Panel, ...]
    title: str = ""

    @property
    def height(self) -> float:
        """The height with all titles and the time axis [px]."""
        return (
            sum(panel.height + TITLE for panel in self.panels)
            + BOTTOM
            + (TITLE + 14.0 if self.title else 4.0)
        )


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A value, by its name, compared with another one: the difference in percent, and half of its 95 % interval."""

    name: str
    percent: float
    half: float


def time_courses(courses: Sequence[Course], style: Style) -> Figure:
    """Return the courses beside or below each other; lines are thinned to what their pixels can show."""
    across = 1 if style.narrow or len(courses) == 1 else 2
    rows = [courses[n : n + across] for n in range(0, len(courses), across)]
    heights = [max(course.height for course in row) for row in rows]
    figure = sheet(style, sum(heights))
    width = (style.width - (across - 1) * _GUTTER) / across
    top = 0.0
    for row, height in zip(rows, heights, strict=True):
        for n, course in enumerate(row):
            _course(figure, course, n * (width + _GUTTER), top, width, style.palette)
        top += height
    return figure


def correlation(lags: Array, values: Array, bound: float, style: Style) -> Figure:
    """Return the autocorrelation (L,) of a residual at `lags` [samples], with the bound of 95 % for white noise."""
    palette = style.palette
    figure = sheet(style, 210)
    ax = axes(figure, whole(style, 210), palette, "Autocorrelation")
    ax.axhspan(-bound, bound, color=palette.shade, linewidth=0)
    ax.axhline(0, color=palette.muted, linewidth=1)
    ax.vlines(lags, 0, values, colors=palette.model, linewidth=2)
    largest = max(float(np.abs(values).max()), bound, 0.1)
    ax.set(
        xlim=(lags[0] - 0.5, lags[-1] + 0.5),
        ylim=(min(float(values.min()), -bound) - 0.1 * largest, 1.2 * largest),
    )
    x_label(ax, "lag (samples)", palette)
    return figure


def distribution(edges: Array, density: Array, expected: Curve | None, unit: str, style: Style) -> Figure:
    """Return a histogram, `density` (B,) between `edges` (B + 1,), beside an expected density over the same axis (its `t`)."""
    palette = style.palette
    figure = sheet(style, 210)
    box = whole(style, 210)
    ax = axes(figure, box, palette, "Distribution")
    ax.stairs(density, edges, fill=True, color=palette.measured, linewidth=0, label="residual")
    if expected is not None:
        ax.plot(expected.t, expected.y, color=palette.model, linewidth=1.5, label=expected.label)
    legend(ax, palette, box)
    ax.set(ylim=(0, None), xlim=(edges[0], edges[-1]))
    ax.set_yticks([])
    x_label(ax, f"residual ({unit})", palette)
    return figure


def later_than(runs: Sequence[Array], style: Style) -> Figure:
    """Return which share of the samples was later than a time, for each run's lateness (N,) [s], on logarithmic scales."""
    palette = style.palette
    figure = sheet(style, 210)
    ax = axes(figure, whole(style, 210), palette, "Later than that (%)")
    most = max(float(by.max()) for by in runs)
    fewest = max(len(by) for by in runs)
    # The ends before the lines: they aren't sought in lines that may be upright.
    ax.set(xscale="log", yscale="log")
    ax.set(xlim=(1e6 * SOONEST, 1e6 * max(2 * most, 100 * SOONEST)), ylim=(50 / fewest, 150))
    for by in runs:
        late = np.maximum(np.sort(by), SOONEST)
        share = 100.0 * np.arange(len(late), 0, -1) / len(late)  # at a sample: it and those after it
        # Evenly in the logarithm of the share, so that a long run needs no more points than a short one.
        at = np.unique(len(late) - np.geomspace(1, len(late), 400).round().astype(int))
        ax.step(1e6 * late[at], share[at], where="pre", color=palette.model, linewidth=1.5)
    plain_ticks(ax)
    ax.minorticks_off()
    x_label(ax, "lateness (µs)", palette)
    return figure


def differences(
    rows: Sequence[Difference],
    reference: str,
    style: Style,
    title: str = "Identified, as a difference from nominal (%)",
    left: float = 116.0,
) -> Figure:
    """Return how far values are from those of a reference, a row each: a dot with its 95 % interval, in per cent.

    `left` is the room for the rows' names [px].
    """
    palette = style.palette
    height = 34.0 * len(rows) + TITLE + BOTTOM + 4
    figure = sheet(style, height)
    box = Box(
        left=left, top=4 + TITLE, width=style.width - left - RIGHT, height=34.0 * len(rows), indent=left
    )
    ax = axes(figure, box, palette, title)
    ax.grid(False, axis="y")
    ax.grid(True, axis="x", color=palette.rule, linewidth=1.0)
    ax.axvline(0, color=palette.muted, linewidth=1.5)
    for n, row in enumerate(rows):
        if np.isfinite(row.half):
            ax.plot(
                [row.percent - row.half, row.percent + row.half],
                [n, n],
                color=palette.band,
                linewidth=8,
                solid_capstyle="butt",
            )
        ax.plot([row.percent], [n], marker="o", markersize=8, color=palette.model, linestyle="none")
    ax.set_yticks(range(len(rows)), [row.name for row in rows])
    ends = [
        0.0,
        *(
            row.percent + side * (row.half if np.isfinite(row.half) else 0)
            for row in rows
            for side in (-1, 1)
        ),
    ]
    room = 0.08 * (max(ends) - min(ends) or 1.0)
    ax.set(ylim=(len(rows) - 0.5, -0.5), xlim=(min(ends) - room, max(ends) + room))
    x_label(ax, f"0 is {reference}", palette)
    return figure


def _course(figure: Figure, course: Course, left: float, top: float, width: float, palette: Palette) -> None:
    second = any(panel.quantum for panel in course.panels)
    inner = width - LEFT - (SECOND_SCALE if second else RIGHT)
    y = top + 4.0
    if course.title:
        heading(figure, left, y, course.title, palette)
        y += TITLE - 4
    ends = _time_span(course)
    for n, panel in enumerate(course.panels):
        y += TITLE
        box = Box(left=left + LEFT, top=y, width=inner, height=panel.height, indent=LEFT)
        ax = _panel(figure, panel, box, palette)
        ax.set_xlim(*ends)
        if n < len(course.panels) - 1:
            ax.tick_params(axis="x", labelbottom=False)
        else:
            x_label(ax, "time (s)", palette)
        y += panel.height


def _panel(figure: Figure, panel: Panel, box: Box, palette: Palette) -> Axes:
    factor, unit = handy([curve.y for curve in panel.curves], panel.unit)
    ax = axes(figure, box, palette, f"{panel.title} ({unit})")
    for curve in panel.curves:
        t, y = decimate(curve.t, curve.y / factor, int(box.width))
        ax.plot(t, y, label=curve.label or "_", **_line(curve.look, palette))
    legend(ax, palette, box)
    ax.margins(y=0.08)
    values = np.concatenate([curve.y for curve in panel.curves])
    low, high = (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)
    if low == high != 0:
        ax.set_ylim(*sorted((0.0, 1.25 * low / factor)))  # what never changes is seen beside zero
    if panel.quantum:
        _counts(ax, panel.quantum / factor, palette)
    return ax


def _counts(ax: Axes, quantum: float, palette: Palette) -> None:
    """A second scale in counts, with half a count on either side of zero shaded."""
    from matplotlib.ticker import MaxNLocator

    ax.axhspan(-0.5 * quantum, 0.5 * quantum, color=palette.shade, linewidth=0)
    low, high = (end / quantum for end in ax.get_ylim())
    counts = [
        float(count)
        for count in MaxNLocator(nbins=4, steps=[1, 2, 5, 10]).tick_values(low, high)
        if low <= count <= high
    ]
    second_scale(
        ax, [count * quantum for count in counts], [plain(count) for count in counts], "counts", palette
    )


def _line(look: Look, palette: Palette) -> dict[str, Any]:
    """The style of a line. The model's is thin and lies on the measured one, which is wide, so that both are seen."""
    lines: dict[Look, tuple[str, float]] = {
        "input": (palette.ink, 1.3),
        "measured": (palette.measured, 2.6),
        "model": (palette.model, 1.3),
        "residual": (palette.measured, 0.8),
    }
    colour, width = lines[look]
    return {"color": colour, "linewidth": width, "solid_joinstyle": "round", "solid_capstyle": "butt"}


def _time_span(course: Course) -> tuple[float, float]:
    times = [curve.t for panel in course.panels for curve in panel.curves if len(curve.t)]
    start, end = min(float(t[0]) for t in times), max(float(t[-1]) for t in times)
    return (start, end) if end > start else (start - 0.5, start + 0.5)
