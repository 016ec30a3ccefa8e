"""The figures of an ensemble's report: bands over time, how outcomes are spread, and which tolerance moves them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import count_text, handy_unit, plain, with_unit
from servobench.fleet.figures import axis_range, histogram
from servobench.report.illustrations import Illustration
from servobench.report.palette import BOTTOM, RIGHT, TITLE, Box, Style, axes, legend, sheet, whole, x_label
from servobench.rig.ensemble.ensemble import Bands, Ensemble
from servobench.rig.ensemble.outcomes import UNITS
from servobench.rig.ensemble.sensitivity import Sensitivity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN_IN = {"overshoot": (100.0, "%"), "phase_margin": (180 / np.pi, "°")}
"""Outcomes that people read in another unit than it is computed in: the factor, and that unit."""

_HEIGHT = 210.0
_ROW = 34.0
_NAMES = 116.0  # px for the parameters' names


def bands_over_time(ensemble: Ensemble) -> tuple[Illustration, ...]:
    """Return speed and position over time: the middle motor, the middle half and the middle 90 % of all."""
    return tuple(
        Illustration(
            name=f"bands-{each.name}",
            title=f"{each.name.capitalize()} over time",
            caption=f"The line is the median of {count_text(len(ensemble), 'motor')}, the bands hold half and 90 % of them.",
            description=_ends_in_words(each),
            draw=partial(_bands, each),
        )
        for each in ensemble.bands
    )


def spreads(ensemble: Ensemble) -> dict[str, Illustration]:
    """Return how each outcome is spread over the motors; those that no two motors have are left out."""
    illustrations = {}
    for name, values in ensemble.outcomes.items():
        known = values[np.isfinite(values)]
        if len(known) < 2:
            continue
        words, unit = parameter_in_words(name), UNITS[name]
        factor, axis = SHOWN_IN.get(name, (1.0, unit))
        axis_values = factor * known
        shown = axis_range(axis_values, ())
        low, high = (with_unit(float(end), axis) for end in (axis_values.min(), axis_values.max()))
        nominal = ensemble.nominal[name]
        lines = (factor * nominal,) if np.isfinite(nominal) else ()
        illustrations[name] = Illustration(
            name=f"spread-{name.replace('_', '-')}",
            title=f"Spread of the {words}",
            caption=f"{count_text(len(known), 'motor')}, {low} to {high}."
            + (" The dashed line is the motor without tolerances." if lines else ""),
            description=f"The {words} lies between {low} and {high}.",
            draw=partial(histogram, np.clip(axis_values, *shown), shown, lines, axis, label="nominal"),
        )
    return illustrations


def tornado(ensemble: Ensemble, outcome: str) -> Illustration | None:
    """Return what each tolerance alone does to an outcome, the strongest on top; None where nothing is known of it."""
    rows = [each for each in ensemble.sensitivities if each.outcome == outcome and np.isfinite(each.effect)]
    nominal = ensemble.nominal[outcome]
    if not rows or not np.isfinite(nominal) or not any(each.effect for each in rows):
        return None
    words = parameter_in_words(outcome)
    ranges_text = "; ".join(
        f"{parameter_in_words(each.parameter)} {plain(each.low, 4)} to {plain(each.high, 4)}" for each in rows
    )
    return Illustration(
        name=f"tornado-{outcome.replace('_', '-')}",
        title=f"What moves the {words}",
        caption="Each bar is one parameter from the lower end of its tolerance (grey) to the upper end (blue).",
        description=f"The {words} with each parameter at either end of its tolerance: {ranges_text}.",
        draw=partial(_tornado, rows, nominal, *SHOWN_IN.get(outcome, (1.0, UNITS[outcome]))),
    )


def _ends_in_words(bands: Bands) -> str:
    low, _, middle, _, high = (with_unit(float(x), bands.unit) for x in bands.values[:, -1])
    return f"At the end the median of the {bands.name} is {middle}; 90 % of the motors lie between {low} and {high}."


def _bands(bands: Bands, style: Style) -> Figure:
    factor, symbol = handy_unit(bands.unit, float(np.abs(bands.values).max()))
    figure = sheet(style, _HEIGHT)
    box = whole(style, _HEIGHT)
    ax = axes(figure, box, style.palette, f"{bands.name.capitalize()} ({symbol})")
    t, y = bands.t, bands.values / factor
    ax.fill_between(t, y[0], y[4], color=style.palette.band, linewidth=0, label="90 %")
    ax.fill_between(t, y[1], y[3], color=style.palette.measured, linewidth=0, label="half")
    ax.plot(t, y[2], color=style.palette.model, linewidth=1.2, label="median")
    ax.set_xlim(0.0, t[-1])
    legend(ax, style.palette, box)
    x_label(ax, "time (s)", style.palette)
    return figure


def _tornado(rows: Sequence[Sensitivity], nominal: float, per_unit: float, unit: str, style: Style) -> Figure:
    largest = max(abs(nominal), *(abs(x) for row in rows for x in (row.low, row.high)))
    factor, symbol = handy_unit(unit, per_unit * largest)
    factor /= per_unit
    palette, height = style.palette, _ROW * len(rows)
    figure = sheet(style, height + TITLE + BOTTOM + 4)
    box = Box(left=_NAMES, top=4 + TITLE, width=style.width - _NAMES - RIGHT, height=height, indent=_NAMES)
    ax = axes(figure, box, palette, "Outcome at the ends of each tolerance")
    ax.grid(False, axis="y")
    ax.grid(True, axis="x", color=palette.rule, linewidth=1.0)
    for place, row in enumerate(rows):
        for end, colour in ((row.low, palette.measured), (row.high, palette.model)):
            ax.barh(
                place, (end - nominal) / factor, left=nominal / factor, height=0.55, color=colour, linewidth=0
            )
    ax.axvline(nominal / factor, color=palette.muted, linewidth=1.5)
    ax.set_yticks(range(len(rows)), [parameter_in_words(row.parameter) for row in rows])
    ends = [nominal / factor, *(x / factor for row in rows for x in (row.low, row.high))]
    room = 0.08 * (max(ends) - min(ends))
    ax.set(ylim=(len(rows) - 0.5, -0.5), xlim=(min(ends) - room, max(ends) + room))
    x_label(ax, symbol, palette)
    return figure
