"""The page itself, in a browser, on the stand-in server: what it shows, sends and says."""

from __future__ import annotations

import csv
import io
import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

from servobench.systems.control.base import CONTROLLERS
from servobench.systems.signals.base import SIGNALS
from tests.panel.fake import LARGEST

WIDE = {"width": 1440, "height": 900}
PATIENCE = 120  # s; on a machine that is busy with other tests


class Panel:
    """One page on one bench; what it asked for and what it complained about is kept."""

    def __init__(self, browser: Any, address: str, bench: Any, *, tab: Any = None, **options: Any) -> None:
        """Open the page in a context of its own, or in a tab in which others were before."""
        self.bench = bench
        self.page = tab or browser.new_context(**{"viewport": WIDE, **options}).new_page()
        self.context = self.page.context
        self.page.set_default_timeout(1000 * PATIENCE)
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self._heard: dict[str, Callable[[Any], Any]] = {
            "console": lambda message: message.type == "error" and self.complaints.append(message.text),
            "pageerror": lambda error: self.complaints.append(str(error)),
            "request": lambda request: self.requests.append(request.url),
        }
        for event, hear in self._heard.items():
            self.page.on(event, hear)
        self.page.goto(address)
        self.page.wait_for_selector("body.ready")
        self.page.get_by_text("You ").first.wait_for()

    def leave(self) -> None:
        """Leave the tab to the next one as it was found."""
        for event, hear in self._heard.items():
            self.page.remove_listener(event, hear)
        self.page.unroute_all()
        self.page.evaluate("localStorage.clear()")
        self.page.goto("about:blank")
        self.context.clear_cookies()

    def button(self, name: str | re.Pattern[str]) -> Any:
        return self.page.get_by_role("button", name=name, exact=isinstance(name, str))

    def tab(self, name: str) -> None:
        """Choose a tab, once it stands still: where the page moves between press and release, neither hits the tab."""
        tab = self.page.get_by_role("tab", name=name)
        before = None
        while (place := tab.bounding_box()) != before:
            before = place
            self.page.wait_for_timeout(150)  # two frames of the stand-in
        tab.click()
        self.page.get_by_role("tab", name=name, selected=True).wait_for()

    def until(self, holds: Callable[[], bool]) -> None:
        """Wait until something holds; how long doesn't matter, but not for ever."""
        deadline = time.monotonic() + PATIENCE
        while not holds():
            assert time.monotonic() < deadline, "it never came to hold"
            self.page.wait_for_timeout(50)

    def turn(self, ticks: int) -> None:
        """Have the motor turn for so many ticks at once, and the page draw them."""
        last = self.bench.motor.tick + ticks
        self.bench.turn(ticks)
        self.until(lambda: any(sign.get("row", 0) >= last for sign in self.bench.signs[-1:]))

    def table(self) -> tuple[list[str], list[list[float]]]:
        """The visible part, as in its CSV."""
        with self.page.expect_download() as download:
            self.button("Save what is seen as CSV").click()
        head, *lines = csv.reader(io.StringIO(Path(download.value.path()).read_text("utf-8")))
        return head, [[float(each) for each in line] for line in lines]


@pytest.fixture
def panel(browser: Any, tab: Any, server: tuple[str, Any]) -> Iterator[Panel]:
    panel = Panel(browser, *server, tab=tab)
    yield panel
    panel.leave()


def test_it_begins_without_a_complaint_and_asks_nobody_else(panel: Panel, server: tuple[str, Any]) -> None:
    panel.button("Start").click()
    panel.until(lambda: panel.bench.motor.enabled)
    for tab in ("Recordings", "Compare", "Scopes", "Model"):
        panel.tab(tab)
    assert panel.complaints == []
    assert [
        url for url in panel.requests if not url.startswith((server[0], server[0].replace("http", "ws")))
    ] == []


def test_a_setting_is_applied_only_when_the_loop_has_said_so(panel: Panel) -> None:
    panel.bench.hold = True
    panel.page.get_by_role("spinbutton", name="Low").fill("2")
    chip = panel.page.locator("#signal-status")
    assert chip.inner_text() == "Not sent"
    panel.button("Apply signal").click()
    panel.until(lambda: panel.bench.signal["low"] == 2)  # the server has it, and its answer has gone out
    panel.page.wait_for_timeout(300)
    assert chip.inner_text() == "Pending"
    panel.bench.hold = False
    panel.until(lambda: chip.inner_text().startswith("Applied at "))


