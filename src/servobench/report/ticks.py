"""Ticks as plain SVG. Matplotlib makes five artists of each, copies them one by one, and lays every label out twice."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.channels import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

_MARK_WIDTH = 0.8  # px, as Matplotlib's
_ASCENT = 0.76  # how far digits reach above their line, as a part of the font's size
_TOLERANCE = 1e-10  # of an axis, as Matplotlib's: a tick on its end is seen in spite of rounding


def take_ticks(figure: Figure) -> str:
    """Return the rules, marks and labels of all major ticks of a complete figure as SVG, and hide Matplotlib's own.

    They look as `tick_params` and `grid` ask, and belong behind what else is drawn. One unit is a dot of the figure.
    """
    markup = []
    for ax in figure.axes:
        ax.apply_aspect()  # it may change the limits
        for axis in (ax.xaxis, ax.yaxis):
            if axis.get_visible():
                markup.append(_ticks(ax, axis, float(figure.bbox.height)))
                axis.set_visible(False)
    return "".join(markup)


def _ticks(ax: Axes, axis: Axis, height: float) -> str:
    """The ticks of an axis; `height` is the figure's, as SVG counts from the top."""
    look = axis.get_tick_params()
    values, labels = _ticks_in_view(axis)
    at = ax.transData.transform(np.column_stack([values, values]))
    left, right, bottom, top = ax.bbox.x0, ax.bbox.x1, height - ax.bbox.y0, height - ax.bbox.y1
    away = look["length"] + look["pad"]
    if axis is ax.xaxis:
        x = at[:, 0]
        rules = [f"M {each} {bottom} V {top}" for each in x]
        marks = [f"M {each} {bottom} v {look['length']}" for each in x]
        places = [(each, bottom + away + _ASCENT * look["labelsize"]) for each in x]
        anchor, labelled = "middle", look["labelbottom"]
    else:
        y = height - at[:, 1]
        rules = [f"M {left} {each} H {right}" for each in y]
        marks = [f"M {left} {each} h {-look['length']}" for each in y]
        places = [(left - away, each + _ASCENT * look["labelsize"] / 2) for each in y]
        anchor, labelled = "end", look["labelleft"]
    return (
        (_strokes(rules, look["grid_color"], look["grid_linewidth"]) if look["gridOn"] else "")
        + (_strokes(marks, look["color"], _MARK_WIDTH) if look["length"] else "")
        + (_texts(places, labels, anchor, look["labelcolor"], look["labelsize"]) if labelled else "")
    )


def _ticks_in_view(axis: Axis) -> tuple[Array, list[str]]:
    """The values (N,) of the ticks between the ends of an axis, and their labels."""
    values = np.asarray(axis.get_majorticklocs(), dtype=np.float64)
    labels = axis.get_major_formatter().format_ticks(values.tolist())
    scaled = axis.get_transform().transform(values)
    low, high = np.sort(axis.get_transform().transform(axis.get_view_interval()))
    room = _TOLERANCE * (high - low)
    inside = (scaled >= low - room) & (scaled <= high + room)
    return values[inside], [label for label, is_inside in zip(labels, inside, strict=True) if is_inside]


def _strokes(lines: Sequence[str], colour: str, width: float) -> str:
    return f'<path d="{" ".join(lines)}" style="fill: none; stroke: {colour}; stroke-width: {width:g}"/>'


def _texts(
    places: Sequence[tuple[float, float]], texts: Sequence[str], anchor: str, colour: str, size: float
) -> str:
    """Texts of a size [px], at the places that they are anchored to."""
    each = (
        f'<text x="{x}" y="{y}">{escape(text)}</text>' for (x, y), text in zip(places, texts, strict=True)
    )
    return f'<g style="font-size: {size:g}px; text-anchor: {anchor}; fill: {colour}">{"".join(each)}</g>'
