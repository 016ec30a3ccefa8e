"""Figures of a model: frequency response, step response and poles, each with its band."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.channels import Array
from servobench.core.palette import Palette
from servobench.core.rounding import plain, with_unit
from servobench.identification.uncertainty.bands import FrequencyBand, PoleBand, StepBand
from servobench.report.palette import (
    BOTTOM,
    FONT,
    LEFT,
    SECOND_SCALE,
    TITLE,
    Box,
    Style,
    axes,
    handy,
    second_scale,
    sheet,
    whole,
    x_label,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DB = 20 / np.log(10)  # dB for one neper


def bode(
    band: FrequencyBand, unit: str, excited: tuple[float, float], corner: float | None, style: Style
) -> Figure:
    """Return magnitude and phase with their 95 % bands.

    `unit` is the magnitude's; `excited` [rad/s] is the range of frequencies that the data tell of; what lies outside is shaded;
    `corner` [rad/s] is marked.
    """
    palette = style.palette
    height = 2 * (150 + TITLE) + BOTTOM + 4
    figure = sheet(style, height)
    width = style.width - LEFT - SECOND_SCALE
    tops = (4 + TITLE, 4 + 2 * TITLE + 150)
    boxes = [Box(left=LEFT, top=top, width=width, height=150, indent=LEFT) for top in tops]
    db, degrees = 20 * np.log10(band.magnitude), np.degrees(band.phase)
    magnitude = axes(figure, boxes[0], palette, "Magnitude (dB)")
    phase = axes(figure, boxes[1], palette, "Phase (°)")
    for ax, y, half in (
        (magnitude, db, _DB * band.magnitude_half),
        (phase, degrees, np.degrees(band.phase_half)),
    ):
        _frequencies(ax, band.omega, excited, corner, palette)
        ax.fill_between(band.omega, y - half, y + half, color=palette.band, linewidth=0)
        ax.plot(band.omega, y, color=palette.model, linewidth=1.8)
    magnitude.tick_params(axis="x", labelbottom=False)
    _decibels(magnitude, db, unit, palette)
    _degree_ticks(phase, degrees, np.degrees(band.phase_half))
    if corner is not None:
        _note(magnitude, corner, f"1/τ = {plain(corner, 3)} rad/s", palette)
    x_label(phase, "angular frequency (rad/s)", palette)
    return figure


def step(band: StepBand, unit: str, mark: tuple[float, float] | None, style: Style) -> Figure:
    """Return a step response with its 95 % band; `mark` (t [s], y) is where 63.2 % are reached."""
    palette = style.palette
    figure = sheet(style, 250)
    factor, scaled = handy([band.y], unit)
    ax = axes(figure, whole(style, 250), palette, f"Step response ({scaled})")
    y, half = band.y / factor, band.half / factor
    ax.fill_between(band.t, y - half, y + half, color=palette.band, linewidth=0)
    ax.plot(band.t, y, color=palette.model, linewidth=1.8)
    if mark is not None:
        _mark(ax, mark[0], mark[1] / factor, foot=min(0.0, float(y.min())), palette=palette)
    ax.set_xlim(band.t[0], band.t[-1])
    x_label(ax, "time (s)", palette)
    return figure


def pole_map(poles: Sequence[PoleBand], integrator: complex | None, style: Style) -> Figure:
    """Return the poles in the complex plane, with their 95 % intervals; `integrator` is a thin cross, as it isn't estimated."""
    palette = style.palette
    figure = sheet(style, 250)
    box = whole(style, 250)
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
        ax.plot([integrator.real], [integrator.imag], marker="x", markersize=9, markeredgewidth=1, color=palette.model,
                linestyle="none")  # fmt: skip
    ax.text(right, 0.94 * up, "unstable ", fontsize=FONT, color=palette.muted, ha="right", va="top")
    ax.set(xlim=(left, right), ylim=(-up, up))
    if all(band.pole.imag == 0 for band in poles):
        ax.set_yticks([0])
    x_label(ax, "real part (1/s)", palette)
    return figure


def _mark(ax: Axes, t: float, y: float, *, foot: float, palette: Palette) -> None:
    """A point with dotted lines to both axes, and what it is."""
    ax.plot([t, t, 0], [foot, y, y], color=palette.muted, linewidth=1, linestyle=(0, (2, 3)))
    ax.plot([t], [y], marker="o", markersize=6, color=palette.model, linestyle="none")
    ax.annotate(
        f"63.2 % after {with_unit(t, 's', 3)}",
        (t, y),
        xytext=(9, -14 if y >= 0 else 14),
        textcoords="offset points",
        fontsize=FONT,
        color=palette.muted,
    )


def _frequencies(
    ax: Axes, omega: Array, frequency_range: tuple[float, float], corner: float | None, palette: Palette
) -> None:
    """A logarithmic axis of frequencies, with what the data can't tell shaded."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    ax.set_xscale("log")
    ax.set_xlim(omega[0], omega[-1])
    ax.xaxis.set_major_locator(LogLocator(base=10.0, numticks=12))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: plain(value)))
    ax.grid(True, axis="x", color=palette.rule, linewidth=1.0)
    for low, high in ((omega[0], frequency_range[0]), (frequency_range[1], omega[-1])):
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
    ax.yaxis.set_major_locator(
        MultipleLocator(next(step for step in (45, 90, 180) if high - low < 5.5 * step or step == 180))
    )


def _note(ax: Axes, x: float, text: str, palette: Palette) -> None:
    """A note beside a vertical line, near its foot, on the side where there is room."""
    low, high = (float(np.log(end)) for end in ax.get_xlim())
    left = np.log(x) > low + 0.6 * (high - low)
    ax.annotate(
        text,
        (x, 0.06),
        xytext=(-4 if left else 4, 0),
        xycoords=("data", "axes fraction"),
        textcoords="offset points",
        ha="right" if left else "left",
        fontsize=FONT,
        color=palette.muted,
    )


def _real_span(parts: Sequence[float]) -> tuple[float, float]:
    """The shown part of the real axis: all poles and zero, with room on both sides."""
    low, high = min([*parts, 0.0]), max([*parts, 0.0])
    size = max(high - low, 1e-12)
    return low - 0.35 * size, high + 0.3 * size


def _complex_text(pole: complex) -> str:
    real = plain(pole.real)
    return real if pole.imag == 0 else f"{real} {'+' if pole.imag > 0 else '−'} {plain(abs(pole.imag))}j"
