"""Figures: from values to Matplotlib figures, which a report, an export or a panel can use.

Nothing here knows of recordings and results, and nothing touches Matplotlib's global state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from servobench.channels import Array
from servobench.report.bands import FrequencyBand, PoleBand, StepBand
from servobench.report.decimation import decimated
from servobench.report.numbers import plain, with_unit
from servobench.report.palette import (
    FONT,
    SECOND_SCALE,
    Box,
    Palette,
    Style,
    axes,
    handy,
    legend,
    second_scale,
    sheet,
    x_label,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Look: TypeAlias = Literal["input", "measured", "model", "residual"]

_LEFT, _RIGHT, _TITLE, _BOTTOM = 42.0, 6.0, 30.0, 40.0  # margins [px]
_GUTTER = 28.0
_DB = 20 / np.log(10)  # dB for one neper


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """A line through y (N,) at t (N,) [s]; `label` is what the legend calls it, nothing for a line without a name."""

    t: Array
    y: Array
    look: Look
    label: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """Curves of one quantity: what it is, its unit, the height in pixels.

    `quantum` adds a scale in counts on the right, and shades half a count on either side of zero.
    """

    title: str
    unit: str
    curves: tuple[Curve, ...]
    height: float = 150.0
    quantum: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Course:
    """What happened in one record: panels above each other, which share their time."""

    panels: tuple[Panel, ...]
    title: str = ""

    @property
    def height(self) -> float:
        """The height with all titles and the time axis [px]."""
        return (
            sum(panel.height + _TITLE for panel in self.panels)
            + _BOTTOM
            + (_TITLE + 14.0 if self.title else 4.0)
        )


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A value held against another one: the difference in per cent, and half of its 95 % interval."""

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
    ax = axes(figure, _whole(style, 210), palette, "Autocorrelation")
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
    box = _whole(style, 210)
    ax = axes(figure, box, palette, "Distribution")
    ax.stairs(density, edges, fill=True, color=palette.measured, linewidth=0, label="residual")
    if expected is not None:
        ax.plot(expected.t, expected.y, color=palette.model, linewidth=1.5, label=expected.label)
    legend(ax, palette, box)
    ax.set(ylim=(0, None), xlim=(edges[0], edges[-1]))
    ax.set_yticks([])
    x_label(ax, f"residual ({unit})", palette)
    return figure


def bode(
    band: FrequencyBand, unit: str, seen: tuple[float, float], corner: float | None, style: Style
) -> Figure:
    """Return magnitude and phase with their 95 % bands.

    `unit` is the magnitude's; `seen` [rad/s] is the range of frequencies that the data can tell of, what lies outside is shaded;
    `corner` [rad/s] is marked.
    """
    palette = style.palette
    height = 2 * (150 + _TITLE) + _BOTTOM + 4
    figure = sheet(style, height)
    width = style.width - _LEFT - SECOND_SCALE
    tops = (4 + _TITLE, 4 + 2 * _TITLE + 150)
    boxes = [Box(left=_LEFT, top=top, width=width, height=150, indent=_LEFT) for top in tops]
    db, degrees = 20 * np.log10(band.magnitude), np.degrees(band.phase)
    magnitude = axes(figure, boxes[0], palette, "Magnitude (dB)")
    phase = axes(figure, boxes[1], palette, "Phase (°)")
    for ax, y, half in (
        (magnitude, db, _DB * band.magnitude_half),
        (phase, degrees, np.degrees(band.phase_half)),
    ):
        _frequencies(ax, band.omega, seen, corner, palette)
        ax.fill_between(band.omega, y - half, y + half, color=palette.band, linewidth=0)
        ax.plot(band.omega, y, color=palette.model, linewidth=1.8)
    magnitude.tick_params(axis="x", labelbottom=False)
    _decibels(magnitude, db, unit, palette)
    _degree_ticks(phase, degrees, np.degrees(band.phase_half))
    if corner is not None:
        _note(magnitude, corner, f" 1/τ = {plain(corner, 3)} rad/s", palette)
    x_label(phase, "angular frequency (rad/s)", palette)
    return figure


