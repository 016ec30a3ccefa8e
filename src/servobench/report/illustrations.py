"""The figures of data and residuals, each with a caption and a text description."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.channels import Array
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import TWO_SIDED, count_text, handy_unit, percent, plain, with_unit
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.result import Comparison, Result
from servobench.recordings.measurement.dataset import Dataset
from servobench.report import figures
from servobench.report.decimation import hold_line
from servobench.report.figures import Course, Curve, Difference, Panel
from servobench.report.palette import Style
from servobench.report.speed import eye_speed, eye_window

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_RECORDS = 6  # side by side; of further ones the caption says how many there are
_LAGS = 30
_BINS = 41
_ROUNDING = 1.0  # a residual of less than so many counts is worth comparing with that of rounding alone


@dataclass(frozen=True, kw_only=True, eq=False)
class Illustration:
    """One figure: a name for links, a title, a caption, a description in words, and how to draw it in a style."""

    name: str
    title: str
    caption: str
    description: str
    draw: Callable[[Style], Figure]


def data_and_model(result: Result) -> Illustration:
    """Return input and output over time, and the model's output where there is a model."""
    shown = result.data[:MOST_RECORDS]
    fitted = result.fit.records[:MOST_RECORDS] if result.fit else (None,) * len(shown)
    several = len(result.data) > 1
    courses = tuple(_course(data, record, several) for data, record in zip(shown, fitted, strict=True))
    return Illustration(
        name="course",
        title="Input, output and model over time" if result.fit else "Input and output over time",
        caption=_course_caption(result, shown),
        description=" ".join([*map(_course_words, shown), *_model_words(result)]),
        draw=partial(figures.time_courses, courses),
    )


def residuals(fit: Fit) -> tuple[tuple[Illustration, ...], ...]:
    """Return the residual over time, and below it its autocorrelation and its distribution."""
    shown = fit.records[:MOST_RECORDS]
    courses = tuple(_residual_course(record, len(fit.records) > 1) for record in shown)
    size = _residual_size(fit)
    quantum = fit.records[0].data.quantum
    is_band_visible = quantum and fit.residual_sd < 5 * _ROUNDING * quantum
    half_count = " The grey band is half a count on either side of zero." if is_band_visible else ""
    over_time = Illustration(
        name="residual",
        title="Residual over time",
        caption=f"Measured minus simulated output. {size}{half_count}{_more(len(fit.records))}",
        description=f"The residual over time. {size}",
        draw=partial(figures.time_courses, courses),
    )
    pair = tuple(figure for figure in (_correlation(fit), _distribution(fit)) if figure is not None)
    return ((over_time,), pair) if pair else ((over_time,),)


def against_nominal(comparisons: Sequence[Comparison]) -> Illustration | None:
    """Return how far the estimates are from their nominal values, in per cent; None where no nominal value has a size."""
    rows = tuple(
        Difference(
            name=parameter_in_words(comparison.name, comparison.unit),
            percent=100 * (comparison.identified / comparison.nominal - 1),
            half=100 * TWO_SIDED * comparison.sd / abs(comparison.nominal),
        )
        for comparison in comparisons
        if comparison.nominal
    )
    if not rows:
        return None
    text = "; ".join(f"{row.name} {plain(row.percent, 3)} % ± {plain(row.half, 2)} %" for row in rows)
    return Illustration(
        name="nominal",
        title="Identified against nominal",
        caption="A dot is the identified value, the bar its 95 % interval; a missing bar is narrower than the dot.",
        description=f"Differences from the nominal values: {text}.",
        draw=partial(figures.differences, rows, "the nominal value"),
    )


