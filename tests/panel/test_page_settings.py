"""Settings on the page: the unit, the mistakes, and the consequences."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

from tests.panel.test_page import Panel


@pytest.fixture
def panel(browser: Any, tab: Any, server: tuple[str, Any]) -> Iterator[Panel]:
    panel = Panel(browser, *server, tab=tab)
    yield panel
    panel.leave()


def wrong(panel: Panel, text: str) -> None:
    panel.page.locator("#signal .trouble").get_by_text(text).wait_for()


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        ("High", "100", "clipped at the limit of 10 V"),
        ("Frequency", "5000", "faster than the sample time of 0.001 s"),
    ],
)
def test_a_signal_that_cannot_be_put_out_as_it_is_says_so_before_it_is_applied(
    panel: Panel, field: str, value: str, sentence: str
) -> None:
    panel.page.get_by_role("spinbutton", name=field).fill(value)
    panel.page.locator("#signal .doubts").get_by_text(sentence).wait_for()
    panel.button("Back").click()
    panel.until(lambda: panel.page.locator("#signal .doubts li").count() == 0)


def test_a_field_that_was_left_empty_is_not_filled_in_behind_its_back(panel: Panel) -> None:
    panel.page.get_by_role("spinbutton", name="High").fill("")
    wrong(panel, "High: nothing is filled in")
    panel.button("Apply signal").click()
    panel.page.wait_for_timeout(300)
    assert not [asked for asked in panel.bench.received if asked["do"] == "set"]


def test_what_was_typed_is_there_again_when_the_kind_is(panel: Panel) -> None:
    kind = panel.page.get_by_label("Kind of signal")
    kind.select_option("sine")
    panel.page.get_by_role("spinbutton", name="Amplitude").fill("7")
    kind.select_option("sequence")
    first = panel.page.get_by_role("group", name="Segment 1 of 2")
    first.get_by_label("Kind").select_option("sine")
    first.get_by_role("spinbutton", name="Amplitude").fill("5")
    first.get_by_label("Kind").select_option("ramp")
    kind.select_option("sine")
    assert panel.page.get_by_role("spinbutton", name="Amplitude").input_value() == "7"
    kind.select_option("sequence")
    first.get_by_label("Kind").select_option("sine")
    assert first.get_by_role("spinbutton", name="Amplitude").input_value() == "5"

    # What the loop has is shown whole, whatever was typed before.
    panel.button("Back").click()
    panel.bench.signal = {"type": "sine", "frequency": 2.0}
    panel.page.get_by_role("spinbutton", name="Frequency").wait_for()
    panel.until(lambda: panel.page.get_by_role("spinbutton", name="Amplitude").input_value() == "1")


def test_a_preview_is_never_that_of_another_signal(panel: Panel) -> None:
    caption, absent = panel.page.locator("#signal figcaption"), panel.page.locator("#signal .absent")
    line = panel.page.locator("#signal .preview path").last
    high = panel.page.get_by_role("spinbutton", name="High")
    high.fill("100")
    panel.page.locator("#signal .doubts").get_by_text("clipped at the limit of 10 V").wait_for()
    caption.get_by_text("1.0 to 100.0 V over").wait_for()
    assert line.get_attribute("d").startswith("M0.00 ")

    for mistake in ("", "-9"):  # the page finds one of them, and the server the other
        high.fill(mistake)
        absent.get_by_text("Not shown: the form has a mistake").wait_for()
        assert (caption.inner_text(), line.get_attribute("d")) == ("", "")
        assert panel.page.locator("#signal .doubts li").count() == 0
        assert absent.get_attribute("aria-live") == "polite"
        high.fill("2")
        caption.get_by_text("1.00 to 2.00 V over").wait_for()
        assert absent.inner_text() == ""


def test_what_is_drawn_is_dimmed_until_it_is_drawn_anew(panel: Panel) -> None:
    kept: list[Any] = []
    panel.page.locator("#signal figcaption").get_by_text("1.00 to 3.00 V").wait_for()
    panel.page.route("**/api/preview", lambda route: kept.append(route))
    panel.page.get_by_role("spinbutton", name="High").fill("2")
    panel.page.locator("#signal .preview.aged").wait_for()
    panel.until(lambda: len(kept) == 1)
    panel.page.get_by_role("spinbutton", name="High").fill("5")
    panel.until(lambda: len(kept) == 2)
    kept[1].continue_()
    panel.page.locator("#signal figcaption").get_by_text("1.00 to 5.00 V").wait_for()
    kept[0].continue_()  # the answer to what is over comes last
    panel.page.wait_for_timeout(300)
    panel.page.locator("#signal figcaption").get_by_text("1.00 to 5.00 V").wait_for()
    assert panel.page.locator("#signal .preview.aged").count() == 0


def test_what_is_wrong_with_a_number_is_said_with_the_number(panel: Panel) -> None:
    panel.page.get_by_role("spinbutton", name="Frequency").fill("-1")
    wrong(panel, "frequency is -1; expected: greater than 0")


def test_the_signal_is_in_the_unit_of_what_follows_it(panel: Panel) -> None:
    panel.page.get_by_role("spinbutton", name="High in V").wait_for()
    panel.bench.controller = {"type": "pid", "output": "position"}
    panel.page.get_by_role("spinbutton", name="High in rad", exact=True).wait_for()
    panel.page.locator("#signal figcaption").get_by_text("rad over").wait_for()
    panel.bench.controller = {"type": "pid", "output": "speed"}
    panel.page.get_by_role("spinbutton", name="High in rad/s").wait_for()
    panel.page.get_by_role("spinbutton", name="Frequency in Hz").wait_for()


def test_a_position_that_is_far_away_is_asked_about_before_the_motor_turns_back(panel: Panel) -> None:
    panel.bench.motor.state = (2800.0, 0.0, 0.0, 2800.0)
    panel.page.locator("#readings").get_by_text("2800").wait_for(state="attached")
    panel.page.get_by_label("Kind of controller").select_option("pid")
    question = panel.page.locator("#controller .question")

    panel.button("Apply controller").click()
    question.get_by_text("The shaft is at 2800 rad").wait_for()
    assert "turns, as fast as it can" in question.inner_text()
    panel.button("Cancel").last.click()
    assert panel.bench.controller == {"type": "open_loop"}

    panel.button("Apply controller").click()
    panel.button("Apply anyway").click()
    panel.until(lambda: panel.bench.controller["type"] == "pid")


def test_a_position_that_is_near_is_followed_without_a_question(panel: Panel) -> None:
    panel.page.get_by_label("Kind of controller").select_option("pid")
    panel.button("Apply controller").click()
    panel.until(lambda: panel.bench.controller["type"] == "pid")
    assert not panel.page.locator("#controller .question").is_visible()


def test_what_follows_the_motor_says_that_it_is_not_ready_yet(panel: Panel) -> None:
    panel.bench.compiling = True
    panel.page.reload()
    panel.page.get_by_text("Start the motor: gain and time constant").wait_for()
    panel.page.get_by_text("You drive").wait_for()
    panel.button("Start").click()
    panel.page.get_by_text("Preparing live identification").wait_for()
    panel.bench.compiling = False
    panel.page.get_by_text("Coulomb voltage").first.wait_for()
    assert not panel.page.get_by_text("Preparing").is_visible()


def test_sentences_stand_below_each_other_and_what_went_wrong_stays_until_it_is_closed(panel: Panel) -> None:
    panel.page.get_by_label("Name of the recording").fill("first run")
    panel.button("Record").click()
    panel.page.locator("#toast").get_by_text(
        "“first run”: a recording's name can't have a space in it"
    ).wait_for()
    panel.tab("Recordings")
    panel.button("square-1-3").click()
    panel.page.get_by_label("Notes on square-1-3").fill("with the disc")
    panel.page.get_by_label("Notes on square-1-3").blur()
    panel.page.locator("#toast").get_by_text("The note on square-1-3 is saved").wait_for()
    assert panel.page.locator("#toast .toast").count() == 2
    panel.button("Take first-run").click()
    assert panel.page.get_by_label("Name of the recording").input_value() == "first-run"
    panel.button("Record").click()
    panel.until(lambda: (panel.bench.recording or {}).get("name") == "first-run")


def test_a_fifth_recording_takes_a_place_and_says_whose(panel: Panel) -> None:
    panel.turn(500)
    one = panel.bench.recordings["square-1-3"]
    panel.bench.recordings |= {name: {**one, "name": name} for name in ("fourth", "fifth")}
    panel.page.reload()
    panel.tab("Recordings")
    for name in ("square-1-3", "prbs-disc", "chirp-slow", "fourth", "fifth"):
        panel.page.get_by_label(f"Compare {name}").check()
    panel.page.locator("#toast").get_by_text("Four at a time: square-1-3 made room for fifth").wait_for()


def test_a_device_offers_the_motors_that_are_known_and_sets_nothing_that_nobody_set(panel: Panel) -> None:
    panel.page.locator("#device").click()
    motor = panel.page.locator("#device-motor")
    assert motor.locator("option").all_inner_texts() == ["Qube servo 2", "Qube servo 3"]
    assert (
        panel.page.get_by_label("Resistance in ohm", exact=True).get_attribute("placeholder") == "data sheet"
    )
    motor.select_option("qube_servo_3")
    panel.button("Open").click()
    panel.until(lambda: panel.bench.device["settings"] == {"motor": "qube_servo_3"})


def test_on_a_phone_the_scopes_begin_in_the_upper_half_and_no_tool_is_cut_off(
    browser: Any, server: tuple[str, Any]
) -> None:
    phone = {"viewport": {"width": 390, "height": 844}, "has_touch": True}
    panel = Panel(browser, *server, **phone)
    assert panel.page.locator("#tools").bounding_box()["y"] < 844 / 2
    for tool in panel.page.locator("#tools :is(button, select)").all():
        box = tool.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= 390, tool.inner_text()
    assert not panel.page.locator("#stop kbd").is_visible()
    panel.context.close()