def step(band: StepBand, unit: str, mark: tuple[float, float] | None, style: Style) -> Figure:
    """Return a step response with its 95 % band; `mark` (t [s], y) is where 63.2 % are reached."""
    palette = style.palette
    figure = sheet(style, 250)
    ax = axes(figure, _whole(style, 250), palette, f"Step response ({unit})")
    ax.fill_between(band.t, band.y - band.half, band.y + band.half, color=palette.band, linewidth=0)
    ax.plot(band.t, band.y, color=palette.model, linewidth=1.8)
    if mark is not None:
        t, y = mark
        ax.plot(
            [t, t, 0],
            [min(0.0, float(band.y.min())), y, y],
            color=palette.muted,
            linewidth=1,
            linestyle=(0, (2, 3)),
        )
        ax.plot([t], [y], marker="o", markersize=6, color=palette.model, linestyle="none")
        below = -14 if band.y[-1] >= 0 else 14
        ax.annotate(
            f"63.2 % after {with_unit(t, 's', 3)}",
            (t, y),
            xytext=(9, below),
            textcoords="offset points",
            fontsize=FONT,
            color=palette.muted,
        )
    ax.set_xlim(band.t[0], band.t[-1])
    x_label(ax, "time (s)", palette)
    return figure


def pole_map(poles: Sequence[PoleBand], integrator: complex | None, style: Style) -> Figure:
    """Return the poles in the complex plane, with their 95 % intervals; `integrator` is drawn hollow, as it isn't estimated."""
    palette = style.palette
    figure = sheet(style, 250)
    box = _whole(style, 250)
    ax = axes(figure, box, palette, "Poles (1/s)")
    left, right = _real_span([band.pole.real for band in poles])
    up = max([abs(band.pole.imag) + band.half.imag for band in poles if np.isfinite(band.half.imag)] + [0.0])
    up = 1.3 * up if up > 0 else 1.0
    ax.axvspan(0, right, color=palette.shade, linewidth=0)
    ax.axvline(0, color=palette.muted, linewidth=1)
    ax.axhline(0, color=palette.muted, linewidth=1)
    for band in poles:
        x, y = band.pole.real, band.pole.imag
        ax.plot(
            [x - band.half.real, x + band.half.real],
            [y, y],
            color=palette.band,
            linewidth=8,
            solid_capstyle="butt",
        )
        ax.plot([x], [y], marker="x", markersize=9, markeredgewidth=2, color=palette.model, linestyle="none")
        ax.annotate(_complex_text(band.pole), (x, y), xytext=(0, 12), textcoords="offset points", ha="center", fontsize=FONT,
                    color=palette.muted)  # fmt: skip
    if integrator is not None:
        ax.plot([integrator.real], [integrator.imag], marker="o", markersize=8, markerfacecolor="none", markeredgewidth=1.5,
                markeredgecolor=palette.model, linestyle="none")  # fmt: skip
    ax.text(right, 0.94 * up, "unstable ", fontsize=FONT, color=palette.muted, ha="right", va="top")
    ax.set(xlim=(left, right), ylim=(-up, up))
    if all(band.pole.imag == 0 for band in poles):
        ax.set_yticks([0])
    x_label(ax, "real part (1/s)", palette)
    return figure


def differences(rows: Sequence[Difference], reference: str, style: Style) -> Figure:
    """Return how far values are from those of a reference, a row each: a dot with its 95 % interval, in per cent."""
    palette = style.palette
    height = 34.0 * len(rows) + _TITLE + _BOTTOM + 4
    figure = sheet(style, height)
    left = 116.0
    box = Box(
        left=left, top=4 + _TITLE, width=style.width - left - _RIGHT, height=34.0 * len(rows), indent=left
    )
    ax = axes(figure, box, palette, "Identified, as a difference from nominal (%)")
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


def _whole(style: Style, height: float) -> Box:
    """The box of the only axes of a figure."""
    inner = style.width - _LEFT - _RIGHT
    return Box(left=_LEFT, top=4 + _TITLE, width=inner, height=height - _TITLE - _BOTTOM - 4, indent=_LEFT)


