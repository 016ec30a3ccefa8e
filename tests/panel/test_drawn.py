"""The diagram and the exercises in a browser: by keyboard, with texts that would like to be code, under the panel's policy."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from servobench.lab.exercise_file import exercise
from servobench.lab.markdown import to_html
from servobench.panel import diagram as module
from servobench.panel.diagram import diagram
from servobench.panel.placement import drawing
from servobench.recordings.measurement.base import Chain
from servobench.rig.devices.base import connect
from servobench.rig.experiment import PAPER, Experiment
from servobench.systems.control.pid import Pid

STATIC = Path(module.__file__).parent / "static"
POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:"
HOSTILE = "<img src=x onerror=\"document.title='run'\"><script>document.title='run'</script>"
KINDS = {".js": "text/javascript", ".css": "text/css"}
PAGE = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>test</title>
<link rel="stylesheet" href="/page.css"><link rel="stylesheet" href="/diagram.css"><link rel="stylesheet" href="/exercises.css">
<script type="module" src="/boot.js"></script></head><body><main><h1>Panel</h1><div id="here"></div></main></body></html>"""
COLOURS = "@media (prefers-color-scheme: dark) { body { color: #e8ebed; background: #14181c; } }"
BOOT = """const { mount } = await import(new URLSearchParams(location.search).get("module"));
const api = {
  get: async (path) => (await fetch(path)).json(),
  post: async (path, body) => {
    const answer = await fetch(path, { method: "POST", body: JSON.stringify(body) });
    if (!answer.ok) throw new Error((await answer.json()).error);
    return answer.json();
  },
  set: async (experiment) => { window.asked = experiment; },
};
window.mounted = mount(document.getElementById("here"), api);
await window.mounted.ready;
document.body.dataset.ready = "yes";
"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="a browser is absent: no playwright")
    path = shutil.which("chromium") or shutil.which("chromium-browser")
    if path is None:
        pytest.skip("a browser is absent: no chromium (apt install chromium)")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture
def opened(browser: Any) -> Iterator[Any]:
    """Open a module's page with the answers of a server; whatever a page complains of fails the test."""
    said: list[str] = []
    pages: list[Any] = []

    def opening(name: str, answers: dict[str, Any], **options: Any) -> Any:
        page = browser.new_page(**options)
        pages.append(page)
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))

        def answer(route: Any) -> None:
            path = route.request.url.removeprefix("http://panel.test").partition("?")[0]
            given: dict[str, Any] = {
                "headers": {"Content-Security-Policy": POLICY},
                "content_type": "text/html",
            }
            if path == "/":
                given["body"] = PAGE
            elif path == "/boot.js":
                given |= {"body": BOOT, "content_type": "text/javascript"}
            elif path == "/page.css":
                given |= {"body": COLOURS, "content_type": "text/css"}
            elif path in answers:
                given |= {"body": json.dumps(answers[path]), "content_type": "application/json"}
            elif path == "/favicon.ico":
                given |= {"status": 204, "body": ""}
            else:
                given |= {"path": str(STATIC / path[1:]), "content_type": KINDS[Path(path).suffix]}
            route.fulfill(**given)

        page.route("**/*", answer)
        page.goto(f"http://panel.test/?module=/{name}.js")
        page.wait_for_selector("body[data-ready]")
        return page

    opening.said = said  # type: ignore[attr-defined]
    yield opening
    for page in pages:
        assert page.title() == "test"  # nothing that came as data was run
        page.close()
    assert said == []


def drawn(experiment: Experiment = PAPER) -> dict[str, Any]:
    return drawing(diagram(experiment, connect("twin").info, Chain.parse("derivative | lowpass 50 rad/s")))


def serious(page: Any) -> list[str]:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="a browser is absent: no axe")
    # The checker is a script of its own, which the policy would keep out.
    found = axe.Axe().run(page).response["violations"]
    return [f"{v['id']}: {v['nodes'][0]['html']}" for v in found if v["impact"] in ("serious", "critical")]