def test_a_refusal_is_shown_with_its_reason(panel: Panel) -> None:
    panel.bench.refuse = "the gains make the loop unstable"
    panel.page.get_by_label("Kind of controller").select_option("pid")
    panel.button("Apply controller").click()
    chip = panel.page.locator("#controller-status")
    panel.until(lambda: chip.inner_text() == "Refused: the gains make the loop unstable")


def test_enter_in_a_field_applies(panel: Panel) -> None:
    panel.page.get_by_role("spinbutton", name="High").fill("4")
    panel.page.keyboard.press("Enter")
    panel.until(lambda: panel.bench.signal.get("high") == 4)


def test_what_another_page_applied_is_shown_but_not_over_what_is_being_typed(panel: Panel) -> None:
    high, low = (panel.page.get_by_role("spinbutton", name=name) for name in ("High", "Low"))
    panel.bench.signal = {**panel.bench.signal, "high": 7.0}
    panel.until(lambda: high.input_value() == "7")
    low.fill("2.5")
    panel.bench.signal = {**panel.bench.signal, "high": 9.0}
    panel.bench.limits = [{"code": "saturated", "sentence": "A later state."}]
    panel.page.locator("[data-light=limits]").get_by_text("A later state").wait_for()
    assert (low.input_value(), high.input_value()) == ("2.5", "7")
    panel.button("Back").click()
    assert (low.input_value(), high.input_value()) == ("1", "9")


def test_escape_stops_wherever_one_is(panel: Panel) -> None:
    for where in ("#signal-low", "#cutoff", "#record-name", "body", "#device"):
        panel.button("Start").click()
        panel.until(lambda: panel.bench.motor.enabled)
        if where == "#device":
            panel.page.locator(where).click()  # its dialog takes Escape for itself, too
        elif where == "body":
            panel.page.evaluate("document.activeElement.blur()")
        else:
            panel.page.locator(where).focus()
        panel.page.keyboard.press("Escape")
        panel.until(lambda: not panel.bench.motor.enabled)


def test_who_watches_can_stop_and_nothing_else(panel: Panel, browser: Any, server: tuple[str, Any]) -> None:
    panel.button("Start").click()
    panel.until(lambda: panel.bench.motor.enabled)
    second = Panel(browser, *server)
    second.page.get_by_text("You watch").wait_for()
    second.until(lambda: second.page.locator("#start").is_disabled())
    for name in ("#signal-low", "#controller-type", "#cutoff", "#record", "#device"):
        assert second.page.locator(name).is_disabled(), name
    second.button("STOP").click()
    panel.until(lambda: not panel.bench.motor.enabled)
    second.context.close()


def test_a_fault_is_reported_with_its_reason_until_it_is_acknowledged(panel: Panel) -> None:
    panel.page.evaluate("fetch('/fake/fault', {method: 'POST'})")
    alert = panel.page.get_by_role("alert").filter(has_text="Fault")
    alert.wait_for()
    assert "the shaft stood still for 1 s at 6 V" in alert.inner_text()
    panel.until(lambda: "stood still" in panel.page.locator("[data-light=stall]").inner_text())
    panel.until(lambda: panel.page.locator("#start").is_disabled())
    panel.button("Acknowledge").click()
    panel.until(lambda: panel.bench.fault is None and not alert.is_visible())


def test_after_a_fault_of_the_computer_one_click_goes_on_and_after_one_of_the_motor_none_does(
    panel: Panel,
) -> None:
    go_on = panel.page.locator("#go-on")
    for code, offered in (("stall", False), ("ticks-missed", True)):
        panel.page.evaluate(f"fetch('/fake/fault?code={code}', {{method: 'POST'}})")
        panel.until(lambda: panel.page.locator("#acknowledge").is_visible())
        assert go_on.is_visible() == offered
        if not offered:
            panel.button("Acknowledge").click()
            panel.until(lambda: panel.bench.fault is None and not go_on.is_visible())
            assert not panel.bench.motor.enabled
    assert "ticks were missed" in panel.page.locator("#fault-text").inner_text()
    panel.button("Acknowledge and start").click()
    panel.until(lambda: panel.bench.fault is None and panel.bench.motor.enabled)
    panel.button("Halt").click()
    panel.until(lambda: not panel.bench.motor.enabled)


def test_a_limit_says_what_it_holds_back(panel: Panel) -> None:
    light = panel.page.locator("[data-light=limits]")
    panel.until(lambda: "within" in light.inner_text())
    panel.bench.limits = [{"code": "saturated", "sentence": "The voltage is held at 10 V."}]
    panel.until(lambda: "held at 10 V" in light.inner_text() and light.get_attribute("data-level") == "warn")


