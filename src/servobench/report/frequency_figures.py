"""Figures of a measured frequency response: points with their bands, the model's curve, and the coherence below."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.palette import Palette
from servobench.core.rounding import plain
from servobench.identification.estimators.frequency_response import FrequencyResponse
from servobench.identification.uncertainty.bands import FrequencyBand
from servobench.report.palette import (
    BOTTOM,
    LEFT,
    SECOND_SCALE,
    TITLE,
    Box,
    Style,
    axes,
    legend,
    second_scale,
    sheet,
    x_label,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_HEIGHTS = (170.0, 150.0, 70.0)  # of magnitude, phase and coherence [px]
_MOST = 400  # points; more of them would be a blot
_DEEP = 1e-3  # of a magnitude: where its band ends that reaches zero


def measured_bode(response: FrequencyResponse, band: FrequencyBand | None, style: Style) -> Figure:
    """Return magnitude and phase of a measured frequency response with 95 % bands, and its coherence.

    `band` is a model's frequency response, of the same output, or None. Of many points every second, third, ... is drawn.
    """
    palette = style.palette
    figure = sheet(style, 4 + sum(_HEIGHTS) + 3 * TITLE + BOTTOM)
    magnitude, phase, coherence = _three(figure, style)
    chosen = np.arange(0, len(response.omega), max(1, -(-len(response.omega) // _MOST)))
    omega = response.omega[chosen]
    size, half = response.magnitude[chosen], response.magnitude_half[chosen]
    low, high = _db(np.maximum(size - half, _DEEP * size)), _db(size + half)
    _points(magnitude, omega, _db(size), (low, high), palette)
    degrees = np.degrees(_beside(response, band)[chosen])
    angle = np.degrees(response.phase_half[chosen])
    _points(phase, omega, degrees, (degrees - angle, degrees + angle), palette)
    coherence.plot(omega, response.coherence[chosen], ".", markersize=5, color=palette.measured)
    if band is not None:
        _curve(magnitude, band.omega, _db(band.magnitude), _db_half(band), palette)
        _curve(phase, band.omega, np.degrees(band.phase), np.degrees(band.phase_half), palette)
        legend(phase, palette, Box(left=LEFT, top=0, width=style.width, height=_HEIGHTS[1], indent=LEFT))
    _ticks(magnitude, phase, coherence, response, palette)
    return figure


def _three(figure: Figure, style: Style) -> tuple[Axes, Axes, Axes]:
    """The axes for magnitude, phase and coherence above each other."""
    palette, top, made = style.palette, 4.0, []
    for title, height in zip(("Magnitude (dB)", "Phase (°)", "Coherence"), _HEIGHTS, strict=True):
        box = Box(
            left=LEFT, top=top + TITLE, width=style.width - LEFT - SECOND_SCALE, height=height, indent=LEFT
        )
        made.append(axes(figure, box, palette, title))
        top += TITLE + height
    return made[0], made[1], made[2]


def _points(ax: Axes, omega: Array, y: Array, ends: tuple[Array, Array], palette: Palette) -> None:
    """Points, each with its band as a line behind it."""
    ax.vlines(omega, *ends, colors=palette.band, linewidth=4)
    ax.plot(omega, y, "o", markersize=3.5, color=palette.measured, label="measured, with 95 % bands")


def _curve(ax: Axes, omega: Array, y: Array, half: Array, palette: Palette) -> None:
    """The model's curve and the edges of its band."""
    ax.plot(omega, y, color=palette.model, linewidth=1.4, label="model", zorder=3)
    for side in (-1, 1):
        ax.plot(omega, y + side * half, color=palette.model, linewidth=0.6, linestyle=(0, (4, 3)), zorder=3)


def _ticks(
    magnitude: Axes, phase: Axes, coherence: Axes, response: FrequencyResponse, palette: Palette
) -> None:
    """A common logarithmic axis of frequencies, tens of dB, fractions of a turn, and the magnitude's unit on the right."""
    from matplotlib.ticker import FuncFormatter, LogLocator, MultipleLocator, NullLocator

    first, last = float(response.omega[0]), float(response.omega[-1])
    room = max((last / first) ** 0.04, 1.1)
    for ax in (magnitude, phase, coherence):
        ax.set_xscale("log")
        ax.set_xlim(first / room, last * room)
        ax.xaxis.set_major_locator(
            LogLocator(base=10.0, subs=_firsts(last * room * room / first), numticks=12)
        )
        ax.xaxis.set_minor_locator(NullLocator())
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: plain(value)))
        ax.grid(True, axis="x", color=palette.rule, linewidth=1.0)
    for ax in (magnitude, phase):
        ax.tick_params(axis="x", labelbottom=False)
    db = _db(response.magnitude)
    low, high = float(db.min()) - 6, float(db.max()) + 6
    magnitude.set_ylim(low, high)
    magnitude.yaxis.set_major_locator(
        MultipleLocator(next((s for s in (10, 20, 40) if high - low < 6 * s), 80))
    )
    values = [digit * 10.0**decade for decade in range(-12, 13) for digit in (1.0, 2.0, 5.0)]
    inside = [v for v in values if low <= _db(np.array([v]))[0] <= high]
    inside = inside if len(inside) < 7 else inside[::3]
    second_scale(
        magnitude, _db(np.array(inside)).tolist(), [plain(v) for v in inside], response.unit, palette
    )
    phase.set_ylim(*_span_of_phase(phase))
    phase.yaxis.set_major_locator(MultipleLocator(45))
    coherence.set_ylim(-0.02, 1.05)
    coherence.set_yticks([0, 0.5, 1])
    x_label(coherence, "angular frequency (rad/s)", palette)


def _span_of_phase(phase: Axes) -> tuple[float, float]:
    """From what is drawn as points or curves: a quarter of a turn at least, two turns at most."""
    angles = np.concatenate([np.asarray(line.get_ydata(), dtype=np.float64) for line in phase.lines])
    angles = angles[np.isfinite(angles)]
    low, high = max(float(angles.min()), -540.0), min(float(angles.max()), 180.0)
    return min(low, high - 90.0) - 8, high + 8


def _firsts(span: float) -> tuple[float, ...]:
    """The digits that a decade's ticks begin with, for a ratio of the ends."""
    return (1.0,) if span > 300 else (1.0, 2.0, 5.0)


def _beside(response: FrequencyResponse, band: FrequencyBand | None) -> Array:
    """The phases (F,) [rad] within half a turn of the model's, or else without jumps."""
    if band is None:
        return response.phase
    model = np.interp(np.log(response.omega), np.log(band.omega), band.phase)
    turned: NDArray[np.complex128] = response.response * np.exp(-1j * model)
    return np.asarray(model + np.angle(turned), dtype=np.float64)


def _db(magnitude: Array) -> Array:
    return np.asarray(20 * np.log10(magnitude), dtype=np.float64)


def _db_half(band: FrequencyBand) -> Array:
    """Half of the band of a magnitude whose logarithm it belongs to, in dB."""
    return np.asarray(20 / np.log(10) * band.magnitude_half, dtype=np.float64)
