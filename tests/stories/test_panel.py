"""The story of somebody who sees the panel for the first time: real program, real loop, simulated motor, real browser.

SERVOBENCH_SCREENSHOTS=docs makes the pictures of the documentation in that folder, with a recording of 10 s.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

from servobench.recordings.native.reader import read
from tests.panel.test_page_access import findings
from tests.stories.program import Page, Program, running, truth_of_the_twin

PICTURES = os.environ.get("SERVOBENCH_SCREENSHOTS")
SECONDS = 10 if PICTURES else 5
TRUTH = truth_of_the_twin()


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Program]:
    with running(tmp_path_factory.mktemp("story")) as found:
        yield found


def picture(page: Page, name: str) -> None:
    if PICTURES:
        page.page.evaluate("document.activeElement.blur()")
        page.page.screenshot(path=Path(PICTURES) / name, animations="disabled")


def choose_square_wave(page: Page) -> None:
    page.page.get_by_label("Kind of signal").select_option("square")
    for name, value in (("Low", "1"), ("High", "3"), ("Frequency", "0.4")):
        page.page.get_by_role("spinbutton", name=name).fill(value)
    page.apply("Apply signal", "#signal-status")


def painted(page: Page, scope: str, trace: str) -> float:
    """Over what part of a scope's height its canvas has a trace's colour: what is on the screen, whatever the program thinks."""
    return float(
        page.scope(scope).evaluate(
            """(scope, token) => {
                const colour = getComputedStyle(document.documentElement).getPropertyValue(token).trim();
                const wanted = [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16));
                const canvas = scope.querySelector("canvas");
                const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
                let [first, last] = [Infinity, -Infinity];
                for (let k = 0; k < data.length; k += 4) {
                    if (data[k + 3] < 200 || wanted.some((value, c) => Math.abs(data[k + c] - value) > 12)) continue;
                    const row = Math.floor(k / 4 / canvas.width);
                    [first, last] = [Math.min(first, row), Math.max(last, row)];
                }
                return (last - first) / canvas.height;
            }""",
            f"--trace-{trace}",
        )
    )


def record(page: Page, name: str, length: str) -> None:
    if page.driving:  # a busy computer may have stopped the motor since it was started
        page.until(lambda: page.text("#run-text") == "Driving")
    page.page.get_by_label("Name of the recording").fill(name)
    page.page.get_by_label("Length").select_option(length)
    page.button("Record").click()
    page.page.locator("#record-text").get_by_text("End").wait_for()


def rows(program: Program, name: str, channel: str) -> np.ndarray:
    (recording,) = read(program.folder / name / "recording.mcap")
    return np.asarray(recording[channel].values)


def shown_result(page: Page) -> dict[str, tuple[float, float, float]]:
    """The parameters that are shown: value, and the ends of the interval."""
    found = {}
    for line in page.page.locator(".result .values li").all():
        name = line.locator(".name").inner_text().lower()
        value = line.locator("strong").inner_text()
        low, _, high = line.locator(".interval").inner_text().partition(" to ")
        found[name] = tuple(float(each.replace("−", "-")) for each in (value, low, high))
    return found


def test_a_newcomer_drives_records_identifies_and_stops(browser: Any, program: Program) -> None:
    with Page(browser, program.address) as page:
        page.drive()
        choose_square_wave(page)
        page.start()

        sees_the_speed(page)
        moves_the_cutoff(page)
        record(page, "first", str(SECONDS))
        page.page.locator("#toast").get_by_text("Recorded first").wait_for()
        identifies(page, program)
        opens_the_report(page)
        compares_with_a_second_one(page, program)
        stops_by_escape(page, program)

        assert page.complaints == []


def sees_the_speed(page: Page) -> None:
    """The filtered speed goes to gain times what friction leaves of 1 V and of 3 V, by number and on the canvas."""
    slow, fast = (TRUTH.gain * (u - TRUTH.coulomb_voltage) for u in (1.0, 3.0))
    # A count in a tick is 1.5 rad/s, of which the filter of 50 rad/s leaves less than one.
    page.until(lambda: abs(page.reading("Speed", "Filtered") - fast) < 1.0)
    page.until(lambda: abs(page.reading("Speed", "Filtered") - slow) < 1.0)
    seen = page.readings("Speed", "Filtered", 2.5)
    assert max(seen) > 0.9 * fast
    assert min(seen) < slow + 0.1 * fast
    assert max(page.readings("Voltage", "Applied", 2.6)) == 3.0
    assert painted(page, "Speed", "speed") > 0.3
    assert painted(page, "Voltage", "applied") > 0.3


def moves_the_cutoff(page: Page) -> None:
    slider = page.page.get_by_role("slider", name="Cut-off")
    slider.focus()
    for _ in range(5):
        page.page.keyboard.press("ArrowRight")
    page.until(lambda: page.text("#cutoff-status").startswith("Applied at "))
    assert page.text("#cutoff-value").startswith("55 rad/s")
    page.tab("Block diagram")
    page.page.locator("#diagram").get_by_text(re.compile("55")).first.wait_for()  # it draws what the loop has
    picture(page, "panel-diagram.png")
    page.tab("Scopes")


def identifies(page: Page, program: Program) -> None:
    """Gain and time constant are those of the simulated motor, as far as the intervals can tell."""
    times = rows(program, "first", "scheduled")
    assert times[-1] - times[0] > 0.99 * SECONDS  # a busy machine may miss the last ticks of it
    page.tab("Recordings")
    page.button("first").click()
    page.button("Identify").click()
    page.page.get_by_role("link", name="Open the report of first").wait_for(
        timeout=300_000
    )  # the server's own patience
    found = shown_result(page)
    for name in ("gain", "time constant"):
        value, low, high = found[name]
        truth = getattr(TRUTH, name.replace(" ", "_"))
        # Three times a 95 % interval is 5.9 sd, and four digits are shown; what the host's clock does differs from run to run.
        assert abs(value - truth) < 3 * (high - low) / 2 + 1e-3 * truth, (name, value, truth)
        assert (high - low) / 2 < 0.05 * truth, name
    picture(page, "panel.png")


def opens_the_report(page: Page) -> None:
    with page.context.expect_page() as opened:
        page.page.get_by_role("link", name="Open the report of first").click()
    report = opened.value
    report.wait_for_load_state()
    assert "time constant" in report.locator("body").inner_text().lower()
    assert report.locator("svg").count() > 0
    report.close()


def compares_with_a_second_one(page: Page, program: Program) -> None:
    """The page's statement on the difference is that of the results on the disk."""
    record(page, "second", "5")
    page.page.locator("#toast").get_by_text("Recorded second").wait_for()
    page.page.get_by_label("Compare first").check()
    page.page.get_by_label("Compare second").check()
    models = page.page.locator(".models")
    models.get_by_role("button", name="Identify second").click()
    models.get_by_role("link", name="Open the report of second").wait_for(timeout=300_000)
    gain = models.locator("tbody tr").filter(has_text="Gain").locator("td")
    said = gain.nth(1).inner_text()
    picture(page, "panel-compare.png")

    first, second = (
        json.loads((program.folder / name / "result.json").read_text()) for name in ("first", "second")
    )
    a, b = (each["parameters"]["gain"] for each in (first, second))
    apart = abs(a["value"] - b["value"]) / np.hypot(a["sd"], b["sd"])
    assert ("more than 10 sd apart" if apart > 10 else f"{apart:.1f} sd apart") in said
    shown, _, half = gain.nth(0).inner_text().partition(" ± ")
    low, high = a["interval"]
    assert abs(float(shown) - a["value"]) < 0.1 * float(half)
    assert abs(float(half) - (high - low) / 2) < 0.1 * float(half)  # two digits of it
    page.tab("Scopes")