CONTROLS = (
    "#start",
    "#record",
    "#record-length",
    "#cutoff",
    "#device",
    "#signal fieldset",
    "#controller fieldset",
)


def test_a_device_that_is_being_opened_is_reported_and_everything_waits_with_the_reason(panel: Panel) -> None:
    panel.bench.opening = {"device": "twin", "doing": "starting the loop", "step": 1, "of": 2, "seconds": 7.2}
    strip = panel.page.get_by_role("region", name="Opening")
    strip.wait_for()
    assert "Opening Twin starting the loop" in strip.inner_text().replace("\n", " ")
    panel.until(lambda: "step 1 of 2 · 7 s" in strip.inner_text())
    assert panel.page.locator("#run-text").inner_text() == "Opening …"
    for control in CONTROLS:
        found = panel.page.locator(control)
        assert found.evaluate("(control) => control.matches(':disabled')"), control
        assert found.get_attribute("title") == "The device is being opened.", control
    assert panel.page.locator("#start-status").inner_text() == "The device is being opened."
    panel.bench.opening = None
    panel.until(lambda: not strip.is_visible() and panel.page.locator("#start").is_enabled())
    assert [panel.page.locator(control).get_attribute("title") for control in CONTROLS] == [""] * len(
        CONTROLS
    )


def test_a_device_that_was_closed_says_why(panel: Panel) -> None:
    panel.bench.closed = "the device failed: it was unplugged"
    chip = panel.page.locator("#start-status")
    panel.until(lambda: chip.inner_text() == "Closed: the device failed: it was unplugged. Start opens it.")


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_what_was_commanded_is_seen_where_it_is_what_was_applied(
    browser: Any, server: tuple[str, Any], theme: str
) -> None:
    panel = Panel(browser, *server, color_scheme=theme)
    panel.button("Start").click()
    panel.turn(3000)
    panel.button("Pause").click()
    seen = panel.page.get_by_role("region", name="Voltage").evaluate(
        """(scope) => {
            const canvas = scope.querySelector("canvas");
            const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
            return ["commanded", "applied"].map((name) => {
                const colour = getComputedStyle(document.documentElement).getPropertyValue(`--trace-${name}`).trim();
                const wanted = [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16));
                let count = 0;
                for (let k = 0; k < data.length; k += 4) {
                    if (data[k + 3] > 200 && wanted.every((value, c) => Math.abs(data[k + c] - value) < 12)) count += 1;
                }
                return count;
            });
        }"""
    )
    # Of two equal lines the one on top leaves half of each period, and of the wider one below its edges.
    assert min(seen) > 0.2 * max(seen) > 0
    panel.context.close()


def test_the_cut_off_moves_by_keyboard_and_says_its_value(panel: Panel) -> None:
    slider = panel.page.get_by_role("slider", name="Cut-off")
    slider.focus()
    panel.page.keyboard.press("ArrowRight")
    assert slider.get_attribute("aria-valuetext") == "51 radians per second"
    panel.until(lambda: panel.bench.chain == "derivative | lowpass 51 rad/s")
    panel.page.keyboard.press("End")
    panel.until(lambda: panel.bench.chain == "derivative | lowpass 200 rad/s")


def test_the_tab_key_reaches_everything_and_gets_out_again(panel: Panel) -> None:
    wanted = panel.page.evaluate(
        """() => {
            const all = [...document.querySelectorAll('a[href], button, input, select, textarea, summary, [tabindex="0"]')];
            const reachable = all.filter((e) => e.checkVisibility() && !e.disabled && e.tabIndex >= 0);
            reachable.forEach((e, k) => (e.dataset.number = k));
            return reachable.length;
        }"""
    )
    assert wanted > 40
    reached = set()
    for _ in range(wanted + 20):
        panel.page.keyboard.press("Tab")
        number = panel.page.evaluate("document.activeElement.dataset.number ?? null")
        if number is None and len(reached) == wanted:
            break  # out of the page
        reached.add(number)
    assert {str(k) for k in range(wanted)} - reached == set()


def test_paused_scopes_stand_still(panel: Panel) -> None:
    panel.turn(1500)
    panel.page.get_by_label("Time shown").select_option("1")
    panel.button("Pause").click()
    first = panel.table()
    panel.page.wait_for_timeout(300)
    assert panel.table() == first
    panel.button("Run").click()
    panel.until(lambda: panel.table() != first)


