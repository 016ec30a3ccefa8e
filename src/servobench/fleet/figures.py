"""The figures of a fleet's report: how each parameter is spread, and its control chart. Drawn from bins, however many motors."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.channels import Array
from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import count_text, handy_unit, with_unit
from servobench.fleet.table import Fleet, Parameter
from servobench.report.illustrations import Illustration
from servobench.report.palette import Style, axes, legend, sheet, whole, x_label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_HEIGHT = 200.0
_BINS = (8, 48)  # the fewest and the most; between them two for each root of the number of motors
_POINTS = 100  # of a control chart, at most
_MOVING_RANGE = 0.954  # the median range of two normal values over their standard deviation: 0.6745 √2
_FENCE = 4.0  # interquartile ranges from the middle: what is further away is counted in the outermost bin
_DRIFT = 0.01  # p value from which a drift is worth a sentence


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlChart:
    """Means of consecutive motors, `size` in each group, with control limits. Source: Shewhart's X̄ chart.

    `mean`, `low` and `high` (groups,) are mean, 5 % and 95 % quantile of each group; the control limits are `centre` ± `reach`.
    """

    size: int
    mean: Array
    low: Array
    high: Array
    centre: float
    reach: float
    drift: float | None
    """Change from the first to the last motor along the Theil-Sen line; None where Kendall's test doesn't show any."""

    @property
    def outside(self) -> int:
        """The number of groups outside the control limits."""
        return int((np.abs(self.mean - self.centre) > self.reach).sum())


def control_chart(values: Array) -> ControlChart | None:
    """Return the control chart of values (N,) in the order in which the motors were made; None for fewer than eight.

    Control limits are 3 σ/√size about the median; σ is the median of the moving ranges over 0.954, for which neither drift nor
    a few odd motors count.
    """
    from scipy.stats import kendalltau, theilslopes

    values = values[np.isfinite(values)]
    if len(values) < 8:
        return None
    size = math.ceil(len(values) / _POINTS)
    groups = [values[start : start + size] for start in range(0, len(values) - size + 1, size)]
    mean = np.array([group.mean() for group in groups])
    sigma = float(np.median(np.abs(np.diff(values)))) / _MOVING_RANGE
    place = np.arange(len(mean), dtype=np.float64)
    test = kendalltau(place, mean)
    slope = theilslopes(mean, place)[0] if test.pvalue < _DRIFT else None
    return ControlChart(
        size=size,
        mean=mean,
        low=np.array([np.quantile(group, 0.05) for group in groups]),
        high=np.array([np.quantile(group, 0.95) for group in groups]),
        centre=float(np.median(values)),
        reach=3 * sigma / math.sqrt(size),
        drift=None if slope is None else float(slope) * (len(mean) - 1),
    )


def distribution(fleet: Fleet, parameter: Parameter) -> Illustration:
    """Return how a parameter is spread over the motors, with its limits."""
    values = parameter.value[np.isfinite(parameter.value)]
    ends = _limits(fleet, parameter)
    low, high = axis_range(values, ends)
    beyond = int(((values < low) | (values > high)).sum())
    name = parameter_in_words(parameter.name, parameter.unit)
    middle = with_unit(float(np.median(values)), parameter.unit)
    half = float(np.median((parameter.high - parameter.low)[np.isfinite(parameter.value)])) / 2
    typical = with_unit(half, parameter.unit, 2)
    caption = f"{count_text(len(values), 'motor')}; median {middle}; half of a 95 % interval is typically {typical}."
    if beyond:
        caption += f" {count_text(beyond, 'motor')} further away, counted at the edge."
    extremes = [with_unit(float(end), parameter.unit) for end in (values.min(), values.max())]
    return Illustration(
        name=f"spread-{parameter.name.replace('_', '-')}",
        title=f"Spread of the {name}",
        caption=caption,
        description=f"The {name} lies between {extremes[0]} and {extremes[1]}.",
        draw=partial(histogram, np.clip(values, low, high), (low, high), ends, parameter.unit),
    )


def over_time(fleet: Fleet, parameter: Parameter, order: Array, along: str) -> Illustration | None:
    """Return the control chart of a parameter with the motors in an order (N,), by what is `along`; None for too few."""
    chart = control_chart(parameter.value[order])
    if chart is None:
        return None
    name = parameter_in_words(parameter.name, parameter.unit)
    what = (
        "Each point is a motor"
        if chart.size == 1
        else f"Each point is the mean of {chart.size} motors, the bar their middle 90 %"
    )
    caption = f"{what}, by {along}. The band is where the means of a steady production lie (±3 σ, σ from successive motors): "
    caption += f"{chart.outside} of {count_text(len(chart.mean), 'point')} {'is' if chart.outside == 1 else 'are'} outside."
    if chart.drift is not None:
        caption += f" It drifts by {with_unit(chart.drift, parameter.unit, 2)} from first to last."
    return Illustration(
        name=f"course-{parameter.name.replace('_', '-')}",
        title=f"Control chart of the {name}",
        caption=caption,
        description=caption,
        draw=partial(_chart, chart, _limits(fleet, parameter), parameter.unit, along),
    )


def _limits(fleet: Fleet, parameter: Parameter) -> tuple[float, ...]:
    """The limits of a parameter that are finite."""
    if fleet.limits is None:
        return ()
    ends = [
        end
        for limit in fleet.limits.limits
        if limit.parameter == parameter.name
        for end in limit.ends(parameter.unit)
    ]
    return tuple(end for end in ends if math.isfinite(end))


def axis_range(values: Array, ends: Sequence[float]) -> tuple[float, float]:
    """Return what a histogram of values (N,) shows: nearly all, and the lines at `ends`."""
    lower, middle, upper = np.quantile(values, (0.25, 0.5, 0.75))
    reach = _FENCE * max(float(upper - lower), 1e-6 * abs(float(middle)), 1e-300)
    low, high = max(float(values.min()), middle - reach), min(float(values.max()), middle + reach)
    low, high = min([low, *ends]), max([high, *ends])
    margin = 0.04 * (high - low) or reach
    return float(low - margin), float(high + margin)


def histogram(
    values: Array,
    shown: tuple[float, float],
    ends: Sequence[float],
    unit: str,
    style: Style,
    label: str = "limits",
) -> Figure:
    """Return how many motors have which value (N,), within `shown`, with lines at `ends`, called `label`; all in a unit."""
    factor, symbol = handy_unit(unit, float(np.abs(values).max()))
    counts, edges = np.histogram(values, bins=_bins(len(values)), range=shown)
    figure = sheet(style, _HEIGHT)
    ax = axes(figure, whole(style, _HEIGHT), style.palette, "Motors")
    ax.locator_params(axis="y", integer=True)
    ax.stairs(counts, edges / factor, fill=True, color=style.palette.measured, linewidth=0)
    _draw_limits(ax.axvline, [end / factor for end in ends], style, label)
    ax.set(ylim=(0, 1.1 * max(int(counts.max()), 1)), xlim=tuple(edges[[0, -1]] / factor))
    if ends:
        legend(ax, style.palette, whole(style, _HEIGHT))
    x_label(ax, symbol, style.palette)
    return figure


def _chart(chart: ControlChart, ends: Sequence[float], unit: str, along: str, style: Style) -> Figure:
    factor, symbol = handy_unit(unit, float(np.abs(chart.mean).max()))
    figure = sheet(style, _HEIGHT)
    ax = axes(figure, whole(style, _HEIGHT), style.palette, symbol)
    place = (np.arange(len(chart.mean)) + 0.5) * chart.size
    ax.axhspan(
        (chart.centre - chart.reach) / factor,
        (chart.centre + chart.reach) / factor,
        color=style.palette.band,
        linewidth=0,
    )
    if chart.size > 1:
        ax.vlines(place, chart.low / factor, chart.high / factor, color=style.palette.measured, linewidth=1.0)
    ax.plot(place, chart.mean / factor, color=style.palette.model, linewidth=1.0, marker="o", markersize=2.5)
    _draw_limits(ax.axhline, [end / factor for end in ends], style)
    ax.set_xlim(0, len(chart.mean) * chart.size)
    if ends:
        legend(ax, style.palette, whole(style, _HEIGHT))
    x_label(ax, f"motors, by {along}", style.palette)
    return figure


def _bins(count: int) -> int:
    return min(max(round(2 * math.sqrt(count)), _BINS[0]), _BINS[1])


def _draw_limits(
    line: Callable[..., object], ends: Sequence[float], style: Style, label: str = "limits"
) -> None:
    for number, end in enumerate(ends):
        called = None if number else label
        line(end, color=style.palette.ink, linewidth=1.5, linestyle=(0, (4, 2)), label=called)
