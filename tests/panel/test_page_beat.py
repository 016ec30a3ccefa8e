"""The page's own beats, and the truth of what it shows of a start, a stop and a server that is gone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

from tests.panel.test_page import Panel

VISIBILITY = """(state) => {
    Object.defineProperty(document, "hidden", { configurable: true, get: () => state === "hidden" });
    document.dispatchEvent(new Event("visibilitychange"));
}"""


@pytest.fixture
def panel(browser: Any, tab: Any, server: tuple[str, Any]) -> Iterator[Panel]:
    panel = Panel(browser, *server, tab=tab)
    yield panel
    panel.leave()


def started(panel: Panel) -> None:
    panel.button("Start").click()
    panel.until(lambda: panel.page.locator("#run").inner_text().strip() == "Driving")


def test_the_beat_says_how_far_is_drawn(panel: Panel) -> None:
    started(panel)
    begun = len(panel.bench.signs)
    panel.until(lambda: len(panel.bench.signs) > begun + 5)

    rows = [each["row"] for each in panel.bench.signs[begun:]]
    assert rows == sorted(rows)
    assert panel.bench.motor.tick >= rows[-1] > 0


def test_where_drawing_fails_no_beat_says_that_it_went_well(panel: Panel) -> None:
    started(panel)
    panel.page.evaluate(
        "() => { CanvasRenderingContext2D.prototype.stroke = () => { throw new Error('no drawing'); }; }"
    )
    panel.page.wait_for_timeout(300)
    begun = len(panel.bench.signs)
    panel.page.wait_for_timeout(1000)

    assert len(panel.bench.signs) - begun <= 1


@pytest.mark.promise("S49")
def test_a_page_that_goes_out_of_sight_says_so_and_tells_why_the_motor_stands_when_it_is_back(
    panel: Panel,
) -> None:
    started(panel)
    panel.page.evaluate(VISIBILITY, "hidden")
    panel.until(lambda: {"do": "hidden"} in panel.bench.signs)
    panel.bench.stopped = "the driving page was hidden; the voltage is zero"
    panel.bench.motor.enabled = False
    panel.until(lambda: panel.page.locator("#run").inner_text().strip() == "Zero volts")
    panel.page.evaluate(VISIBILITY, "visible")

    panel.page.locator("#toast").get_by_text("The driving page was hidden").wait_for()
    assert "The driving page was hidden" in panel.page.locator("#start-status").inner_text()


@pytest.mark.promise("S47")
def test_what_is_started_is_the_signal_that_is_drawn(panel: Panel) -> None:
    panel.page.get_by_label("High").fill("2")
    started(panel)

    asked = [each for each in panel.bench.received if each["do"] in ("set", "start")]
    assert [each["do"] for each in asked] == ["set", "start"]
    assert asked[0]["signal"]["high"] == 2


@pytest.mark.promise("S47")
def test_a_signal_with_a_mistake_is_not_started(panel: Panel) -> None:
    panel.page.get_by_label("High").fill("")
    panel.button("Start").click()
    told = panel.page.locator("#start-status").get_by_text("The signal has a mistake")
    told.wait_for()

    assert not panel.bench.motor.enabled
    panel.page.wait_for_timeout(1500)  # several states later it is still there to be read
    assert told.count() == 1


def test_why_the_motor_was_stopped_is_taken_away_when_it_is_driven_again(panel: Panel) -> None:
    started(panel)
    panel.page.keyboard.press("Escape")
    told = panel.page.locator("#toast").get_by_text("STOP was pressed")
    told.wait_for()
    started(panel)

    panel.page.wait_for_timeout(300)  # it would be there for six seconds
    assert told.count() == 0


def test_a_page_that_the_server_does_not_know_any_more_says_how_to_go_on(panel: Panel) -> None:
    panel.page.route("**/api/session", lambda route: route.fulfill(status=401, json={"error": "no session"}))
    panel.bench.drop_all()

    panel.page.locator("#link-told").get_by_text("open the address printed in its terminal").wait_for()
    panel.page.unroute("**/api/session")
    panel.until(lambda: not panel.page.locator("#link-told").is_visible())