def test_what_is_seen_is_exported_as_it_is(panel: Panel) -> None:
    panel.turn(1500)
    panel.page.get_by_label("Time shown").select_option("1")
    panel.button("Pause").click()
    panel.button("Voltage, Commanded: shown").click()
    panel.button("Position").click()
    head, lines = panel.table()
    assert head == ["t [s]", "applied [V]", "speed [rad/s]"]
    times = [round(1000 * line[0]) for line in lines]
    assert len(times) in (
        1000,
        1001,
    )  # a second with its newest row, and its oldest where rounding leaves that in
    assert times == list(range(times[0], times[0] + len(times)))


def test_angles_are_exported_in_the_unit_that_is_seen(panel: Panel) -> None:
    panel.button("Start").click()
    panel.turn(2500)
    panel.button("Pause").click()
    tables = {}
    for unit in ("rad", "deg", "counts"):
        panel.page.get_by_label("Unit of angles").select_option(unit)
        head, lines = panel.table()
        assert head[-1].endswith(f"[{unit}]")
        tables[unit] = lines[-1][-1]
    assert tables["rad"] > 1
    assert tables["deg"] == pytest.approx(tables["rad"] * 180 / 3.141592653589793, rel=1e-6)
    assert tables["counts"] == pytest.approx(tables["rad"] * 2048 / (2 * 3.141592653589793), rel=1e-6)


def test_the_picture_is_a_png(panel: Panel) -> None:
    panel.turn(300)
    with panel.page.expect_download() as download:
        panel.button("Save what is seen as PNG").click()
    data = Path(download.value.path()).read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert int.from_bytes(data[16:20]) > 500


def test_a_trigger_holds_the_edge_at_its_place(panel: Panel) -> None:
    panel.page.get_by_label("Time shown").select_option("0.5")
    panel.button("Trigger").click()
    panel.page.get_by_label("Level").fill("2")
    panel.page.keyboard.press("Enter")
    panel.button("Start").click()  # 0 V to 3 V; a busy machine may show a later edge, from 1 V
    panel.page.locator("#trigger-strip").get_by_text("Triggered").wait_for()
    head, lines = panel.table()
    applied = [line[head.index("applied [V]")] for line in lines]
    # A tenth of half a second before the edge: 50 rows, the crossing lies between two of them.
    assert applied[0] in (0.0, 1.0)
    assert applied[:50] == [applied[0]] * 50
    assert applied[51:] == [3.0] * len(applied[51:])
    assert len(applied) in (500, 501)


def test_zoom_by_keyboard_halves_what_is_seen(panel: Panel) -> None:
    panel.turn(2500)
    panel.page.get_by_label("Time shown").select_option("2")
    panel.button("Pause").click()
    _, before = panel.table()
    panel.page.get_by_role("img", name="Speed over time").focus()
    panel.page.keyboard.press("+")
    _, after = panel.table()
    assert len(after) == pytest.approx(len(before) / 2, abs=2)


def test_cursors_tell_times_and_differences_and_move_by_keyboard(panel: Panel) -> None:
    panel.turn(1500)
    panel.page.get_by_label("Time shown").select_option("1")
    panel.button("Pause").click()
    panel.button("Cursors").click()
    strip = panel.page.get_by_role("group", name="Cursors")
    strip.get_by_text("Δt 300 ms").wait_for()
    panel.page.get_by_role("slider", name="Cursor B").focus()
    panel.page.keyboard.press("ArrowRight")
    strip.get_by_text("Δt 301 ms").wait_for()
    assert strip.get_by_role("row").count() == 1 + 4  # commanded, applied, filtered, position


def over(panel: Panel, scope: str) -> dict[str, float]:
    """The positions of a scope's traces, in pixels of the page."""
    return dict(panel.page.get_by_role("region", name=scope).locator(".u-over").bounding_box())


def drag(panel: Panel, scope: str, begin: float, end: float) -> None:
    """Drag over a scope from one share of its width to another."""
    box = over(panel, scope)
    height = box["y"] + box["height"] / 2
    panel.page.mouse.move(box["x"] + begin * box["width"], height)
    panel.page.mouse.down()
    panel.page.mouse.move(box["x"] + end * box["width"], height, steps=5)
    panel.page.mouse.up()


def times(panel: Panel) -> list[float]:
    return [line[0] for line in panel.table()[1]]


