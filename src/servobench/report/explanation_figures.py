"""The figures of an explanation: the methods' readings beside the claim, and what each cause explains."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from servobench.core.parameter_names import parameter_in_words
from servobench.core.rounding import handy_unit, with_unit
from servobench.identification.reconciliation.base import Name
from servobench.identification.reconciliation.explanation import Difference, Explanation
from servobench.identification.reconciliation.judgement import JudgedCause
from servobench.identification.reconciliation.reenactment import SPOKEN
from servobench.report.illustrations import Illustration
from servobench.report.palette import BOTTOM, RIGHT, TITLE, Box, Style, axes, sheet, x_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ROW = 30.0  # px
_SHORT = {
    "step_63": "63.2 %",
    "log_linear": "log. slope",
    "rise_time": "10 to 90 %",
    "arx": "ARX",
    "output_error": "no chain",
}
_LABELS = 124.0  # px for the names of the rows
_DATA = "the data"


def readings(explanation: Explanation) -> Illustration | None:
    """Return what the methods read beside the data's figure and the claim; None where nothing was read."""
    read = [each for each in explanation.readings if not each.why_not]
    difference = _first(explanation)
    if not read or difference is None:
        return None
    rows = [
        (_DATA, difference.data),
        *((_SHORT[each.method], _value(each, difference.name)) for each in read),
    ]
    text = "; ".join(
        f"{SPOKEN[each.method]}: {with_unit(_value(each, difference.name), difference.unit)}" for each in read
    )
    return Illustration(
        name="readings",
        title=f"The {parameter_in_words(difference.name)}, read in several ways",
        caption=f"From the same data, after {read[0].chain}. The line is the claim, the band its uncertainty.",
        description=f"The data give {with_unit(difference.data, difference.unit)}, the claim is "
        f"{with_unit(difference.other, difference.unit)}. {text}.",
        draw=partial(_dots, tuple(rows), difference),
    )


def causes(explanation: Explanation) -> Illustration | None:
    """Return what each cause of its usual size explains of the first difference; None where none explains anything."""
    difference = _first(explanation)
    weighed = tuple(each for each in explanation.causes if each.needed is not None)
    if difference is None or not weighed:
        return None
    shares = [(each, _share(each, difference.name)) for each in weighed]
    return Illustration(
        name="causes",
        title=f"How much each cause explains of the difference in the {parameter_in_words(difference.name)}",
        caption="At its usual or known size. The figure after each bar is the probability that it contributes.",
        description=" ".join(
            f"{each.label}: {share:.0f} %, probability {100 * each.probability:.0f} %."
            for each, share in shares
        ),
        draw=partial(_bars, tuple(shares), difference.name),
    )


def _first(explanation: Explanation) -> Difference | None:
    """The difference that is drawn: the time constant's where there is one."""
    order = sorted(explanation.differences, key=lambda each: each.name != "time_constant")
    return order[0] if order else None


def _value(reading: object, name: Name) -> float:
    return float(getattr(reading, name))


def _share(cause: JudgedCause, name: Name) -> float:
    return next((100 * each.value for each in cause.explains if each.name == name), 0.0)


def _rows(style: Style, count: int, title: str) -> tuple[Figure, Axes]:
    height = _ROW * count + TITLE + BOTTOM + 4
    figure = sheet(style, height)
    box = Box(
        left=_LABELS,
        top=4 + TITLE,
        width=style.width - _LABELS - RIGHT - 40,
        height=_ROW * count,
        indent=_LABELS,
    )
    ax = axes(figure, box, style.palette, title)
    ax.grid(False, axis="y")
    ax.grid(True, axis="x", color=style.palette.rule, linewidth=1.0)
    ax.set_ylim(count - 0.5, -0.5)
    return figure, ax


def _dots(rows: tuple[tuple[str, float], ...], difference: Difference, style: Style) -> Figure:
    factor, unit = handy_unit(difference.unit, max(value for _, value in rows))
    palette = style.palette
    figure, ax = _rows(style, len(rows), f"{parameter_in_words(difference.name).capitalize()} ({unit})")
    low, high = difference.other - difference.other_half, difference.other + difference.other_half
    ax.axvspan(low / factor, high / factor, color=palette.shade, linewidth=0)
    ax.axvline(difference.other / factor, color=palette.ink, linewidth=1.5)
    for n, (name, value) in enumerate(rows):
        colour = palette.model if name == _DATA else palette.measured
        ax.plot([value / factor], [n], marker="o", markersize=8, color=colour, linestyle="none")
    ax.set_yticks(range(len(rows)), [name for name, _ in rows])
    x_label(ax, f"the line is the claim, {with_unit(difference.other, difference.unit)}", palette)
    return figure


def _bars(shares: tuple[tuple[JudgedCause, float], ...], name: Name, style: Style) -> Figure:
    palette = style.palette
    figure, ax = _rows(style, len(shares), f"Explained of the {parameter_in_words(name)}'s difference (%)")
    for n, (each, share) in enumerate(shares):
        ax.barh(n, share, height=0.5, color=palette.model if n == 0 else palette.measured)
        ax.annotate(
            f"{100 * each.probability:.0f} %",
            (max(share, 0.0), n),
            xytext=(5, 0),
            textcoords="offset points",
            va="center",
            color=palette.muted,
            fontsize=11,
            parse_math=False,
        )
    ax.axvline(100, color=palette.muted, linewidth=1.5, zorder=0)
    ax.set_yticks(range(len(shares)), [each.label for each, _ in shares])
    ax.set_xlim(
        min(0.0, *(1.1 * share for _, share in shares)), max(110.0, *(1.1 * share for _, share in shares))
    )
    x_label(ax, "after each bar: its probability", palette)
    return figure
