"""The pages build without a warning, and a browser that shows them asks nobody else for anything."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import DOCS, ROOT

LOADED = re.compile(r"<(?:script|img|link|iframe|source)\b[^>]*?\b(?:src|href)=\"([^\"]+)\"")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages as HTML; whatever Sphinx warns of fails here."""
    folder = tmp_path_factory.mktemp("pages")
    words = ["--fail-on-warning", "--keep-going", "--nitpicky", "--quiet", "-b", "html"]
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "sphinx",
            *words,
            "-d",
            str(folder / "trees"),
            str(DOCS),
            str(folder / "html"),
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder / "html"


def test_every_page_is_built(built: Path) -> None:
    pages = {page.relative_to(DOCS).with_suffix(".html") for page in DOCS.rglob("*.md")}

    assert pages <= {page.relative_to(built) for page in built.rglob("*.html")}


def test_nothing_is_loaded_from_elsewhere(built: Path) -> None:
    loaded = {
        goal for page in built.rglob("*.html") for goal in LOADED.findall(page.read_text(encoding="utf-8"))
    }

    assert any(goal.endswith(".css?v=" + goal.rpartition("=")[2]) for goal in loaded)
    assert (
        sorted(goal for goal in loaded if re.match(r"\w+:|//", goal) and not goal.startswith("data:")) == []
    )


def test_formulas_are_drawn_by_the_browser_itself(built: Path) -> None:
    page = (built / "why" / "three-likelihoods.html").read_text(encoding="utf-8")

    assert page.count("<math") > 20
    assert "$$" not in page


def test_the_reference_shows_units_and_defaults_of_settings(built: Path) -> None:
    page = (built / "reference" / "python" / "whole-path.html").read_text(encoding="utf-8")
    text = re.sub(r"<[^>]+>", "", page)

    assert "frequency – Periods in a second (default 0.4 Hz)." in text
