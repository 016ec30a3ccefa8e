"""Signals that are made of signals, as forms: what is made by hand and by keyboard is what the loop gets."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

from servobench.panel.catalogue import catalogue
from servobench.systems.signals.base import SIGNALS
from servobench.systems.signals.sequence import Sequence
from tests.panel.test_page import Panel


@pytest.fixture
def panel(browser: Any, tab: Any, server: tuple[str, Any]) -> Iterator[Panel]:
    panel = Panel(browser, *server, tab=tab)
    yield panel
    panel.leave()


def tables_in(value: Any) -> bool:
    """Whether a value holds a table with a type, however deep."""
    if isinstance(value, dict):
        return "type" in value or any(map(tables_in, value.values()))
    return isinstance(value, list) and any(map(tables_in, value))


def test_every_setting_that_holds_signals_tells_of_its_parts() -> None:
    fields = {(s["name"], f["name"]): f for s in catalogue()["signals"] for f in s["fields"]}
    told = {
        key: (f["parts"]["each"], f["parts"]["signal"], [own["name"] for own in f["parts"]["fields"]])
        for key, f in fields.items()
        if f["parts"]
    }

    assert set(told) == {key for key, f in fields.items() if tables_in(f["default"])}
    assert told["sum", "parts"] == ("part", None, [])
    assert told["sequence", "segments"] == ("segment", "signal", ["duration"])
    assert fields["sequence", "segments"]["parts"]["fields"][0]["unit"] == "s"


def choose(panel: Panel, kind: str) -> None:
    panel.page.get_by_label("Kind of signal").select_option(kind)


def part(panel: Panel, name: str) -> Any:
    return panel.page.get_by_role("group", name=name, exact=True)


def fill(within: Any, **values: str) -> None:
    for name, value in values.items():
        within.get_by_role("spinbutton", name=name).first.fill(value)


def applied(panel: Panel) -> dict[str, Any]:
    """The signal that was sent, once it is applied."""
    panel.button("Apply signal").click()
    panel.page.locator("#signal-status").get_by_text("Applied at").wait_for()
    sent: dict[str, Any] = [each for each in panel.bench.received if "signal" in each][-1]["signal"]
    return sent


def kinds(panel: Panel) -> list[str]:
    return [str(each.input_value()) for each in panel.page.locator("#signal .part select").all()]


def focused(panel: Panel) -> str:
    said = "document.activeElement.ariaLabel ?? document.activeElement.labels?.[0]?.textContent"
    return str(panel.page.evaluate(said))


def test_a_sequence_that_is_made_by_hand_is_the_one_that_the_loop_gets(panel: Panel) -> None:
    choose(panel, "sequence")
    first, second = part(panel, "Segment 1 of 2"), part(panel, "Segment 2 of 2")
    fill(first, Duration="0.5", Final="2")
    second.get_by_label("Kind").select_option("sine")
    fill(second, Duration="2", Amplitude="3", Offset="1")
    panel.button("Add a segment").click()
    third = part(panel, "Segment 3 of 3")
    third.get_by_label("Kind").select_option("constant")
    fill(third, Duration="1", Value="-1")
    panel.page.locator("#signal figcaption").get_by_text("−2.00 to 4.00 V over 3.64 s").wait_for()
    sent = applied(panel)

    wanted = Sequence(
        segments=[
            {"duration": 0.5, "signal": {"type": "step", "final": 2}},
            {"duration": 2, "signal": {"type": "sine", "amplitude": 3, "offset": 1}},
            {"duration": 1, "signal": {"type": "constant", "value": -1}},
        ]
    )
    t = np.arange(0, 4, 0.01)
    np.testing.assert_array_equal(panel.bench.motor.signal(t), wanted(t))
    assert SIGNALS[sent.pop("type")](**sent) == wanted
    assert panel.complaints == []


def test_parts_are_put_in_order_by_keyboard_and_the_focus_stays_with_them(panel: Panel) -> None:
    choose(panel, "sum")
    assert kinds(panel) == ["square", "sine"]
    press = panel.page.keyboard.press
    panel.button("Add a part").focus()
    press("Enter")
    assert (kinds(panel), focused(panel)) == (["square", "sine", "square"], "Kind")
    fill(part(panel, "Part 3 of 3"), High="7")

    panel.button("Move part 3 up").focus()
    press("Enter")
    panel.page.locator("#announcer").get_by_text("Part 3 is part 2 of 3 now").wait_for()
    assert (kinds(panel), focused(panel)) == (["square", "square", "sine"], "Move part 2 up")
    press("Space")
    assert focused(panel) == "Move part 1 up"
    press("Space")  # it is at the top: nothing happens, and the focus isn't lost
    assert focused(panel) == "Move part 1 up"
    assert panel.button("Move part 1 up").get_attribute("aria-disabled") == "true"
    assert part(panel, "Part 1 of 3").get_by_role("spinbutton", name="High").input_value() == "7"

    press("Tab")
    press("Enter")
    assert focused(panel) == "Move part 2 down"
    press("Tab")
    press("Enter")
    assert (kinds(panel), focused(panel)) == (["square", "sine"], "Remove part 2")
    press("Enter")
    assert (kinds(panel), focused(panel)) == (["square"], "Remove part 1")
    press("Enter")  # one has to stay
    assert kinds(panel) == ["square"]
    assert panel.button("Remove part 1").get_attribute("title") == "There has to be one part at least."
    panel.page.locator("#signal-status").get_by_text("Not sent").wait_for()


def test_a_sum_within_a_sequence_is_a_form_and_what_is_deeper_a_text(panel: Panel) -> None:
    choose(panel, "sequence")
    outer = part(panel, "Segment 1 of 2")
    outer.get_by_label("Kind").select_option("sum")
    inner = outer.get_by_role("group", name="Part 1 of 2")
    inner.get_by_label("Kind").select_option("sum")
    text = inner.get_by_role("textbox", name="Parts")
    text.fill('[{"type": "constant", "value": 0.25},\n {"type": "ramp"}]')
    sent = applied(panel)

    deep = sent["segments"][0]["signal"]["parts"][0]["parts"]
    assert deep == [{"type": "constant", "value": 0.25}, {"type": "ramp"}]
    text.focus()
    inner.get_by_text("So deep within others they are written as a file has them.").wait_for()
    text.fill('[{"type": "square"},\n {"type": "sine",}]')
    wrong(panel, "Segment 1: Part 1: Parts: a comma")
    wrong(panel, "in line 2")
    text.fill("  ")
    wrong(panel, "Segment 1: Part 1: Parts: nothing is filled in")
    text.fill("null")
    wrong(panel, "Segment 1: Part 1: parts isn't given; expected: an array")
    text.fill("[1]")
    wrong(panel, "Segment 1: Part 1: Part 1: 1 isn't a signal")


def wrong(panel: Panel, text: str) -> None:
    panel.page.locator("#signal .trouble").get_by_text(text).wait_for()


def test_a_mistake_in_a_part_is_reported_by_the_parts_number(panel: Panel) -> None:
    choose(panel, "sequence")
    fill(part(panel, "Segment 2 of 2"), Duration="")
    wrong(panel, "Segment 2: Duration: nothing is filled in")
    fill(part(panel, "Segment 2 of 2"), Duration="-1")
    wrong(panel, "Segment 2: duration is -1; expected: greater than 0")
    fill(part(panel, "Segment 2 of 2"), Duration="1", High="-9")
    wrong(panel, "Segment 2: ")
    wrong(panel, "is below low")


def test_parts_are_in_the_unit_of_what_follows_the_signal(panel: Panel) -> None:
    choose(panel, "sequence")
    segment = part(panel, "Segment 1 of 2")
    segment.get_by_role("spinbutton", name="Final in V").wait_for()
    segment.get_by_role("spinbutton", name="Duration in s").wait_for()
    panel.bench.controller = {"type": "pid", "output": "position"}
    segment.get_by_role("spinbutton", name="Final in rad", exact=True).wait_for()
    panel.button("Add a segment").click()
    added = part(panel, "Segment 3 of 3")
    added.get_by_role("spinbutton", name="Final in rad", exact=True).wait_for()


def test_a_sequence_that_the_loop_has_is_shown_in_its_parts(panel: Panel) -> None:
    segments = [
        {"duration": 3.0, "signal": {"type": "constant", "value": 2.0}},
        {"duration": 4.5, "signal": {"type": "sum", "parts": [{"type": "sine", "amplitude": 1.5}]}},
    ]
    panel.bench.signal = {"type": "sequence", "segments": segments, "start": 1.0}
    second = part(panel, "Segment 2 of 2")
    second.get_by_role("group", name="Part 1 of 1").wait_for()
    assert second.get_by_role("spinbutton", name="Duration").input_value() == "4.5"
    assert second.get_by_role("spinbutton", name="Amplitude").input_value() == "1.5"
    panel.page.locator("#signal figcaption").get_by_text("over 8.80 s").wait_for()
    panel.button("Remove segment 1").click()
    panel.button("Back").click()  # to what the loop has
    panel.until(lambda: kinds(panel) == ["constant", "sum", "sine"])


@pytest.mark.parametrize("size", [(1440, 900), (1024, 768), (390, 844), (320, 640)])
def test_parts_within_parts_fit_into_the_column(
    browser: Any, server: tuple[str, Any], size: tuple[int, int]
) -> None:
    viewport = {"width": size[0], "height": size[1]}
    panel = Panel(browser, *server, viewport=viewport)
    choose(panel, "sequence")
    part(panel, "Segment 1 of 2").get_by_label("Kind").select_option("sum")
    wide, entries = panel.page.evaluate(
        """() => {
            const form = document.getElementById("signal").getBoundingClientRect();
            const all = [...document.querySelectorAll("#signal :is(input, select, button)")];
            const entries = all.filter((each) => each.checkVisibility());
            return [document.documentElement.scrollWidth, entries.map((entry) => {
                const { left, right, width, height } = entry.getBoundingClientRect();
                return [entry.id, entry.tagName, left - form.left, form.right - right, width, height];
            })];
        }"""
    )
    panel.context.close()
    assert wide <= size[0]
    for name, tag, left, right, width, height in entries:
        assert min(left, right) >= -0.5, name
        assert min(width, height) >= 24, name  # a target's least size, WCAG 2.2 (2.5.8)
        assert tag != "INPUT" or width >= 88, name  # three digits before the unit
