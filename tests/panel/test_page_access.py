"""Whether everybody can read and reach the page: axe's rules, contrast, and colours that the colour-blind tell apart."""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.panel.browser import served

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

from tests.panel.fake import STATIC, app


def themes() -> dict[str, dict[str, str]]:
    """The colours of both themes, and of the system's dark one, as the style sheet has them."""
    text = (STATIC / "tokens.css").read_text("utf-8")
    blocks = re.findall(r"(:root[^{\n]*) \{([^}]*color-scheme[^}]*)\}", text)
    return {name: dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", body)) for name, body in blocks}


LIGHT, DARK, SYSTEM_DARK = themes().values()


def test_both_ways_to_the_dark_theme_lead_to_the_same_one() -> None:
    assert DARK == SYSTEM_DARK
    assert DARK.keys() == LIGHT.keys()


def linear(colour: str) -> np.ndarray:
    """Linear light from sRGB (IEC 61966-2-1)."""
    c = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def contrast(a: str, b: str) -> float:
    """The contrast ratio of WCAG 2.2."""
    low, high = sorted(float(linear(c) @ [0.2126, 0.7152, 0.0722]) for c in (a, b))
    return (high + 0.05) / (low + 0.05)


TEXTS = [(ink, ground) for ink in ("ink", "quiet", "bad") for ground in ("panel", "ground", "raised")]
TEXTS += [
    ("ink", "accent-soft"),
    ("ink", "scope-ground"),
    ("quiet", "scope-ground"),
    ("scope-text", "scope-ground"),
]
TEXTS += [
    ("accent-ink", "accent"),
    ("stop-ink", "stop"),
    ("stop-ink", "stop-over"),
    ("accent", "panel"),
    ("bad", "bad-soft"),
    ("ink", "bad-soft"),
]
TRACES = sorted(name for name in LIGHT if name.startswith(("trace-", "compare-")))
MARKS = [(trace, "scope-ground") for trace in TRACES]
MARKS += [(mark, "panel") for mark in ("ok", "warn", "bad", "edge", "accent")] + [
    ("edge", "scope-ground"),
    ("cursor-line", "scope-ground"),
]


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=["light", "dark"])
@pytest.mark.parametrize(("ink", "ground"), TEXTS)
def test_texts_have_the_contrast_of_level_aa(theme: dict[str, str], ink: str, ground: str) -> None:
    assert contrast(theme[ink], theme[ground]) >= 4.5


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=["light", "dark"])
@pytest.mark.parametrize(("mark", "ground"), MARKS)
def test_marks_and_traces_stand_out_from_their_ground(theme: dict[str, str], mark: str, ground: str) -> None:
    assert contrast(theme[mark], theme[ground]) >= 3


# Machado, Oliveira, Fernandes: A physiologically-based model for simulation of color vision deficiency, 2009; severity 1.
BLINDNESS = {
    "none": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
TOGETHER = [
    ("commanded", "applied"),
    ("speed_raw", "speed"),
    ("reference", "speed"),
    ("reference", "speed_raw"),
    ("reference", "position"),
]
PAIRS = [(f"trace-{a}", f"trace-{b}") for a, b in TOGETHER]
PAIRS += list(combinations([name for name in TRACES if name.startswith("compare-")], 2))


def lab(light: np.ndarray) -> np.ndarray:
    """CIELAB of linear sRGB, white D65."""
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    ratio = to_xyz @ np.clip(light, 0, 1) / to_xyz.sum(axis=1)
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=["light", "dark"])
@pytest.mark.parametrize("blindness", BLINDNESS)
@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_traces_of_one_scope_are_told_apart_whatever_colours_one_sees(
    theme: dict[str, str], blindness: str, a: str, b: str
) -> None:
    seen = [lab(np.asarray(BLINDNESS[blindness]) @ linear(theme[name])) for name in (a, b)]
    # Ten times what is just noticed (2.3 in CIELAB, Mahy and others 1994); traces differ by dashes and width besides.
    assert np.linalg.norm(seen[0] - seen[1]) >= 23