def test_a_drag_zooms_into_what_it_covers_and_a_double_click_shows_all(panel: Panel) -> None:
    panel.turn(2500)
    panel.page.get_by_label("Time shown").select_option("2")
    panel.button("Pause").click()
    before = times(panel)
    drag(panel, "Speed", 0.25, 0.75)
    panel.until(lambda: len(times(panel)) < len(before))
    after = times(panel)
    # To a pixel or two at each end, of the 700 that show 2 s.
    span = before[-1] - before[0]
    assert after[0] - before[0] == pytest.approx(span / 4, abs=0.01)
    assert after[-1] - before[0] == pytest.approx(3 * span / 4, abs=0.01)
    box = over(panel, "Speed")
    panel.page.mouse.dblclick(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    panel.until(lambda: len(times(panel)) > len(before))


def test_a_cursor_is_dragged_and_nothing_is_zoomed_by_it(panel: Panel) -> None:
    panel.turn(1500)
    panel.page.get_by_label("Time shown").select_option("1")
    panel.button("Pause").click()
    panel.button("Cursors").click()
    strip = panel.page.get_by_role("group", name="Cursors")
    strip.get_by_text("Δt 300 ms").wait_for()
    before = len(times(panel))
    drag(panel, "Speed", 0.65, 0.85)  # B
    # To a pixel of the 700 that show 1 s.
    panel.until(lambda: re.search(r"Δt (49[89]|50[0-2]) ms", strip.inner_text()) is not None)
    assert len(times(panel)) == before


def test_a_single_trigger_holds_until_it_is_armed_again(panel: Panel) -> None:
    panel.page.get_by_label("Time shown").select_option("0.2")
    panel.button("Trigger").click()
    panel.page.get_by_label("Single").check()
    strip = panel.page.locator("#trigger-strip")
    before = panel.page.get_by_role("slider", name="Before")
    before.focus()
    for _ in range(8):
        panel.page.keyboard.press("ArrowRight")
    assert before.get_attribute("aria-valuetext") == "50 percent of the screen before the trigger"
    panel.button("Start").click()
    strip.get_by_text("Triggered, held").wait_for()
    held = panel.table()[1]
    # Half of what is seen is before the edge.
    assert [line[2] for line in held[:100]] == [0.0] * 100
    panel.turn(5000)  # more edges have come since
    assert panel.table()[1] == held
    panel.button("Arm again").click()
    panel.until(lambda: panel.table()[1] != held)


def test_every_signal_and_controller_of_the_library_can_be_set(panel: Panel) -> None:
    for name in SIGNALS.names():
        panel.page.get_by_label("Kind of signal").select_option(name)
        panel.button("Apply signal").click()
        panel.until(lambda name=name: panel.bench.signal["type"] == name)
        given = {key: value for key, value in panel.bench.signal.items() if key != "type"}
        assert SIGNALS[name](**given) == SIGNALS[name](**example(SIGNALS[name])), name
    for name in CONTROLLERS.names():
        panel.page.get_by_label("Kind of controller").select_option(name)
        panel.button("Apply controller").click()
        panel.until(lambda name=name: panel.bench.controller["type"] == name)
        given = {key: value for key, value in panel.bench.controller.items() if key != "type"}
        assert CONTROLLERS[name](**given) == CONTROLLERS[name](), name


def example(signal: Any) -> dict[str, Any]:
    """The settings that have no default, with their examples."""
    fields = signal.model_fields.items()
    return {key: field.examples[0] for key, field in fields if field.is_required()}


def test_a_signal_that_cannot_be_is_reported_before_it_is_sent(panel: Panel) -> None:
    panel.page.get_by_role("spinbutton", name="Low").fill("5")
    panel.page.locator("#signal .trouble").get_by_text("high = 3 is below low = 5").wait_for()


def test_recordings_are_searched_annotated_deleted_and_brought_back(panel: Panel) -> None:
    panel.tab("Recordings")
    panel.page.get_by_role("searchbox").fill("LOOSE")
    panel.until(lambda: panel.page.locator(".recording").count() == 1)
    panel.button("chirp-slow").click()
    panel.page.get_by_label("Notes on chirp-slow").fill("the cable was tightened")
    panel.page.keyboard.press("Tab")
    panel.until(lambda: panel.bench.recordings["chirp-slow"]["notes"] == "the cable was tightened")
    panel.page.get_by_role("searchbox").fill("")
    panel.button("Delete chirp-slow").click()
    panel.until(lambda: panel.page.locator(".recording").count() == 2)
    panel.button("Undo").click()
    panel.until(lambda: panel.page.locator(".recording").count() == 3)
    panel.button("Delete chirp-slow").click()
    panel.page.get_by_text("Deleted (1)").click()
    panel.button("Bring chirp-slow back").click()  # long after the undo is gone
    panel.until(lambda: panel.page.locator(".recording").count() == 3)
    assert not panel.bench.recordings["chirp-slow"]["deleted"]


def test_a_recording_is_made_identified_and_reported(panel: Panel) -> None:
    panel.page.get_by_label("Name of the recording").fill("mine")
    panel.page.get_by_label("Length").select_option("")
    panel.button("Record").click()
    panel.button(re.compile("End recording 0:0")).click()
    panel.page.locator("#toast").get_by_text(re.compile(r"^Recorded mine: [\d.]+ (s|ms)$")).wait_for()
    panel.tab("Recordings")
    panel.button("mine").click()
    panel.button("Identify").click()
    panel.page.get_by_text("22.04", exact=True).wait_for()
    assert (
        panel.page.get_by_role("link", name="Open the report of mine").get_attribute("href")
        == "/reports/mine"
    )


def test_a_recording_that_was_ended_early_says_so(panel: Panel) -> None:
    panel.page.get_by_label("Name of the recording").fill("mine")
    panel.page.get_by_label("Length").select_option("60")
    panel.button("Record").click()
    panel.button(re.compile("End recording 0:01")).click()
    said = re.compile(r"^Recorded mine: [12]\.\d+ s of 60.0 s, as it was stopped by hand$")
    panel.page.locator("#toast").get_by_text(said).wait_for()


def test_what_takes_long_says_how_long_and_can_be_ended(panel: Panel) -> None:
    panel.bench.working = {"doing": "identifying", "step": 3, "of": 4, "seconds": 12.0, "left": None}
    panel.tab("Recordings")
    panel.button("chirp-slow").click()
    panel.button("Identify").click()
    going = panel.page.get_by_role("group", name="Identifying chirp-slow")
    panel.until(lambda: going.is_visible() and "step 3 of 4: identifying · 0:12 so far" in going.inner_text())
    assert going.get_by_role("progressbar").get_attribute("value") is None
    panel.bench.working = {"doing": "identifying", "step": 3, "of": 4, "seconds": 12.0, "left": 36.0}
    panel.until(lambda: "about 0:36 left" in going.inner_text())
    assert "step" not in going.inner_text()
    assert going.get_by_role("progressbar").get_attribute("value") == "0.25"
    assert panel.button("Identifying …").get_attribute("aria-disabled") == "true"
    going.get_by_role("button", name="End: Identifying chirp-slow").click()
    panel.until(lambda: panel.bench.working is None and going.count() == 0)
    panel.button("Identify").wait_for()


def chosen(panel: Panel, size: int) -> None:
    file = {"name": "theirs.csv", "mimeType": "text/csv", "buffer": b"0" * size}
    panel.page.locator("#import-file").set_input_files(files=[file])


def test_a_file_that_is_too_large_is_reported_before_it_is_sent(panel: Panel) -> None:
    panel.tab("Recordings")
    chosen(panel, LARGEST + 10**5)
    panel.page.locator("#toast").get_by_text(
        "theirs.csv has 1.1 MB; 1.0 MB at most can be imported"
    ).wait_for()
    assert panel.bench.uploads == []
    assert not [url for url in panel.requests if "upload" in url]


def test_a_file_tells_how_far_it_is_while_it_is_sent_and_can_be_ended(panel: Panel) -> None:
    panel.tab("Recordings")
    panel.bench.hold = True
    chosen(panel, LARGEST)
    going = panel.page.get_by_role("group", name="Importing theirs.csv")
    panel.until(lambda: "1.0 MB of 1.0 MB" in (going.text_content() if going.count() else ""))
    panel.until(lambda: panel.bench.uploads == [("theirs.csv", LARGEST)])
    panel.until(lambda: "being read" in going.inner_text())
    assert panel.button("Import").is_disabled()
    going.get_by_role("button", name="End: Importing theirs.csv").click()
    panel.page.locator("#toast").get_by_text("it was ended before everything was sent").wait_for()
    panel.bench.hold = False
    chosen(panel, 1000)
    panel.page.locator("#toast").get_by_text("Imported theirs.csv").wait_for()
    assert going.count() == 0


def test_what_reading_a_file_warns_of_stays_in_sight_and_stands_with_the_recording(panel: Panel) -> None:
    panel.tab("Recordings")
    panel.bench.warnings = ["the recording was cut short; the last 94492 bytes of the file were left out"]
    chosen(panel, 1000)
    told = panel.page.locator("#toast .wrong").get_by_text(
        "Imported theirs.csv as uploaded. Reading it warns:"
    )
    told.wait_for()
    assert panel.bench.warnings[0] in told.inner_text()
    panel.page.reload()
    panel.tab("Recordings")
    panel.button("prbs-disc").click()
    kept = panel.page.locator("li.recording", has_text="prbs-disc").locator(".findings")
    kept.get_by_text("94492 bytes").wait_for()


def test_a_file_that_is_unclear_is_asked_about_and_identified_then(panel: Panel) -> None:
    column = {"unit": None, "samples": 1000}
    nothing = {"column": None, "unit": None}
    panel.bench.unclear = {
        "open": True,
        "columns": [
            {"name": "time", "first": [0.0, 5.0, 10.0], **column},
            {"name": "voltage", "first": [-6.0, -6.0, None], **column},
            {"name": "angle", "first": [0.0, -2.461, -9.844], **column},
        ],
        "own_times": False,
        "time": {"column": "time", "unit": None},
        "input": {"column": "voltage", "unit": "V"},
        "output": nothing,
        "chain": "",
    }
    panel.tab("Recordings")
    chosen(panel, 1000)
    form = panel.page.get_by_role("form", name="Columns of theirs")
    form.get_by_text("angle 0 -2.461 -9.844 …").wait_for()  # spaces count once
    asks = panel.page.locator("li.recording", has_text="theirs")
    asks.get_by_text("columns not known yet").wait_for()

    save = form.get_by_role("button", name="Use these columns")
    save.click()
    form.get_by_text("In which unit is time?").wait_for()  # nobody takes them for seconds
    form.get_by_label("Unit of the time").select_option("ms")
    form.get_by_text("the first two samples are 5 ms apart").wait_for()
    save.click()
    form.get_by_text("position, or its speed? Choose one").wait_for()
    form.get_by_label("Which column was measured").select_option("angle")
    form.get_by_label("Unit of the output").select_option("deg")
    save.click()

    panel.until(lambda: form.count() == 0)
    assert panel.bench.said == {"time": "time:ms", "input": "voltage:V", "output": "angle:deg", "chain": ""}
    # What was said is shown again, and can be changed to an even spacing.
    panel.button("Columns of theirs").click()
    form.get_by_label("Which column is the time?").select_option("none: evenly spaced")
    form.get_by_label("Time between two samples").fill("5 ms")
    assert form.get_by_label("Unit of the output").input_value() == "deg"
    save.click()
    panel.until(lambda: panel.bench.said.get("sample_time") == "5 ms")
    assert "time" not in panel.bench.said


def test_two_recordings_are_laid_over_each_other(panel: Panel) -> None:
    panel.turn(500)
    panel.tab("Recordings")
    panel.page.get_by_label("Compare square-1-3").check()
    panel.page.get_by_label("Compare prbs-disc").check()
    panel.page.get_by_role("img", name="Speed of square-1-3 and prbs-disc over time").wait_for()


def test_texts_of_others_are_never_markup(browser: Any, server: tuple[str, Any]) -> None:
    evil = "<img src=x onerror='window.hacked = true'>"
    bench = server[1]
    bench.recordings["square-1-3"] |= {"notes": evil, "signal": evil}
    bench.fault = {"code": "stall", "sentence": evil}
    panel = Panel(browser, *server)
    panel.tab("Recordings")
    panel.button("square-1-3").click()
    panel.page.get_by_role("alert").filter(has_text=evil).wait_for()
    assert panel.page.locator("img:not([role]), #recordings img").count() == 0
    assert panel.page.evaluate("window.hacked") is None
    panel.context.close()


def test_the_page_comes_back_when_the_connection_was_lost(panel: Panel) -> None:
    # Written down in the page: it may be connected again before this process looks.
    panel.page.evaluate(
        """() => {
            const light = document.querySelector("[data-light=link]");
            window.texts = [];
            new MutationObserver(() => window.texts.push(light.innerText)).observe(
                light, {childList: true, characterData: true, subtree: true});
        }"""
    )
    panel.bench.drop_all()
    panel.until(lambda: "connected" in (panel.page.evaluate("window.texts") or [""])[-1])
    assert any("lost" in text for text in panel.page.evaluate("window.texts"))
    panel.page.get_by_text("You drive").wait_for()
    assert panel.page.evaluate("window.texts") is not None  # the page wasn't loaded again


def test_readings_are_there_for_who_cannot_see_the_scopes(panel: Panel) -> None:
    panel.button("Start").click()
    panel.until(lambda: "3.00 V" in panel.page.locator("#readings").inner_text())
    panel.button("Speak readings").click()
    panel.until(lambda: "Voltage, applied 3.00 V" in panel.page.locator("#announcer").inner_text())


@pytest.mark.parametrize("size", [(1440, 900), (1024, 700), (390, 844)])
def test_nothing_sticks_out_at_the_side_and_stop_stays_in_view(
    browser: Any, server: tuple[str, Any], size: tuple[int, int]
) -> None:
    panel = Panel(browser, *server, viewport={"width": size[0], "height": size[1]})
    assert panel.page.evaluate("document.documentElement.scrollWidth") <= size[0]
    panel.page.mouse.wheel(0, 5000)
    panel.page.wait_for_timeout(200)
    box = panel.page.locator("#stop").bounding_box()
    assert box["y"] >= 0
    assert box["y"] + box["height"] <= size[1]
    assert box["height"] >= 44
    panel.context.close()


@pytest.mark.parametrize("size", [(1440, 900), (1024, 768), (390, 844)])
def test_nothing_lies_over_anything_else_however_much_is_shown(
    browser: Any, server: tuple[str, Any], size: tuple[int, int]
) -> None:
    panel = Panel(browser, *server, viewport={"width": size[0], "height": size[1]})
    panel.button("Cursors").click()
    panel.button("Trigger").click()
    for name in ("Current", "Residual"):
        panel.button(name).click()
    panel.tab("Recordings")
    panel.button("square-1-3").click()
    panel.page.wait_for_timeout(300)
    overlaps = panel.page.evaluate(
        """() => {
            const names = "#trigger-strip, .scope, #cursor-strip, .rail .block, .rail.results";
            const parts = [...document.querySelectorAll(names)].filter((part) => part.checkVisibility());
            const boxes = parts.map((part) => part.getBoundingClientRect());
            const found = [];
            boxes.forEach((a, j) => boxes.slice(j + 1).forEach((b, k) => {
                // Sideways the columns stand apart; below each other parts touch at most.
                const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
                const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
                if (wide > 1 && high > 1) found.push([parts[j], parts[j + 1 + k]].map((part) => part.id || part.className));
            }));
            return found;
        }"""
    )
    assert overlaps == []
    panel.page.get_by_label("Compare square-1-3").check()  # it can be pressed
    panel.page.get_by_role("img", name="Speed of square-1-3 over time").wait_for()
    panel.context.close()


EXERCISE = """export function mount(element, api) {
    const load = document.createElement("button");
    load.textContent = "Load";
    load.addEventListener("click", async () => (document.title = await api.set({
        signal: {type: "sine", amplitude: 2}, controller: {type: "pid", kp: 2}, chain: "derivative | lowpass 80 rad/s",
        duration: 7, sample_time: 0.002,
    })));
    element.append(load);
}"""


@pytest.fixture
def exercise(panel: Panel) -> Panel:
    """A page whose exercises are one button."""
    module, style = "**/static/exercises.js", "**/static/exercises.css"
    panel.page.route(module, lambda route: route.fulfill(body=EXERCISE, content_type="text/javascript"))
    panel.page.route(style, lambda route: route.fulfill(body="", content_type="text/css"))
    panel.tab("Exercises")
    return panel


def test_an_exercise_puts_its_experiment_before_the_operator(exercise: Panel) -> None:
    bench = exercise.bench
    exercise.button("Load").click()
    exercise.until(lambda: bench.signal["type"] == "sine" and bench.controller["type"] == "pid")
    exercise.until(lambda: bench.chain == "derivative | lowpass 80 rad/s")
    assert bench.signal["amplitude"] == bench.controller["kp"] == 2
    assert [asked["sample_time"] for asked in bench.received if asked["do"] == "open"] == [0.002]
    assert exercise.page.get_by_label("Length").input_value() == "7"
    exercise.until(lambda: "sampled at 500 Hz, no longer at 1000 Hz" in exercise.page.title())


def test_an_exercise_changes_nothing_that_turns(exercise: Panel) -> None:
    exercise.button("Start").click()
    exercise.until(lambda: exercise.bench.motor.enabled)
    exercise.page.get_by_text("Driving").wait_for()
    exercise.button("Load").click()
    exercise.until(lambda: exercise.page.locator("#signal-status").inner_text() == "Not sent")
    exercise.page.wait_for_timeout(500)
    assert (exercise.bench.signal["type"], exercise.bench.controller["type"]) == ("square", "open_loop")
    assert not [asked for asked in exercise.bench.received if asked["do"] == "open"]


def test_a_part_that_is_not_there_is_reported_and_takes_nothing_away(panel: Panel) -> None:
    panel.page.route("**/static/diagram.js", lambda route: route.abort())
    panel.tab("Block diagram")
    panel.page.get_by_text("This part can't be shown").wait_for()
    panel.tab("Scopes")
    panel.button("Start").click()
    panel.until(lambda: panel.bench.motor.enabled)
