"""Models of recordings side by side: the figures, how far they lie apart, and what isn't identified yet."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

from tests.panel.test_page import Panel


@pytest.fixture
def panel(browser: Any, tab: Any, server: tuple[str, Any]) -> Iterator[Panel]:
    panel = Panel(browser, *server, tab=tab)
    panel.tab("Recordings")
    yield panel
    panel.leave()


# Whatever stands in the column from now on, however short.
_WATCH = """() => {
    const models = document.querySelector('.models');
    window.shown = [];
    new MutationObserver(() => window.shown.push(models.innerText)).observe(models, { childList: true, subtree: true });
}"""


def compare(panel: Panel, *names: str) -> None:
    for name in names:
        panel.page.get_by_label(f"Compare {name}").check()
    panel.page.get_by_role("columnheader", name=names[-1]).wait_for()


def row(panel: Panel, title: str) -> list[str]:
    """The cells of a row, each as its lines."""
    named = panel.page.locator(".models tbody tr").filter(has=panel.page.locator("th", has_text=title))
    return [each.replace("\n\n", "\n") for each in named.locator("td").all_inner_texts()]


def test_two_models_stand_side_by_side_with_how_far_they_lie_apart(panel: Panel) -> None:
    compare(panel, "square-1-3", "prbs-disc")

    # The difference over the square root of the sum of both variances: 0.06/0.05, 1.1/0.5, 25/5, 0.03/0.05.
    assert row(panel, "Gain") == ["22.040 ± 0.060", "22.100 ± 0.080\nagrees: 1.2 sd apart"]
    one_in = round(1 / math.erfc(2.2 / math.sqrt(2)))
    assert row(panel, "Time constant") == [
        "0.08980 ± 0.00060",
        f"0.09090 ± 0.00080\nmay differ: 2.2 sd apart, by chance in 1 of {one_in}",
    ]
    assert row(panel, "Coulomb voltage") == ["0.1200 ± 0.0060", "0.1450 ± 0.0080\ndiffers: 5.0 sd apart"]
    assert row(panel, "Delay") == ["0.500 ± 0.060", "0.530 ± 0.080\nagrees: 0.6 sd apart"]
    heads = panel.page.locator(".models tbody th").all_inner_texts()
    assert heads == ["Verdict", "Gain rad/(s·V)", "Time constant s", "Coulomb voltage V", "Delay ms"]
    assert [each.split("\n")[0] for each in row(panel, "Verdict")] == ["Trusted", "Doubtful"]
    told = panel.page.locator(".models .told li").all_inner_texts()
    assert told[0].startswith("prbs-disc differs from square-1-3 in coulomb voltage: that is no chance")
    assert told[1].startswith("prbs-disc is doubtful: its intervals may be too narrow")
    link = panel.page.get_by_role("link", name="Open the report of prbs-disc")
    assert link.first.get_attribute("href") == "/reports/prbs-disc"
    assert panel.complaints == []


def test_what_isnt_identified_says_so_and_can_be_from_there(panel: Panel) -> None:
    compare(panel, "square-1-3", "chirp-slow")
    assert row(panel, "Gain") == ["22.040 ± 0.060", "–"]
    assert "Not identified yet" in row(panel, "Verdict")[1]
    panel.bench.working = {"doing": "identifying", "step": 3, "of": 4, "seconds": 2.0, "left": None}
    button = panel.page.locator(".models").get_by_role("button", name="Identify chirp-slow")
    button.focus()
    panel.page.keyboard.press("Enter")
    panel.page.locator(".models").get_by_text("step 3 of 4: identifying").wait_for()
    assert button.get_attribute("aria-disabled") == "true"
    panel.page.evaluate(_WATCH)
    panel.bench.working = None
    panel.page.locator(".models").get_by_text("chirp-slow agrees with square-1-3").wait_for()
    shown = panel.page.evaluate("window.shown")
    assert shown
    assert not [each for each in shown if "Not identified yet" in each and "Identifying" not in each]
    panel.page.locator("#announcer").get_by_text("chirp-slow is identified").wait_for()
    # The button is gone; the focus is at what came in its place.
    assert panel.page.evaluate("document.activeElement.matches('.models .scroll')")


def test_a_recording_whose_columns_are_unknown_is_asked_about_first(panel: Panel) -> None:
    panel.bench.recordings["chirp-slow"] |= {"columns": "open", "verdict": ""}
    nothing = {"column": None, "unit": None}
    panel.bench.unclear = {
        "open": True,
        "columns": [{"name": "time", "first": [0.0, 5.0], "unit": None, "samples": 1000}],
        "own_times": False,
        "chain": "",
        **dict.fromkeys(("time", "input", "output"), nothing),
    }
    panel.page.reload()
    panel.tab("Recordings")
    compare(panel, "square-1-3", "chirp-slow")
    panel.tab("Exercises")
    panel.button("Choose the columns of chirp-slow").click()
    panel.page.get_by_role("form", name="Columns of chirp-slow").wait_for()
    panel.until(lambda: panel.page.evaluate("document.activeElement.closest('form.columns') !== null"))


def test_what_cannot_be_compared_says_so(panel: Panel) -> None:
    gain = {"value": 7000.0, "sd": 9.0, "interval": [6982.0, 7018.0], "level": 0.95, "unit": "counts/(s·V)"}
    untold = {"value": 1e9, "sd": None, "interval": [None, None], "level": 0.95, "unit": "s"}
    panel.bench.results["prbs-disc"] = {"parameters": {"gain": gain, "delay": untold}}
    panel.bench.recordings["chirp-slow"]["verdict"] = "refused"
    panel.bench.results["chirp-slow"] = {"verdict": "refused", "structure": None, "parameters": {}}
    panel.page.reload()
    panel.tab("Recordings")
    compare(panel, "square-1-3", "prbs-disc", "chirp-slow")

    apart = "7000 ± 18 counts/(s·V)\ncan't be held against rad/(s·V)"
    assert row(panel, "Gain") == ["22.040 ± 0.060 rad/(s·V)", apart, "–"]
    assert row(panel, "Time constant") == ["0.08980 ± 0.00060", "not in its model", "–"]
    assert row(panel, "Delay")[1] == "not determined by the data\nnothing to compare it with"
    assert row(panel, "Verdict")[2].startswith("Refused\nno model")
    said = panel.page.locator(".models .told li").first.inner_text()
    assert said == "prbs-disc and square-1-3 have no figure in common that could be compared."


def test_a_recording_that_cannot_be_read_is_named_and_the_others_are_drawn(panel: Panel) -> None:
    panel.bench.spoilt = {"chirp-slow"}
    compare(panel, "square-1-3", "chirp-slow", "prbs-disc")
    for title in ("Applied voltage", "Speed", "Position since the beginning"):
        panel.page.get_by_role("img", name=f"{title} of square-1-3 and prbs-disc over time").wait_for()
    panel.page.get_by_role("alert").get_by_text(
        "chirp-slow can't be drawn: chirp-slow isn't an MCAP file"
    ).wait_for()
    panel.until(lambda: row(panel, "Verdict")[1] == "Its file can't be read")
    assert panel.button("Identify chirp-slow").count() == 0
    # The third keeps the colour that it has in the table.
    assert panel.page.locator("#compare .keys .key-2").inner_text() == "prbs-disc"

    panel.bench.spoilt = set()  # put right: it is asked for again
    panel.page.get_by_label("Compare chirp-slow").uncheck()
    panel.page.get_by_label("Compare chirp-slow").check()
    panel.page.get_by_role("img", name="Speed of square-1-3, prbs-disc and chirp-slow over time").wait_for()
    panel.page.locator(".models").get_by_role("button", name="Identify chirp-slow").wait_for()


@pytest.mark.parametrize("size", [(1024, 768), (390, 844), (320, 640)])
def test_the_table_fits_or_is_moved_by_itself(
    browser: Any, server: tuple[str, Any], size: tuple[int, int]
) -> None:
    viewport = {"width": size[0], "height": size[1]}
    panel = Panel(browser, *server, viewport=viewport)
    panel.tab("Recordings")
    compare(panel, "square-1-3", "prbs-disc", "chirp-slow")
    wide = panel.page.evaluate("document.documentElement.scrollWidth")
    region = panel.page.get_by_role("region", name="Identified models").last
    region.focus()
    panel.page.keyboard.press("ArrowRight")
    moves, here = region.evaluate("(e) => [e.scrollWidth > e.clientWidth + 1, e.tabIndex]")
    if moves:
        panel.until(lambda: region.evaluate("(e) => e.scrollLeft") > 0)
    panel.context.close()
    assert wide <= size[0]
    assert here == 0


def test_chance_is_that_of_the_normal_distribution(panel: Panel) -> None:
    distances = [0.0, 0.3, 1.0, 2.0, 2.2, 2.99, 3.0, 5.0]
    found = panel.page.evaluate(
        "(all) => import('/static/difference.js').then((m) => all.map(m.byChance))", distances
    )
    # The approximation's own bound, Abramowitz and Stegun 7.1.26.
    assert found == pytest.approx([math.erfc(z / math.sqrt(2)) for z in distances], abs=1.5e-7, rel=0)


def test_an_interval_that_lies_askew_is_reported_by_its_ends(panel: Panel) -> None:
    def told(value: float, low: float, high: float) -> Any:
        given = f"{{value: {value}, sd: 1, interval: [{low}, {high}], unit: 'V'}}"
        return panel.page.evaluate(f"import('/static/models.js').then((m) => m.withInterval({given}))")

    assert told(5.0, 4.0, 6.0) == "5.0 ± 1.0"
    assert told(5.0, 4.9, 6.1) == "5.00 (4.90 to 6.10)"
    assert re.fullmatch(r"−5\.0 ± 1\.0", told(-5.0, -6.0, -4.0))
