import re
from xml.etree import ElementTree

import numpy as np
import pytest

from servobench.core.palette import LIGHT
from servobench.identification.uncertainty.bands import FrequencyBand, PoleBand, StepBand
from servobench.report import figures
from servobench.report.figures import Course, Curve, Difference, Panel
from servobench.report.model_figures import bode, pole_map, step
from servobench.report.palette import Style
from servobench.report.svg import PLACEHOLDERS, inline_svg
from tests.report.conftest import HOSTILE

T = np.linspace(0, 1, 100)
STYLES = [Style(width=720, palette=PLACEHOLDERS), Style(width=344, palette=PLACEHOLDERS)]
COURSE = Course(
    panels=(
        Panel(title="Input", unit="V", curves=(Curve(t=T, y=np.sign(T - 0.5), look="input"),)),
        Panel(
            title=HOSTILE.strip("\n\udcff"),
            unit="$",
            curves=(Curve(t=T, y=T, look="residual", label="a<b"),),
            quantum=0.1,
        ),
    ),
    title="$x$ <i>",
)
FREQUENCY = FrequencyBand(omega=T + 1, magnitude=T + 1, phase=-T, magnitude_half=0.1 * T, phase_half=0.1 * T)
POLE = PoleBand(pole=complex(-1, 2), half=complex(0.1, 0.1))
DRAWN = {
    "course": lambda style: figures.time_courses([COURSE, COURSE, COURSE], style),
    "correlation": lambda style: figures.correlation(
        np.arange(1.0, 9.0), np.linspace(0.5, -0.5, 8), 0.1, style
    ),
    "distribution": lambda style: figures.distribution(np.arange(4.0), np.ones(3), None, "V", style),
    "differences": lambda style: figures.differences(
        [Difference(name="gain", percent=1.0, half=np.inf)], "it", style
    ),
    "bode": lambda style: bode(FREQUENCY, "rad/(s·V)", (1.2, 1.8), 1.5, style),
    "step": lambda style: step(StepBand(t=T, y=-T, half=np.full(100, np.nan)), "rad/s", (0.5, -0.5), style),
    "poles": lambda style: pole_map([POLE], 0j, style),
}


@pytest.mark.parametrize("style", STYLES, ids=["wide", "narrow"])
@pytest.mark.parametrize("draw", DRAWN.values(), ids=list(DRAWN))
def test_a_drawing_has_only_the_page_s_colours_fonts_and_ids(draw, style) -> None:  # type: ignore[no-untyped-def]
    svg = inline_svg(draw(style), name="it", title="A title", description="In words")

    ElementTree.fromstring(svg)  # well-formed
    tags = "".join(re.findall(r"<[^>]*>", svg))
    assert re.findall(r"#[0-9a-fA-F]{6}\b", tags) == []
    assert "font-family" not in tags
    assert all(name.startswith("it-") for name in re.findall(r'\bid="([^"]*)"', tags))
    referred = re.findall(r'url\(#([^)]*)\)|href="#([^"]*)"', tags)
    assert {a or b for a, b in referred} <= set(re.findall(r'\bid="([^"]*)"', tags))
    assert not re.search(r"https?:|<style|<script|<metadata|<image|xmlns", tags)


def test_text_in_a_drawing_is_text_and_no_mathematics_or_markup() -> None:
    svg = inline_svg(DRAWN["course"](STYLES[0]), name="it", title="t", description="d")

    texts = [element.text for element in ElementTree.fromstring(svg).iter("text")]
    assert "$x$ <i>" in texts
    assert any("<script>alert('x')</script> & $\\frac{1}{2}$ 中" in (text or "") for text in texts)
    assert "a<b" in texts


def test_the_same_figure_gives_the_same_bytes() -> None:
    first, second = (
        inline_svg(DRAWN["bode"](STYLES[0]), name="it", title="t", description="d") for _ in range(2)
    )

    assert first == second


def test_who_can_t_see_a_drawing_is_reported_its_title_and_description() -> None:
    svg = inline_svg(DRAWN["step"](STYLES[0]), name="it", title="A < B", description='"C" & D')

    root = ElementTree.fromstring(svg)
    assert root.get("role") == "img"
    labels = (root.get("aria-labelledby") or "").split()
    assert [root.find(f"*[@id='{label}']").text for label in labels] == ["A < B", '"C" & D']  # type: ignore[union-attr]


def test_drawing_leaves_matplotlib_s_settings_alone() -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    inline_svg(DRAWN["course"](Style(width=500, palette=LIGHT)), name="it", title="t", description="d")

    assert dict(matplotlib.rcParams) == before


def test_a_drawing_in_real_colours_stands_alone(tmp_path) -> None:  # type: ignore[no-untyped-def]
    DRAWN["poles"](Style()).savefig(tmp_path / "poles.png")

    assert (tmp_path / "poles.png").stat().st_size > 1000
