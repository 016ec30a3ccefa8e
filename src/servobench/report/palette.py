"""The look of figures: colours by meaning, sizes in CSS pixels, and plain axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from servobench.core.channels import Array
from servobench.core.palette import LIGHT, Palette
from servobench.core.rounding import handy_unit, plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FONT = 11.0  # CSS pixels; one unit of the drawing is one pixel
LEFT, RIGHT, TITLE, BOTTOM = 42.0, 6.0, 30.0, 40.0  # what stands around axes: labels and titles
SECOND_SCALE = 44.0  # what a second scale takes on the right
_X_LABEL = 32.4  # from the axes down to the foot of their label, which is below those of the ticks
_POINTS_PER_INCH = 72.0  # of Matplotlib's sizes


@dataclass(frozen=True, kw_only=True)
class Style:
    """The width of a figure in CSS pixels, and its palette. A narrow one stacks what it would else put side by side."""

    width: float = 720.0
    palette: Palette = LIGHT

    @property
    def narrow(self) -> bool:
        """Whether the page is so narrow that its parts go below each other."""
        return self.width < 560


@dataclass(frozen=True, kw_only=True)
class Box:
    """The place of axes: pixels from the left and from the top of the figure, to the axes' frame, and its width and height.

    Their title begins `indent` pixels to the left of the frame, above the labels of the ticks.
    """

    left: float
    top: float
    width: float
    height: float
    indent: float


def sheet(style: Style, height: float) -> Figure:
    """Return an empty, transparent figure of the style's width and a height in pixels; no global state is touched."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(style.width / _POINTS_PER_INCH, height / _POINTS_PER_INCH), dpi=_POINTS_PER_INCH)
    figure.patch.set_visible(False)
    return figure


def whole(style: Style, height: float) -> Box:
    """Return the box of the only axes of a figure."""
    inner = style.width - LEFT - RIGHT
    return Box(left=LEFT, top=4 + TITLE, width=inner, height=height - TITLE - BOTTOM - 4, indent=LEFT)


def axes(figure: Figure, box: Box, palette: Palette, title: str) -> Axes:
    """Return axes in a box of a figure: a title flush left above them, faint horizontal rules, no frame."""
    from matplotlib.ticker import MaxNLocator

    width, height = figure.get_size_inches() * _POINTS_PER_INCH
    frame = (box.left / width, 1 - (box.top + box.height) / height, box.width / width, box.height / height)
    ax = figure.add_axes(frame)
    ax.patch.set_visible(False)
    for side in ("left", "right", "top"):
        ax.spines[side].set_visible(False)
    ax.spines["bottom"].set(color=palette.rule, linewidth=1.0)
    ax.grid(True, axis="y")
    ax.set_axisbelow(True)
    ax.tick_params(
        which="both",
        length=0,
        labelsize=FONT,
        labelcolor=palette.muted,
        pad=5,
        grid_color=palette.rule,
        grid_linewidth=1.0,
    )
    ax.tick_params(axis="x", which="major", length=4, color=palette.rule)
    ax.yaxis.set_major_locator(MaxNLocator(nbins=max(2, min(5, int(box.height // 28)))))
    ax.xaxis.set_major_locator(MaxNLocator(nbins=max(3, min(10, int(box.width // 60)))))
    plain_ticks(ax)
    ax.text(
        -box.indent / box.width,
        1 + 9 / box.height,
        title,
        transform=ax.transAxes,
        fontsize=FONT + 1,
        color=palette.ink,
        parse_math=False,
    )
    return ax


def heading(figure: Figure, left: float, top: float, text: str, palette: Palette) -> None:
    """Write a heading over several axes, so many pixels from the left and from the top of the figure."""
    width, height = figure.get_size_inches() * _POINTS_PER_INCH
    figure.text(
        left / width,
        1 - (top + 14) / height,
        text,
        fontsize=FONT + 1,
        fontweight="bold",
        color=palette.ink,
        parse_math=False,
    )


def plain_ticks(ax: Axes) -> None:
    """Write ticks as plain numbers, without an offset or a power of ten somewhere else."""
    from matplotlib.ticker import FuncFormatter

    for axis in (ax.xaxis, ax.yaxis):
        # Ten digits: enough for a narrow range far from zero, and too few to show a rounding error.
        axis.set_major_formatter(FuncFormatter(lambda value, _: plain(value, 10)))


def x_label(ax: Axes, text: str, palette: Palette) -> None:
    """Write what the horizontal axis is, below its right end."""
    _note(ax, 1, -_X_LABEL / ax.bbox.height, text, palette, ha="right")


def second_scale(
    ax: Axes, ticks: Sequence[float], labels: Sequence[str], unit: str, palette: Palette
) -> None:
    """Write another unit's numbers on the right, at `ticks` of the axes, and the unit above them."""
    beside = {"va": "center_baseline", "transform": ax.get_yaxis_transform()}
    for tick, label in zip(ticks, labels, strict=True):
        _note(ax, 1 + 5 / ax.bbox.width, tick, label, palette, **beside)
    _note(ax, 1 + SECOND_SCALE / ax.bbox.width, 1 + 9 / ax.bbox.height, unit, palette, ha="right")


def _note(ax: Axes, x: float, y: float, text: str, palette: Palette, **style: Any) -> None:
    """Write a text beside axes, at fractions of them where the style has no other `transform`."""
    look: dict[str, Any] = {
        "fontsize": FONT,
        "color": palette.muted,
        "parse_math": False,
        "transform": ax.transAxes,
    }
    ax.text(x, y, text, **(look | style))


def legend(ax: Axes, palette: Palette, box: Box) -> None:
    """Write what the lines are above the right end of the axes, for those that have a label."""
    handles, labels = ax.get_legend_handles_labels()
    if not handles:
        return
    ax.legend(
        handles,
        labels,
        loc="lower right",
        bbox_to_anchor=(1.0, 1 + 3 / box.height),
        ncols=len(handles),
        frameon=False,
        fontsize=FONT,
        labelcolor=palette.muted,
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.4,
        handletextpad=0.5,
        columnspacing=1.2,
    )


def handy(values: Sequence[Array], unit: str) -> tuple[float, str]:
    """Return the factor and the unit in which the values of a panel are drawn."""
    largest = max((float(abs(array).max()) for array in values if len(array)), default=0.0)
    return handy_unit(unit, largest)
