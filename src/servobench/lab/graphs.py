"""The figures of studies: graphs over a frequency, a voltage, a sample time, and courses over time as a report draws them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from servobench.core.channels import Array
from servobench.core.palette import Palette
from servobench.report import figures
from servobench.report.figures import Course, Curve, Look, Panel
from servobench.report.illustrations import Illustration
from servobench.report.palette import (
    BOTTOM,
    LEFT,
    RIGHT,
    TITLE,
    Box,
    Style,
    axes,
    legend,
    sheet,
    x_label,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Mark: TypeAlias = Literal["points", "wide", "strong", "thin", "dashed", "dotted", "reference"]
"""Measured points; lines told apart by stroke as well as by shade; and a dashed one in ink, to compare with."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Line:
    """A line through x (N,), y (N,), with its mark; `label` is its name in the legend, empty for a line without one."""

    x: Array
    y: Array
    mark: Mark
    label: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Graph:
    """Lines over a common quantity `over`; the title says what is drawn, units included. `log` are the logarithmic axes.

    `ends` are the ends of the vertical axis, which finds its own without; `height` is that of the axes [px].
    """

    title: str
    over: str
    lines: tuple[Line, ...]
    log: Literal["", "x", "xy"] = ""
    height: float = 170.0
    ends: tuple[float, float] | None = None


def figure_of(name: str, title: str, caption: str, description: str, graphs: Sequence[Graph]) -> Illustration:
    """Return a figure of graphs above each other; `description` says in words what is seen."""
    return Illustration(
        name=name,
        title=title,
        caption=caption,
        description=description,
        draw=partial(_figure, tuple(graphs)),
    )


def _figure(graphs: Sequence[Graph], style: Style) -> Figure:
    total = sum(graph.height + TITLE + BOTTOM for graph in graphs) + 4
    figure = sheet(style, total)
    top = 4.0
    for graph in graphs:
        box = Box(
            left=LEFT, top=top + TITLE, width=style.width - LEFT - RIGHT, height=graph.height, indent=LEFT
        )
        ax = axes(figure, box, style.palette, graph.title)
        for line in graph.lines:
            _draw(ax, line, style.palette)
        _scales(ax, graph)
        x_label(ax, graph.over, style.palette)
        legend(ax, style.palette, box)
        top += TITLE + graph.height + BOTTOM
    return figure


def over_time(
    name: str, title: str, caption: str, description: str, courses: Sequence[Course]
) -> Illustration:
    """Return a figure of one course or several side by side; `description` says in words what is seen."""
    return Illustration(
        name=name,
        title=title,
        caption=caption,
        description=description,
        draw=partial(figures.time_courses, tuple(courses)),
    )


def curve(t: Array, y: Array, look: Look, label: str = "") -> Curve:
    """Return a curve through y (N,) at t (N,) [s], with its name in the legend."""
    return Curve(t=t, y=y, look=look, label=label)


def panel(title: str, unit: str, *curves: Curve, height: float = 130.0) -> Panel:
    """Return curves of one quantity over time, with its unit; the height is in pixels."""
    return Panel(title=title, unit=unit, curves=curves, height=height)


def _draw(ax: Axes, line: Line, palette: Palette) -> None:
    label = line.label or "_"
    if line.mark == "points":
        ax.plot(line.x, line.y, "o", markersize=5, color=palette.measured, label=label, zorder=3)
        return
    strokes: dict[Mark, tuple[str, float, Any]] = {
        "wide": (palette.measured, 2.8, "-"),
        "strong": (palette.model, 1.7, "-"),
        "thin": (palette.ink, 1.2, "-"),
        "dashed": (palette.model, 1.4, "--"),
        "dotted": (palette.ink, 1.4, ":"),
        "reference": (palette.ink, 1.0, (0, (4, 3))),
    }
    colour, width, dashes = strokes[line.mark]
    ax.plot(line.x, line.y, label=label, color=colour, linewidth=width, linestyle=dashes)


def _scales(ax: Axes, graph: Graph) -> None:
    """Logarithmic axes with ticks at 1, 2 and 5 of each decade, and room around the lines."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    from servobench.core.rounding import plain

    ax.margins(x=0.04, y=0.12)
    for which in graph.log:
        axis = ax.xaxis if which == "x" else ax.yaxis
        ax.set(**{f"{which}scale": "log"})
        values = np.concatenate([getattr(line, which) for line in graph.lines])
        wide = values.max() > 100 * values.min()
        axis.set_major_locator(LogLocator(base=10.0, subs=(1.0,) if wide else (1.0, 2.0, 5.0), numticks=12))
        axis.set_minor_locator(NullLocator())
        axis.set_major_formatter(FuncFormatter(lambda value, _: plain(value)))
    if graph.ends:
        ax.set_ylim(*graph.ends)
