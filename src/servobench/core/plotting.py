"""Axes for plots at the prompt: the user's or new ones, laid out like the figures of a report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.errors import UsageError
from servobench.core.palette import DARK, DARK_GROUND, LIGHT, Palette

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_WIDTH, _HEIGHT = 7.5, 2.4  # inches, of each axes


def ground(dark: bool) -> Palette:
    """Return the colours for a dark ground, or for a light one."""
    return DARK if dark else LIGHT


def new_axes(axes: Axes | Sequence[Axes] | None, count: int, dark: bool) -> tuple[Axes, ...]:
    """Return the axes that were given, or `count` new ones below each other in a figure of their own.

    Raises `UsageError` where others than Matplotlib's axes are given, or not as many as are needed.
    """
    from matplotlib.axes import Axes as MatplotlibAxes

    if axes is None:
        from matplotlib import pyplot

        figure, made = pyplot.subplots(
            count, 1, figsize=(_WIDTH, _HEIGHT * count + 0.4), squeeze=False, layout="constrained"
        )
        if dark:
            figure.patch.set_facecolor(DARK_GROUND)
        return tuple(made[:, 0])
    all_axes = tuple(np.ravel(np.array([axes], dtype=object)))
    if len(all_axes) != count or not all(isinstance(each, MatplotlibAxes) for each in all_axes):
        raise UsageError(
            f"axes is {axes!r}; expected {count} of Matplotlib's axes, or none to have them made"
        )
    return all_axes


def new_figure(count: int) -> tuple[Figure, tuple[Axes, ...]]:
    """Return a figure that no window shows, with `count` axes below each other."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH, _HEIGHT * count + 0.4), layout="constrained")
    return figure, tuple(figure.subplots(count, 1, squeeze=False)[:, 0])


def lay_out(ax: Axes, palette: Palette, x: str, y: str, title: str) -> None:
    """Give axes their labels and the palette's colours: faint horizontal rules, a frame at the bottom only."""
    ax.set_facecolor("none")
    for side in ("left", "right", "top"):
        ax.spines[side].set_visible(False)
    ax.spines["bottom"].set_color(palette.rule)
    ax.grid(True, axis="y", color=palette.rule)
    ax.set_axisbelow(True)
    ax.tick_params(which="both", length=0, labelcolor=palette.muted)
    ax.set_xlabel(x, color=palette.muted)
    ax.set_ylabel(y, color=palette.muted)
    if title:
        ax.set_title(title, loc="left", color=palette.ink, fontsize="medium")