def _course(figure: Figure, course: Course, left: float, top: float, width: float, palette: Palette) -> None:
    second = any(panel.quantum for panel in course.panels)
    inner = width - _LEFT - (SECOND_SCALE if second else _RIGHT)
    y = top + 4.0
    if course.title:
        total = figure.get_size_inches() * 72
        figure.text(
            left / total[0],
            1 - (y + 14) / total[1],
            course.title,
            fontsize=FONT + 1,
            fontweight="bold",
            color=palette.ink,
            parse_math=False,
        )
        y += _TITLE - 4
    ends = _time_span(course)
    for n, panel in enumerate(course.panels):
        y += _TITLE
        box = Box(left=left + _LEFT, top=y, width=inner, height=panel.height, indent=_LEFT)
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
        t, y = decimated(curve.t, curve.y / factor, int(box.width))
        ax.plot(t, y, label=curve.label or "_", **_line(curve.look, palette))
    legend(ax, palette, box)
    ax.margins(y=0.08)
    low, high = min(float(c.y.min()) for c in panel.curves), max(float(c.y.max()) for c in panel.curves)
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
    """How a line is drawn. The model's is thin and lies on the measured one, which is wide, so that both are seen."""
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


def _frequencies(
    ax: Axes, omega: Array, seen: tuple[float, float], corner: float | None, palette: Palette
) -> None:
    """A logarithmic axis of frequencies, with what the data can't tell shaded."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    ax.set_xscale("log")
    ax.set_xlim(omega[0], omega[-1])
    ax.xaxis.set_major_locator(LogLocator(base=10.0, numticks=12))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: plain(value)))
    ax.grid(True, axis="x", color=palette.rule, linewidth=1.0)
    for low, high in ((omega[0], seen[0]), (seen[1], omega[-1])):
        if low < high:
            ax.axvspan(low, high, color=palette.shade, linewidth=0)
    if corner is not None:
        ax.axvline(corner, color=palette.muted, linewidth=1, linestyle=(0, (2, 3)))


def _decibels(ax: Axes, db: Array, unit: str, palette: Palette) -> None:
    """Ticks at tens of dB, and what the magnitude is in its unit on the right, at round numbers."""
    from matplotlib.ticker import MultipleLocator

    low, high = float(db.min()) - 3, float(db.max()) + 3
    ax.set_ylim(low, high)
    ax.yaxis.set_major_locator(
        MultipleLocator(next((step for step in (10.0, 20.0, 40.0) if high - low < 6 * step), 80.0))
    )
    decades = range(int(np.floor(low / 20)) - 1, int(np.ceil(high / 20)) + 1)
    firsts = (1.0, 2.0, 5.0) if high - low < 50 else (1.0,)
    values = [first * 10.0**decade for decade in decades for first in firsts]
    inside = [value for value in values if low <= 20 * np.log10(value) <= high]
    second_scale(
        ax, [20 * np.log10(value) for value in inside], [plain(value) for value in inside], unit, palette
    )


def _degree_ticks(ax: Axes, degrees: Array, half: Array) -> None:
    """Ticks at fractions of a turn; what a long delay does beyond one and a quarter turns isn't worth its height."""
    from matplotlib.ticker import MultipleLocator

    known = np.where(np.isfinite(half), half, 0.0)
    low, high = max(float((degrees - known).min()), -450.0), min(float((degrees + known).max()), 450.0)
    low, high = min(low, high - 90.0) - 6, high + 6
    ax.set_ylim(low, high)
    ax.yaxis.set_major_locator(MultipleLocator(45 if high - low < 230 else 90))


def _note(ax: Axes, x: float, text: str, palette: Palette) -> None:
    """A note beside a vertical line, near its foot."""
    ax.annotate(text, (x, 0.06), xycoords=("data", "axes fraction"), fontsize=FONT, color=palette.muted, va="bottom",
                ha="left")  # fmt: skip


def _real_span(parts: Sequence[float]) -> tuple[float, float]:
    """What of the real axis to show: all poles and zero, with room on both sides."""
    low, high = min([*parts, 0.0]), max([*parts, 0.0])
    size = max(high - low, 1e-12)
    return low - 0.35 * size, high + 0.3 * size


def _complex_text(pole: complex) -> str:
    real = plain(pole.real)
    return real if pole.imag == 0 else f"{real} {'+' if pole.imag > 0 else '−'} {plain(abs(pole.imag))}j"
