"""Figures of loops: the root locus, the Nyquist curve and the Bode diagram of an open loop with its margins."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.palette import Palette
from servobench.report.palette import (
    BOTTOM,
    FONT,
    LEFT,
    RIGHT,
    TITLE,
    Box,
    Style,
    axes,
    legend,
    plain_ticks,
    sheet,
    whole,
    x_label,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_HEIGHT = 300.0
_PANEL = 130.0


def root_locus(
    branches: NDArray[np.complex128], zeros: Sequence[complex], marks: Sequence[complex], style: Style
) -> Figure:
    """Return the branches (G, n) of a root locus, from the open loop's poles on, and `marks` on them; the right is shaded."""
    palette = style.palette
    figure = sheet(style, _HEIGHT)
    ax = axes(figure, whole(style, _HEIGHT), palette, "Imaginary part (1/s)")
    start = branches[0]
    size = 1.6 * max(float(np.abs(start).max()), *(abs(mark) for mark in marks), 1e-9)
    ax.axvspan(0, size, color=palette.shade, linewidth=0)
    ax.axvline(0, color=palette.muted, linewidth=1)
    for branch in branches.T:
        ax.plot(branch.real, branch.imag, color=palette.model, linewidth=1.6)
    ax.plot(start.real, start.imag, marker="x", **_dots(palette.ink, 8))
    ax.plot(
        [z.real for z in zeros],
        [z.imag for z in zeros],
        marker="o",
        markerfacecolor="none",
        **_dots(palette.ink, 8),
    )
    ax.plot([m.real for m in marks], [m.imag for m in marks], marker="s", **_dots(palette.model, 6))
    ax.text(0.4 * size, 0.02 * size, "unstable ", fontsize=FONT, color=palette.muted, ha="right", va="bottom")
    ax.set(xlim=(-size, 0.4 * size), ylim=(-size, size))
    x_label(ax, "real part (1/s)", palette)
    return figure  # fmt: skip


def nyquist(real: Array, imaginary: Array, style: Style) -> Figure:
    """Return the curve L(jω) from its parts (N,) for ω > 0, with that for ω < 0, faint, about -1, with the unit circle."""
    palette = style.palette
    figure = sheet(style, _HEIGHT)
    ax = axes(figure, whole(style, _HEIGHT), palette, "Imaginary part of L")
    around = np.linspace(0, 2 * np.pi, 181)
    ax.plot(np.cos(around), np.sin(around), color=palette.rule, linewidth=1.2)
    ax.plot(real, -imaginary, color=palette.band, linewidth=1.6)
    ax.plot(real, imaginary, color=palette.model, linewidth=1.8)
    ax.plot([-1.0], [0.0], marker="+", **_dots(palette.ink, 12))
    # As wide as the sheet is, at the same scale on both axes.
    inner = style.width - LEFT - RIGHT
    wide = 2.4 * inner / (_HEIGHT - TITLE - BOTTOM - 4)
    ax.set(xlim=(0.45 * -wide - 0.3, 0.55 * wide - 0.3), ylim=(-1.2, 1.2))
    ax.set_aspect("equal", adjustable="datalim")
    x_label(ax, "real part of L", palette)
    return figure


def loop_bode(
    omega: Array,
    loops: Sequence[tuple[str, NDArray[np.complex128]]],
    crossover: float,
    style: Style,
) -> Figure:
    """Return magnitude and phase of open loops, each a name and L(jω) (N,) at `omega` (N,) [rad/s], the last as the model's.

    The gain crossover [rad/s] is marked.
    """
    palette = style.palette
    height = 2 * (_PANEL + TITLE) + BOTTOM + 4
    figure = sheet(style, height)
    width = style.width - LEFT - RIGHT
    boxes = [
        Box(left=LEFT, top=4 + TITLE + n * (_PANEL + TITLE), width=width, height=_PANEL, indent=LEFT)
        for n in (0, 1)
    ]
    magnitude = axes(figure, boxes[0], palette, "Magnitude of L (dB)")
    phase = axes(figure, boxes[1], palette, "Phase of L (°)")
    for ax, level in ((magnitude, 0.0), (phase, -180.0)):
        _logarithmic(ax, omega, palette)
        ax.axhline(level, color=palette.muted, linewidth=1)
        if np.isfinite(crossover):
            ax.axvline(crossover, color=palette.muted, linewidth=1, linestyle=(0, (2, 3)))
    for n, (name, response) in enumerate(loops):
        last = n == len(loops) - 1
        look: dict[str, Any] = {
            "color": palette.model if last else palette.measured,
            "linewidth": 1.6 if last else 2.6,
        }
        magnitude.plot(omega, 20 * np.log10(np.abs(response)), label=name, **look)
        phase.plot(omega, np.degrees(np.unwrap(np.angle(response))), **look)
    magnitude.tick_params(axis="x", labelbottom=False)
    if len(loops) > 1:
        legend(magnitude, palette, boxes[0])
    x_label(phase, "angular frequency (rad/s)", palette)
    return figure  # fmt: skip


def _logarithmic(ax: Axes, omega: Array, palette: Palette) -> None:
    from matplotlib.ticker import NullLocator

    ax.set_xscale("log")
    ax.set_xlim(omega[0], omega[-1])
    plain_ticks(ax)
    ax.xaxis.set_minor_locator(NullLocator())
    ax.grid(True, axis="x", color=palette.rule, linewidth=1.0)


def _dots(colour: str, size: float) -> dict[str, Any]:
    return {"color": colour, "markersize": size, "markeredgewidth": 1.8, "linestyle": "none"}