def stops_by_escape(page: Page, program: Program) -> None:
    """From the row on that has Escape's command in force there are zero volts, and the shaft comes to rest, by the file.

    A recording in which a busy computer was the one that stopped the motor doesn't tell of Escape: then it is made again.
    """
    name, held_up = "", -1
    while held_up != len(page.held_up):
        held_up = len(page.held_up)
        name = f"stopped-{held_up}"
        record_while_escape_is_pressed(page, name)
        if held_up != len(page.held_up):
            page.start()

    assert not page.page.locator("#stop-told").is_visible()  # the loop has acknowledged it
    voltage, counts = rows(program, name, "applied"), rows(program, name, "counts")
    driven = np.flatnonzero(voltage)
    after = driven[-1] + 1
    # It goes from 1 V or 3 V to none in one tick, not by the controller's fade, which is slower than 1 % in a tick.
    assert voltage[after - 1] > 0.9
    assert len(driven) == after > 100
    assert len(counts) - after > 500
    # Friction stops a shaft of 24·3 rad/s after τ ln(1 + 3/V_c), 0.16 s; of at least 1 s after that the last half is looked at.
    assert np.ptp(counts[-250:]) == 0
    assert np.ptp(counts[:after]) > 100


def record_while_escape_is_pressed(page: Page, name: str) -> None:
    page.until(lambda: page.text("#run-text") == "Driving")
    record(page, name, "")
    held_up = len(page.held_up)
    page.until(lambda: page.text("#record-time") >= "0:01" or held_up != len(page.held_up))
    page.driving = False
    page.page.keyboard.press("Escape")
    page.until(lambda: page.text("#run-text") == "Zero volts")
    page.page.wait_for_timeout(2000)
    page.see_to_a_busy_computer()
    if held_up == len(page.held_up):  # a fault ends the recording, too
        page.button(re.compile("^End")).click()
        page.page.locator("#toast").get_by_text(f"Recorded {name}").wait_for()


