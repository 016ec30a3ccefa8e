import re
from io import StringIO
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from servobench.core.palette import LIGHT
from servobench.report.palette import Style, axes, plain_ticks, sheet, whole
from servobench.report.ticks import take_ticks

STYLE = Style(width=500)
WHOLE = whole(STYLE, 200)


def linear(ax: Any) -> None:
    ax.set(xlim=(-0.3, 0.7), ylim=(2.0, -1.0))


def logarithmic(ax: Any) -> None:
    ax.set(xscale="log", yscale="log", xlim=(0.1, 1000), ylim=(3, 4000))
    ax.minorticks_off()
    plain_ticks(ax)


def equal(ax: Any) -> None:
    ax.plot([0, 4], [0, 1])
    ax.set_aspect("equal", adjustable="datalim")


def named(ax: Any) -> None:
    ax.set_yticks([0, 1, 5], ["<a>", "b & c", "outside"])
    ax.set_ylim(-0.5, 1.5)
    ax.tick_params(axis="x", labelbottom=False)


SCALES = [linear, logarithmic, equal, named]


def made(scale: Any) -> Any:
    """A figure with one pair of axes on such a scale, and with rules for both."""
    figure = sheet(STYLE, 200)
    ax = axes(figure, WHOLE, LIGHT, "")
    ax.grid(True, axis="x")
    scale(ax)
    return figure


def texts(svg: ElementTree.Element) -> list[tuple[str, float, float]]:
    places = [(element.text or "", element) for element in svg.iter() if element.tag.endswith("text")]
    return sorted((text, float(each.get("x", 0)), float(each.get("y", 0))) for text, each in places if text)


@pytest.mark.parametrize("scale", SCALES)
def test_labels_stand_where_matplotlib_would_write_them(scale: Any) -> None:
    import matplotlib

    out = StringIO()
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        made(scale).savefig(out, format="svg")
    theirs = texts(ElementTree.fromstring(out.getvalue()))
    ours = texts(ElementTree.fromstring(f"<svg>{take_ticks(made(scale))}</svg>"))

    assert [text for text, *_ in ours] == [text for text, *_ in theirs]
    # A twentieth of a pixel: the ascent is that of Matplotlib's font to three digits, 0.5 % of 11 px.
    assert np.allclose([place for _, *place in ours], [place for _, *place in theirs], atol=0.05)


def test_each_label_has_a_rule_and_on_the_horizontal_axis_a_mark() -> None:
    svg = ElementTree.fromstring(f"<svg>{take_ticks(made(linear))}</svg>")
    x, y = (group for group in svg.iter("g"))
    strokes = [re.findall("M", path.get("d", "")) for path in svg.iter("path")]

    assert [len(each) for each in strokes] == [len(x), len(x), len(y)]


def test_ticks_are_taken_once() -> None:
    figure = made(linear)

    assert take_ticks(figure)
    assert take_ticks(figure) == ""