def test_every_block_is_reached_by_the_tab_key_and_shows_its_settings_by_enter(opened: Any) -> None:
    told = drawn()
    page = opened("diagram", {"/api/diagram": told})

    page.keyboard.press("Tab")  # the region that scrolls
    for block in told["blocks"]:
        page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        assert page.evaluate("document.activeElement.dataset.block") == block["id"]
        names = page.locator(".diagram-setting dt").all_text_contents()
        assert names == [setting["name"].replace("_", " ") for setting in block["settings"]]
    assert page.get_by_role("button", name="stage: lowpass; cutoff 50\u00a0rad/s").count() == 1


def test_a_click_shows_values_with_their_units(opened: Any) -> None:
    page = opened("diagram", {"/api/diagram": drawn()})

    page.locator("[data-block=signal]").click()

    values = dict(
        zip(
            page.locator(".diagram-setting dt").all_text_contents(),
            page.locator(".diagram-setting dd:not(.diagram-meaning)").all_text_contents(),
            strict=True,
        )
    )
    assert values["low"] == "1\u00a0V"
    assert values["frequency"] == "0.4\u00a0Hz"


def test_what_has_changed_is_drawn_and_what_was_chosen_stays_so(opened: Any) -> None:
    answers = {"/api/diagram": drawn()}
    page = opened("diagram", answers)
    page.locator("[data-block=controller]").focus()
    page.keyboard.press(" ")

    answers["/api/diagram"] = drawn(Experiment(controller=Pid(kp=2.5)))
    page.evaluate("window.mounted.refresh()")

    assert page.locator("[data-block=controller] .diagram-title").text_content() == "pid"
    assert page.locator("[data-block=controller]").get_attribute("aria-pressed") == "true"
    assert "2.5\u00a0V/rad" in (page.locator(".diagram-details").text_content() or "")
    assert page.evaluate("document.activeElement.dataset.block") == "controller"


def test_a_name_that_would_like_to_be_code_is_shown_as_it_is_written(opened: Any) -> None:
    told = drawn(Experiment(name=HOSTILE, notes=HOSTILE))
    told["device"]["title"] = HOSTILE
    for block in told["blocks"]:
        block["title"], block["symbol"] = HOSTILE, [HOSTILE, HOSTILE]
    page = opened("diagram", {"/api/diagram": told})

    page.locator("[data-block=recorder]").focus()  # such long names lie over each other
    page.keyboard.press("Enter")

    assert page.locator("img, script:not([src='/boot.js'])").count() == 0
    assert HOSTILE in (page.locator(".diagram-details").text_content() or "")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_text_overlaps_the_edge_of_its_block(opened: Any, scheme: str) -> None:
    page = opened(
        "diagram",
        {"/api/diagram": drawn(Experiment(controller=Pid(kp=2.125, ki=0.125, kd=0.03125)))},
        color_scheme=scheme,
    )

    outside = page.evaluate("""() => [...document.querySelectorAll(".diagram-block")].flatMap((group) => {
      const box = group.querySelector("rect").getBBox();
      return [...group.querySelectorAll(".diagram-title, .diagram-symbol")].filter((text) => {
        const b = text.getBBox();
        return b.x < box.x || b.x + b.width > box.x + box.width || b.y < box.y || b.y + b.height > box.y + box.height;
      }).map((text) => text.textContent);
    })""")
    assert outside == []


SHOWN = exercise("step")
STEP: dict[str, Any] = {
    "name": "step",
    "title": SHOWN.title,
    "pieces": [{"study": p.study} if p.study else {"html": to_html(p.text)} for p in SHOWN.pieces],
    "blanks": [{"id": b.id, "label": b.label, "unit": b.unit} for b in SHOWN.blanks],
    "experiment": {"signal": {"type": "step"}, "chain": "derivative"},
}
LISTED = [{"name": "step", "title": SHOWN.title, "sentence": SHOWN.sentence}]
CHECKED = {
    "answers": {"gain": {"right": True, "sentence": "Right."}, "pole": {"right": False, "sentence": HOSTILE}}
}
ANSWERS = {
    "/api/exercises": LISTED,
    "/api/exercises/step": STEP,
    "/api/exercises/step/check": CHECKED,
}


