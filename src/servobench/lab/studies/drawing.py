"""Lines over any axis, as a study draws them: in the page's colours, told apart by stroke as well as by shade."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from servobench.channels import Array
from servobench.report.palette import Palette, Style, axes, legend, plain_ticks, sheet, whole, x_label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Stroke: TypeAlias = Literal["strong", "plain", "dashed", "dotted", "wide"]
_HEIGHT = 230.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Line:
    """A line through y (N,) over x (N,); `label` is what the legend calls it."""

    x: Array
    y: Array
    label: str
    stroke: Stroke = "plain"


@dataclass(frozen=True, kw_only=True)
class Axis:
    """What an axis shows, with its unit; whether it is logarithmic, and where it ends, by itself where that is None."""

    title: str
    logarithmic: bool = False
    ends: tuple[float, float] | None = None


def lines(drawn: Sequence[Line], across: Axis, up: Axis, style: Style) -> Figure:
    """Return the lines over a common axis."""
    figure = sheet(style, _HEIGHT)
    box = whole(style, _HEIGHT)
    ax = axes(figure, box, style.palette, up.title)
    for line in drawn:
        colour, width, dashes = _stroke(line.stroke, style.palette)
        ax.plot(line.x, line.y, label=line.label, color=colour, linewidth=width, linestyle=dashes)
    ax.set(xscale="log" if across.logarithmic else "linear", yscale="log" if up.logarithmic else "linear")
    if across.ends:
        ax.set_xlim(*across.ends)
    if up.ends:
        ax.set_ylim(*up.ends)
    plain_ticks(ax)
    if across.logarithmic or up.logarithmic:
        ax.minorticks_off()
    x_label(ax, across.title, style.palette)
    legend(ax, style.palette, box)
    return figure


def _stroke(stroke: Stroke, palette: Palette) -> tuple[str, float, str]:
    strokes: dict[Stroke, tuple[str, float, str]] = {
        "strong": (palette.model, 1.8, "-"),
        "plain": (palette.ink, 1.2, "-"),
        "dashed": (palette.model, 1.4, "--"),
        "dotted": (palette.ink, 1.4, ":"),
        "wide": (palette.measured, 2.8, "-"),
    }
    return strokes[stroke]
