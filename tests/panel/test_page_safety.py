"""The page's statements on the motor are true, or it says that it doesn't know; a STOP that nobody heard is reported."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.panel.browser import served

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

from tests.panel.fake import app
from tests.panel.test_page import Panel


@pytest.fixture
def panel(browser: Any, tab: Any, server: tuple[str, Any]) -> Iterator[Panel]:
    panel = Panel(browser, *server, tab=tab)
    yield panel
    panel.leave()


@pytest.fixture
def driving(panel: Panel) -> Panel:
    panel.button("Start").click()
    panel.until(lambda: said(panel, "#run") == "Driving" and "V" in reading(panel))
    return panel


def said(panel: Panel, place: str) -> str:
    return str(panel.page.locator(place).inner_text()).strip()


def reading(panel: Panel) -> str:
    """The newest voltage, as the readings for screen readers have it: with its unit, or that it isn't known."""
    return str(panel.page.locator("#readings dd").first.text_content())


def knows_nothing(panel: Panel) -> None:
    """The page no longer shows an earlier state as if it were the present one."""
    panel.until(lambda: said(panel, "#run") == "Unknown" and reading(panel) == "not known now")
    assert said(panel, "#start") == "Start"
    assert panel.page.locator("#start").is_disabled()
    for trace in panel.page.locator(".legend .reading:visible").all():
        assert trace.inner_text() == "–"
    for light in ("stall", "limits", "lateness"):
        assert "unknown" in said(panel, f"[data-light={light}]")


def test_stop_is_within_the_dialog_of_the_device(driving: Panel) -> None:
    driving.page.locator("#device").click()
    dialog = driving.page.get_by_role("dialog", name="Device")
    dialog.get_by_role("button", name="STOP").click()
    driving.until(lambda: not driving.bench.motor.enabled)
    assert not dialog.is_visible()
    driving.until(lambda: "STOP was pressed" in said(driving, "#start-status"))


def test_a_line_that_says_nothing_is_reported_and_nothing_is_shown_as_if_it_were_so_now(
    driving: Panel,
) -> None:
    driving.bench.silent = True
    knows_nothing(driving)
    assert "no data" in said(driving, "[data-light=link]") or "lost" in said(driving, "[data-light=link]")
    strip = driving.page.locator("#link-told")
    assert "the loop sets the voltage to zero within 2 s" in strip.inner_text()
    assert driving.page.locator("#old").is_visible()
    driving.bench.silent = False
    driving.until(lambda: "V" in reading(driving) and not strip.is_visible())
    driving.page.locator("#toast").get_by_text("Connected again after").wait_for()


def test_why_the_motor_stands_is_reported_when_the_connection_is_back(driving: Panel) -> None:
    driving.bench.drop_all()
    driving.until(lambda: not driving.bench.motor.enabled)
    driving.bench.stopped = "the operator's page is gone; the voltage is zero"
    driving.until(lambda: said(driving, "#start-status").startswith("The operator's page is gone"))
    assert said(driving, "#run") == "Zero volts"


def test_a_server_that_is_gone_leaves_nothing_that_looks_true(browser: Any) -> None:
    made = app()
    with served(made) as address:
        panel = Panel(browser, address, made.state.bench)
        panel.button("Start").click()
        panel.until(lambda: said(panel, "#run") == "Driving")
    knows_nothing(panel)
    assert "lost" in said(panel, "[data-light=link]")
    panel.context.close()


def test_a_device_that_was_closed_has_no_voltage_on_the_page(driving: Panel) -> None:
    driving.bench.fault = {"code": "missed-ticks", "sentence": "ticks were missed"}
    driving.bench.closed = "it was stopped"
    # On a busy machine the link may be silent for a moment, too, in which nothing is known.
    driving.until(lambda: reading(driving) == "not known now" and said(driving, "#run") == "Fault")


def test_a_stop_that_nobody_heard_is_reported_until_the_loop_has_acknowledged_one(driving: Panel) -> None:
    told = driving.page.locator("#stop-told")
    driving.bench.silent = True
    driving.page.locator("#stop").click()
    driving.until(told.is_visible)
    assert "the loop hasn't said that it stopped the motor" in told.inner_text()
    assert "cut its power" in told.inner_text()
    driving.bench.silent = False
    driving.page.get_by_text("You drive").wait_for()
    driving.page.keyboard.press("Escape")
    driving.until(lambda: not told.is_visible() and not driving.bench.motor.enabled)


def test_a_stop_that_the_loop_did_not_acknowledge_is_reported_though_the_server_answered(
    driving: Panel,
) -> None:
    driving.bench.deaf = True
    driving.page.locator("#stop").click()
    driving.until(driving.page.locator("#stop-told").is_visible)
    assert driving.bench.motor.enabled


def test_who_watches_is_not_reported_that_the_motor_stops_by_itself(
    driving: Panel, browser: Any, server: tuple[str, Any]
) -> None:
    second = Panel(browser, *server)
    second.page.get_by_text("You watch").wait_for()
    driving.bench.silent = True
    strip = second.page.locator("#link-told")
    second.until(strip.is_visible)
    assert "Another page drives the motor" in strip.inner_text()
    second.context.close()


def test_without_a_connection_nothing_is_said_to_hold(driving: Panel) -> None:
    driving.button("Apply signal").click()
    driving.until(lambda: said(driving, "#signal-status").startswith("Applied"))
    driving.bench.silent = True
    knows_nothing(driving)
    chips = ("#signal-status", "#controller-status", "#cutoff-status")
    assert [said(driving, each) for each in chips] == ["Not known now"] * 3
    driving.bench.silent = False
    driving.until(lambda: [said(driving, each) for each in chips] == ["Applied"] * 3)


def test_a_start_that_waits_for_a_signal_that_nobody_answers_says_so(panel: Panel) -> None:
    panel.page.get_by_role("spinbutton", name="Low").fill("2")
    panel.bench.deaf_to_settings = True
    panel.button("Start").click()
    panel.until(lambda: "No answer in 5 s" in said(panel, "#start-status"))
    assert "Refused" not in said(panel, "#start-status")
    assert "No answer in 5 s" in said(panel, "#signal-status")
    assert not panel.bench.motor.enabled


def test_where_the_device_was_silent_the_page_promises_nothing_once_the_panel_is_gone(driving: Panel) -> None:
    warning = (
        "NO ANSWER FROM THE DEVICE FOR 0.8 S TO A READ; ZERO VOLTS WERE NOT CONFIRMED; SWITCH OFF THE SUPPLY"
    )
    driving.bench.fault = {"code": "switch-off", "sentence": warning}
    driving.until(lambda: said(driving, "#run") == "Fault")
    driving.bench.silent = True
    knows_nothing(driving)
    strip = said(driving, "#link-told")
    assert "by itself" not in strip
    assert warning in strip