def test_an_exercise_is_opened_loaded_and_checked_by_keyboard(opened: Any) -> None:
    page = opened("exercises", ANSWERS)

    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    page.wait_for_selector("form")
    assert page.evaluate("document.activeElement.textContent") == SHOWN.title
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    page.wait_for_function("window.asked")
    assert page.evaluate("window.asked") == STEP["experiment"]
    page.get_by_label(SHOWN.blank("gain").label).fill("19.9")
    page.get_by_label(SHOWN.blank("pole").label).fill("10")
    page.keyboard.press("Enter")
    page.wait_for_selector("[data-right=false]")

    assert page.locator("[data-right=true] .exercises-said").text_content() == "✓Right."
    assert HOSTILE in (page.locator("[data-right=false] .exercises-said").text_content() or "")
    assert page.locator("main img, main script").count() == 0


def test_an_answer_that_is_changed_is_no_longer_called_right_and_is_kept_when_one_looks_elsewhere(
    opened: Any,
) -> None:
    page = opened("exercises", ANSWERS)
    page.get_by_role("button", name=SHOWN.title).click()
    field = page.get_by_label(SHOWN.blank("gain").label)
    field.fill("19.9")
    page.get_by_role("button", name="Check the answers").click()
    page.wait_for_selector("[data-right=true]")

    field.fill("20.5")
    assert page.locator("[data-right=true]").count() == 0
    page.get_by_role("button", name="All exercises").click()
    page.get_by_role("button", name=SHOWN.title).click()
    assert page.get_by_label(SHOWN.blank("gain").label).input_value() == "20.5"


def test_even_a_text_that_a_server_let_through_holds_nothing_but_text(opened: Any) -> None:
    bad = f'<p onclick="x()" style="color:red">a {HOSTILE}<a href="javascript:x()">b</a><iframe src="/"></iframe><b>c</b></p>'
    page = opened("exercises", ANSWERS | {"/api/exercises/step": STEP | {"pieces": [{"html": bad}]}})
    page.get_by_role("button", name=SHOWN.title).click()
    page.wait_for_selector("form")

    inside = page.locator(".exercises-text").inner_html()
    # The browser tells that its policy keeps out what the server's text holds, before it is sorted.
    assert all("Content Security Policy" in told for told in opened.said)
    opened.said.clear()
    assert inside == "<p>a document.title='run'<a>b</a>c</p>"


def test_formulas_are_set_and_keep_nothing_that_does_anything(opened: Any) -> None:
    bad = (
        '<p><math href="javascript:x()" onclick="x()"><mi href="javascript:x()">x</mi><annotation-xml encoding="text/html">'
        '<p onclick="x()">y</p></annotation-xml></math><span class="other">z</span></p>'
    )
    pieces = [{"html": to_html("Of $ω_n$, and $$K/(τs + 1)$$")}, {"html": bad}]
    page = opened("exercises", ANSWERS | {"/api/exercises/step": STEP | {"pieces": pieces}})
    page.get_by_role("button", name=SHOWN.title).click()
    page.wait_for_selector("form")

    text = page.locator(".exercises-text")
    assert text.locator(".kept msub mi").all_text_contents() == ["ω", "n"]
    (fraction,) = text.locator(".shown mfrac").all()
    above, below = (fraction.locator(f":scope > :nth-child({n})").bounding_box() for n in (1, 2))
    assert above["y"] + above["height"] <= below["y"] + 1  # K stands above the bar, and not beside it
    names = text.evaluate("(e) => [...e.querySelectorAll('*')].map((each) => each.localName)")
    assert not {"annotation-xml", "a"} & set(names)
    assert text.locator("[href], [onclick], [encoding], .other").count() == 0
    assert "xyz" in (text.text_content() or "")
    # The browser tells that its policy keeps out what the server's text holds, before it is sorted.
    assert all("Content Security Policy" in told for told in opened.said)
    opened.said.clear()