def _course(data: Dataset, fitted: FittedRecord | None, several: bool) -> Course:
    """Input, speed and, where it was measured, position; time counts from the record's first sample."""
    t = data.t_output - data.t_output[0]
    t_input, u = hold_line(data.t_input - data.t_output[0], data.u, data.input_before, float(t[-1]))
    panels = [
        Panel(title="Input", unit=data.input_unit, curves=(Curve(t=t_input, y=u, look="input"),), height=90.0)
    ]
    if data.kind == "position":
        window = eye_window(data)
        lines = _lines(data, fitted, lambda y: eye_speed(t, y, window))
        panels.append(
            Panel(
                title="Speed, for illustration only", unit=f"{data.output_unit}/s", curves=_with_names(lines)
            )
        )
        panels.append(
            Panel(title="Position", unit=data.output_unit, curves=_lines(data, fitted, lambda y: (t, y)))
        )
    else:
        curves = _with_names(_lines(data, fitted, lambda y: (t, y)))
        panels.append(Panel(title="Speed", unit=data.output_unit, curves=curves, height=190.0))
    return Course(panels=tuple(panels), title=_short(data.name) if several else "")


def _lines(
    data: Dataset, fitted: FittedRecord | None, through: Callable[[Array], tuple[Array, Array]]
) -> tuple[Curve, ...]:
    t, y = through(data.y)
    measured = Curve(t=t, y=y, look="measured")
    if fitted is None or not np.isfinite(fitted.prediction).all():
        return (measured,)
    t, y = through(fitted.prediction)
    return (measured, Curve(t=t, y=y, look="model"))


def _with_names(curves: tuple[Curve, ...]) -> tuple[Curve, ...]:
    """The same curves, named for the legend."""
    return tuple(Curve(t=curve.t, y=curve.y, look=curve.look, label=curve.look) for curve in curves)


def _course_caption(result: Result, shown: Sequence[Dataset]) -> str:
    parts = []
    if result.fit:
        parts.append("Wide and grey: measured. Thin and blue: the model, simulated from the input alone.")
    positions = [data for data in shown if data.kind == "position"]
    if positions:
        windows = sorted(eye_window(data) * data.sample_time for data in positions)
        ends = dict.fromkeys(with_unit(window, "s", 2) for window in (windows[0], windows[-1]))
        both = ", taken from both alike," if result.fit else ""
        parts.append(
            f"The speed is for illustration only: differences of the position{both} over {' to '.join(ends)}."
        )
    elif shown and shown[0].chain:
        parts.append(
            f"The signals are shown after the measurement chain ‘{shown[0].chain}’, through which the model's output passed, too."
        )
    return " ".join(parts) + _more(len(result.data))


def _course_words(data: Dataset) -> str:
    levels = np.append(data.u, data.input_before)
    low, high = (with_unit(float(level), data.input_unit, 3) for level in (levels.min(), levels.max()))
    y_low, y_high = (with_unit(float(y), data.output_unit, 3) for y in (data.y.min(), data.y.max()))
    return (
        f"{data.name}: over {with_unit(data.duration, 's', 3)} the input is between {low} and {high}, "
        f"the {data.kind} between {y_low} and {y_high}."
    )


def _model_words(result: Result) -> list[str]:
    if result.fit is None or not np.isfinite(result.fit.fit_percent):
        return []
    return [f"The model's line explains {percent(result.fit.fit_percent)} % of the measured one."]


def _residual_course(record: FittedRecord, several: bool) -> Course:
    data, keep = record.data, record.valid
    curve = Curve(t=data.t_output[keep] - data.t_output[0], y=record.residual[keep], look="residual")
    panel = Panel(
        title="Residual", unit=data.output_unit, curves=(curve,), quantum=data.quantum, height=130.0
    )
    return Course(panels=(panel,), title=_short(data.name) if several else "")


def _residual_size(fit: Fit) -> str:
    data = fit.records[0].data
    largest = max((float(np.abs(record.residual).max(initial=0.0)) for record in fit.records), default=0.0)
    factor, unit = handy_unit(data.output_unit, largest)  # as in the figure
    size = f"Its standard deviation is {plain(fit.residual_sd / factor, 3)} {unit}"
    if not data.quantum:
        return f"{size}."
    counts, alone = plain(fit.residual_sd / data.quantum, 3), plain(1 / np.sqrt(12), 3)
    return f"{size}, which is {counts} counts (rounding alone: {alone})."