def findings(page: Any) -> list[str]:
    """The findings of axe that are serious or critical: the rule, and where."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page).response["violations"]
    grave = [each for each in found if each["impact"] in ("serious", "critical")]
    return [
        f"{each['id']}: {node['target']} {node['failureSummary']}" for each in grave for node in each["nodes"]
    ]


WIDE, PHONE = (1440, 900), (390, 844)


@pytest.mark.parametrize(
    ("theme", "size"),
    [
        ("light", WIDE),
        ("dark", PHONE),
        pytest.param("dark", WIDE, marks=pytest.mark.long),
        pytest.param("light", PHONE, marks=pytest.mark.long),
    ],
    ids=["light, wide", "dark, phone", "dark, wide", "light, phone"],
)
def test_axe_finds_nothing_grave(browser: Any, theme: str, size: tuple[int, int]) -> None:
    pytest.importorskip("axe_playwright_python", reason="a browser is absent: no axe_playwright_python")
    made = app()
    with served(made) as address:
        # axe itself is given to the page, which the page's own policy would forbid.
        context = browser.new_context(
            viewport={"width": size[0], "height": size[1]},
            color_scheme=theme,
            bypass_csp=True,
            reduced_motion="reduce",
        )
        page = context.new_page()
        page.goto(address)
        page.wait_for_selector("body.ready")
        page.get_by_role("button", name="Start", exact=True).click()
        page.get_by_text("Driving").wait_for()
        page.get_by_role("button", name="Trigger").click()
        page.get_by_role("button", name="Cursors").click()
        page.wait_for_timeout(1000)  # some readings
        seen = {"scopes": findings(page)}
        page.get_by_label("Kind of signal").select_option("sequence")
        page.get_by_role("group", name="Segment 1 of 2").get_by_label("Kind").select_option("sum")
        page.get_by_role("button", name="Add a segment").click()
        seen["parts"] = findings(page)
        page.get_by_label("Kind of signal").select_option("square")
        page.get_by_role("tab", name="Recordings").click()
        page.get_by_role("button", name="square-1-3", exact=True).click()
        page.get_by_role("button", name="Identify").click()
        page.get_by_text("22.04", exact=True).wait_for()
        page.get_by_label("Compare square-1-3").check()
        page.get_by_role("img", name="Speed of square-1-3 over time").wait_for()
        seen["recordings"] = findings(page)
        page.get_by_label("Compare prbs-disc").check()
        page.get_by_label("Compare chirp-slow").check()
        page.get_by_role("table").get_by_text("differs: 5.0 sd apart").wait_for()
        seen["models"] = findings(page)
        page.evaluate("fetch('/fake/fault', {method: 'POST'})")
        page.get_by_role("button", name="Acknowledge").wait_for()
        page.get_by_role("spinbutton", name="Low").fill("5")
        page.locator("#signal .trouble").get_by_text("below").wait_for()
        seen["fault"] = findings(page)
        page.get_by_role("button", name="Acknowledge").click()
        page.locator("#device").click()
        seen["dialog"] = findings(page)
        context.close()
    assert seen == {name: [] for name in seen}


def test_motion_is_left_out_where_that_is_wished(browser: Any) -> None:
    with served(app()) as address:
        context = browser.new_context(reduced_motion="reduce")
        page = context.new_page()
        page.goto(address)
        page.wait_for_selector("body.ready")
        moving = page.evaluate(
            "[...document.querySelectorAll('*')].filter((e) => { const s = getComputedStyle(e);"
            " return s.transitionDuration !== '0s' || s.animationName !== 'none'; }).length"
        )
        context.close()
    assert moving == 0


def test_no_file_of_the_page_makes_markup_of_texts_or_asks_elsewhere() -> None:
    for file in Path(STATIC).iterdir():
        text = file.read_text("utf-8")
        for forbidden in (
            "innerHTML",
            "outerHTML",
            "insertAdjacentHTML",
            "document.write",
            "eval(",
            "new Function",
            "style=",
            "onclick=",
        ):
            assert forbidden not in text, (file.name, forbidden)
        assert re.findall(r"https?://(?!www\.w3\.org/)", text) == [], file.name