FOUND = {
    "studies": {
        "levels": {
            "tables": [
                {
                    "title": HOSTILE,
                    "note": "A note.",
                    "columns": [
                        {"heading": "level", "kind": "word", "texts": ["low", HOSTILE]},
                        {"heading": "τ [s]", "kind": "number", "texts": ["0.0998", "0.122"]},
                        {"heading": "paper", "kind": "paper", "texts": ["0.13", ""]},
                    ],
                }
            ],
            "figures": [
                {
                    "title": "A line",
                    "caption": "It rises.",
                    "description": "From 0 to 1.",
                    "svg": '<svg viewBox="0 0 40 20" width="40" height="20" role="img"><title>A line</title>'
                    '<path d="M0 20L40 0" style="stroke: var(--model); fill: none"/></svg>',
                }
            ],
            "sentences": [HOSTILE],
        }
    },
    "corrections": [{"where": "II.E", "paper": "7.69", "ours": HOSTILE, "why": "A sign was lost."}],
}
STUDIED = ANSWERS | {
    "/api/exercises/step": STEP
    | {"pieces": [{"html": "<p>Before.</p>"}, {"study": "levels"}, {"html": "<p>After.</p>"}]},
    "/api/exercises/step/results": FOUND,
}


def test_what_studies_find_is_shown_in_its_place_when_it_is_asked_for(opened: Any) -> None:
    page = opened("exercises", STUDIED)
    page.get_by_role("button", name=SHOWN.title).click()
    page.wait_for_selector("form")
    assert page.locator(".exercises-text > *").all_text_contents() == [
        "Before.",
        "Show the results",
        "After.",
    ]

    page.get_by_role("button", name="Show the results").click()
    page.wait_for_selector(".exercises-study table")

    cells = page.locator(".exercises-study :is(th, td)").all_text_contents()
    assert cells == ["level", "τ [s]", "paper", "low", "0.0998", "0.13", HOSTILE, "0.122", ""]
    picture = page.get_by_role("img", name="A line. From 0 to 1.")
    assert picture.evaluate("(image) => image.decode().then(() => image.naturalWidth)") == 40
    assert "II.E" in page.locator(".exercises-corrections").inner_text()
    assert page.title() == "test"  # nothing that is hostile has run


def test_what_can_not_be_shown_is_reported_and_can_be_asked_for_again(opened: Any) -> None:
    page = opened("exercises", STUDIED | {"/api/exercises/step/results": None})
    page.get_by_role("button", name=SHOWN.title).click()
    page.get_by_role("button", name="Show the results").click()
    page.get_by_text("It can't be shown").wait_for()

    assert page.get_by_role("button", name="Show the results").is_enabled()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_both_are_accessible(opened: Any, scheme: str) -> None:
    options = {"color_scheme": scheme, "bypass_csp": True}  # or the checker's own script is kept out
    page = opened("diagram", {"/api/diagram": drawn()}, **options)
    page.locator("[data-block=limits]").click()
    assert serious(page) == []

    page = opened("exercises", ANSWERS, **options)
    assert serious(page) == []
    page.get_by_role("button", name=SHOWN.title).click()
    page.get_by_label(SHOWN.blank("gain").label).fill("19.9")
    page.get_by_role("button", name="Check the answers").click()
    page.wait_for_selector("[data-right=false]")
    assert serious(page) == []

    page = opened("exercises", STUDIED, **options)
    page.get_by_role("button", name=SHOWN.title).click()
    page.get_by_role("button", name="Show the results").click()
    page.wait_for_selector(".exercises-study table")
    assert serious(page) == []
