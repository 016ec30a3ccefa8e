"""Plots of a fit for the prompt and the notebook: axes in, axes out, on a light or a dark ground.

The bands: source: see `identification.uncertainty.bands`; that of an autocorrelation, Bartlett (1946).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.channels import Array
from servobench.core.parameter_names import parameter_in_words
from servobench.core.plotting import ground, lay_out, new_axes
from servobench.core.rounding import TWO_SIDED
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.uncertainty.bands import frequency_band
from servobench.identification.uncertainty.composition import BudgetLine, parts_of
from servobench.identification.uncertainty.identifiability import ParameterStatus
from servobench.identification.uncertainty.propagation import sample_time_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_POINTS = 400  # of a curve over frequency
_LAGS = 40  # samples


def plot_fit(fit: Fit, axes: Axes | Sequence[Axes] | None = None, *, dark: bool = False) -> Sequence[Axes]:
    """Draw measured and simulated output of each record over time [s], an axes for each; return them, (R,)."""
    panels = new_axes(axes, len(fit.records), dark)
    palette = ground(dark)
    for ax, record in zip(panels, fit.records, strict=True):
        data = record.data
        ax.plot(data.t_output, data.y, color=palette.measured, linewidth=2.6, label="measured")
        valid = record.valid
        ax.plot(
            data.t_output[valid], record.prediction[valid], color=palette.model, linewidth=1.3, label="model"
        )
        lay_out(ax, palette, "time (s)", f"{data.kind} ({data.output_unit})", _title(fit, record))
        ax.legend(frameon=False, labelcolor=palette.ink)
    return panels


def plot_residuals(
    fit: Fit, axes: Axes | Sequence[Axes] | None = None, *, dark: bool = False
) -> Sequence[Axes]:
    """Draw what the model leaves over of each record, above, and its autocorrelation, below; return the axes, (2 R,).

    The band about the autocorrelation is that of white noise, ±1.96/√N.
    """
    panels = new_axes(axes, 2 * len(fit.records), dark)
    palette = ground(dark)
    for k, record in enumerate(fit.records):
        data, valid = record.data, record.valid
        above, below = panels[2 * k], panels[2 * k + 1]
        above.plot(data.t_output[valid], record.residual[valid], color=palette.measured, linewidth=0.8)
        above.axhline(0, color=palette.model, linewidth=1)
        lay_out(above, palette, "time (s)", f"residual ({data.output_unit})", _title(fit, record))
        lags, values = _autocorrelation(record.innovations[valid])
        bound = TWO_SIDED / np.sqrt(max(int(valid.sum()), 1))
        below.axhspan(-bound, bound, color=palette.shade, linewidth=0)
        below.vlines(lags, 0, values, colors=palette.model, linewidth=2)
        lay_out(below, palette, "lag (samples)", "autocorrelation", "")
    return panels


def plot_bode(fit: Fit, axes: Axes | Sequence[Axes] | None = None, *, dark: bool = False) -> Sequence[Axes]:
    """Draw magnitude [dB] and phase [°] from the input to the speed over frequency, with 95 % bands; return the two axes.

    Frequencies go from a tenth of the slowest pole, or one period in the longest record, to half the sample rate.
    """
    magnitude, phase = new_axes(axes, 2, dark)
    palette = ground(dark)
    system = fit.model.transfer_function("speed")
    longest = max(record.data.duration for record in fit.records)
    slowest = min((abs(pole) for pole in system.poles if pole != 0), default=np.inf)
    band = frequency_band(
        fit, np.geomspace(min(2 * np.pi / longest, slowest / 10), np.pi / sample_time_of(fit), _POINTS)
    )
    decibels = 20 / np.log(10)
    curves = (
        (magnitude, decibels * np.log(band.magnitude), decibels * band.magnitude_half),
        (phase, np.degrees(band.phase), np.degrees(band.phase_half)),
    )
    for ax, y, half in curves:
        ax.fill_between(band.omega, y - half, y + half, color=palette.band, linewidth=0)
        ax.plot(band.omega, y, color=palette.model, linewidth=1.8)
        ax.set_xscale("log")
    lay_out(magnitude, palette, "", f"magnitude (dB, 1 is 1 {system.unit})", "")
    lay_out(phase, palette, "angular frequency (rad/s)", "phase (°)", "")
    return magnitude, phase


def plot_budget(
    budget: Sequence[BudgetLine],
    answers: Mapping[str, ParameterStatus],
    axes: Axes | Sequence[Axes] | None = None,
    *,
    dark: bool = False,
) -> Sequence[Axes]:
    """Draw what the interval of each known parameter is made of: half-widths in its unit; return the axes, (P,)."""
    parts = {name: parts_of(budget, answer) for name, answer in answers.items()}
    parts = {name: lines for name, lines in parts.items() if lines}
    panels = new_axes(axes, max(len(parts), 1), dark)
    palette = ground(dark)
    for ax, (name, lines) in zip(panels, parts.items(), strict=False):
        sources = [line.source for _, line in lines]
        widths = [line.half_widths[name] for _, line in lines]
        ax.barh(sources[::-1], widths[::-1], color=palette.model, height=0.6)
        title = f"{parameter_in_words(name, answers[name].estimate.unit)} {answers[name].estimate}"
        lay_out(ax, palette, f"half-width ({answers[name].estimate.unit})", "", title)
    return panels


def _title(fit: Fit, record: FittedRecord) -> str:
    return record.data.name if len(fit.records) > 1 else ""


def _autocorrelation(values: Array) -> tuple[Array, Array]:
    """The autocorrelation at lags from 1 on, as far as the record allows."""
    centred = values - values.mean() if len(values) else values
    power = float(centred @ centred) or 1.0
    lags = range(1, min(_LAGS, len(values) - 1) + 1)
    coefficients = [float(centred[lag:] @ centred[:-lag]) / power for lag in lags]
    return np.array(lags, dtype=np.float64), np.array(coefficients)