THEMES = {
    "light": {"color_scheme": "light"},
    "dark": {"color_scheme": "dark"},
    "dark, chosen on a light system": {"color_scheme": "light"},
}


@pytest.fixture(scope="module")
def reported(browser: Any, program: Program) -> Program:
    """The panel with a recording that has a report: the one of the story, or, where that isn't reported now, another one."""
    if not (program.folder / "first" / "report.html").exists():
        with Page(browser, program.address) as page:
            page.drive()
            page.start()
            record(page, "first", "5")
            page.page.locator("#toast").get_by_text("Recorded first").wait_for()
            page.tab("Recordings")
            page.button("first").click()
            page.button("Identify").click()
            page.page.get_by_role("link", name="Open the report of first").wait_for(timeout=300_000)
    return program


@pytest.mark.parametrize(
    "theme",
    [
        pytest.param(each, marks=[pytest.mark.long] if each == "dark" else []) for each in THEMES
    ],  # chosen or not, it is the same
)
def test_axe_finds_nothing_grave_on_any_page_and_tab(browser: Any, reported: Program, theme: str) -> None:
    pytest.importorskip("axe_playwright_python", reason="a browser is absent: no axe_playwright_python")
    # axe itself is given to the page, which the page's own policy would forbid.
    with Page(browser, reported.address, bypass_csp=True, reduced_motion="reduce", **THEMES[theme]) as page:
        page.drive()
        if theme not in ("light", "dark"):
            page.button(re.compile("^Theme")).click()
        page.until(
            lambda: (
                page.page.evaluate("getComputedStyle(document.documentElement).colorScheme")
                == theme.split(",")[0]
            )
        )
        page.start()
        seen = {"scopes": findings(page.page)}
        page.tab("Block diagram")
        page.page.locator("#diagram [aria-pressed]").first.click()
        seen["block diagram"] = findings(page.page)
        page.tab("Exercises")
        page.page.get_by_role("button", name=re.compile("^The step response")).click()
        page.page.get_by_role("form", name="Answers").get_by_role("textbox").first.fill("1")
        page.button("Check the answers").click()
        page.page.locator("[data-right]").first.wait_for()
        seen["exercise"] = findings(page.page)
        page.tab("Recordings")
        page.button("first").click()
        page.page.get_by_label("Compare first").check()
        page.page.get_by_role("img", name="Speed of first over time").wait_for()
        seen["recordings"] = findings(page.page)
        page.tab("Block diagram")
        page.page.goto(f"{reported.base}/reports/first")
        seen["report"] = findings(page.page)
    assert seen == {name: [] for name in seen}