def _correlation(fit: Fit) -> Illustration | None:
    """The autocorrelation over all records; None for records too short for it."""
    leftovers = [record.residual[record.valid] for record in fit.records]
    longest = min(_LAGS, min(len(e) for e in leftovers) // 4)
    centred = [e - e.mean() for e in leftovers]
    power = sum(float(e @ e) for e in centred)
    if longest < 2 or not power > 0:
        return None
    lags = np.arange(1, longest + 1)
    rho = np.array([sum(float(e[lag:] @ e[:-lag]) for e in centred) for lag in lags]) / power
    bound = TWO_SIDED / np.sqrt(sum(map(len, centred)))
    outside = int(np.count_nonzero(np.abs(rho) > bound))
    largest = int(np.argmax(np.abs(rho)))
    return Illustration(
        name="correlation",
        title="Autocorrelation of the residual",
        caption=(
            f"White noise stays within the grey band (±{plain(bound, 2)}) at 95 of 100 lags; here "
            f"{count_text(outside, 'lag')} of {longest} {'leaves' if outside == 1 else 'leave'} it."
        ),
        description=f"The largest correlation is {plain(rho[largest], 2)}, at a lag of {count_text(largest + 1, 'sample')}.",
        draw=partial(figures.correlation, lags.astype(np.float64), rho, float(bound)),
    )


def _distribution(fit: Fit) -> Illustration | None:
    """The histogram over all records beside what rounding alone, or else normal noise of that size, would give."""
    data = fit.records[0].data
    e = np.concatenate([record.residual[record.valid] for record in fit.records])
    sd, quantum = float(e.std()), data.quantum
    if not sd > 0:
        return None
    limit = max(min(float(np.abs(e).max()), 5 * sd), 0.75 * (quantum or 0.0))
    factor, unit = handy_unit(data.output_unit, limit)
    edges = np.linspace(-limit, limit, _BINS + 1) / factor
    counts, _ = np.histogram(e / factor, edges)
    density = counts / (len(e) * (edges[1] - edges[0]))
    if quantum and sd < _ROUNDING * quantum:
        half = 0.5 * quantum / factor
        x = np.array([edges[0], -half, -half, half, half, edges[-1]])
        expected = Curve(t=x, y=np.array([0, 0, 1, 1, 0, 0]) / (2 * half), look="model", label="rounding")
        reference = "uniform within ± half a count, as for rounding alone"
    else:
        x = np.linspace(edges[0], edges[-1], 121)
        s = sd / factor
        expected = Curve(
            t=x, y=np.exp(-0.5 * (x / s) ** 2) / (s * np.sqrt(2 * np.pi)), look="model", label="normal"
        )
        reference = "a normal distribution of the same standard deviation"
    beyond = int(np.count_nonzero(np.abs(e) > limit))
    out = f" {count_text(beyond, 'sample')} beyond the axis." if beyond else ""
    return Illustration(
        name="distribution",
        title="Distribution of the residual",
        caption=f"The blue line is {reference}.{out}",
        description=f"Histogram with a standard deviation of {with_unit(sd, data.output_unit, 3)}; the line is {reference}.",
        draw=partial(figures.distribution, edges, density, expected, unit),
    )


def _short(name: str, longest: int = 40) -> str:
    """A name for a figure: one line, not too long, in characters that a font can be asked for."""
    name = " ".join(name.encode("utf-8", "replace").decode().split())
    return name if len(name) <= longest else f"{name[: longest - 1]}…"


def _more(records: int) -> str:
    """A sentence for the case that not all records are shown."""
    return f" {MOST_RECORDS} of {records} records are shown." if records > MOST_RECORDS else ""
