"""The pages build without a warning, and a browser that shows them asks nobody else for anything."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.pages import DOCS, ROOT

LOADED = re.compile(r"<(?:script|img|link|iframe|source)\b[^>]*?\b(?:src|href)=\"([^\"]+)\"")


FEW = {"index.md", "why/three-likelihoods.md", "reference/python/whole-path.md"}
PAGES = {page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md")}
# Pages are trees of small things, through which the collector of garbage would go again and again: a fifth of the time.
SPHINX = """
import gc, sys
from sphinx.cmd.build import main
gc.set_threshold(200_000, 50, 100)
sys.exit(main(sys.argv[1:]))
"""
LINKS = "toc,myst.xref_missing,ref"
"""The kinds of Sphinx's warnings of links to pages that are left out."""


@pytest.fixture(scope="module", params=["few", pytest.param("all", marks=pytest.mark.long)])
def pages(request: pytest.FixtureRequest) -> set[str]:
    """The pages that are built: three that have something of each kind, or all of them."""
    return FEW if request.param == "few" else PAGES


@pytest.fixture(scope="module")
def built(pages: set[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages as HTML; whatever Sphinx warns of fails here, but for links to pages that are left out."""
    folder = tmp_path_factory.mktemp("pages")
    words = ["--fail-on-warning", "--keep-going", "--nitpicky", "--quiet", "-b", "html"]
    if left_out := ",".join(sorted(PAGES - pages)):
        words += ["-D", f"exclude_patterns=_extensions,{left_out}", "-D", f"suppress_warnings={LINKS}"]
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            SPHINX,
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


def test_the_pages_are_built(pages: set[str], built: Path) -> None:
    assert {Path(page).with_suffix(".html") for page in pages} <= {
        page.relative_to(built) for page in built.rglob("*.html")
    }


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


def test_beside_a_page_stand_the_titles_of_all_pages_without_their_headings(
    pages: set[str], built: Path
) -> None:
    page = built / "why" / "three-likelihoods.html"
    found = re.search(r'<div class="sidebar-tree">(.*?)</div>', page.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    goals = re.findall(r'reference internal" href="([^"]+)"', found[1])

    assert goals.count("#") == 1  # the page itself
    listed = {(page.parent / goal).resolve().relative_to(built) for goal in goals if goal != "#"}
    assert len(listed) == len(goals) - 1
    others = {Path(each).with_suffix(".html") for each in pages - {"index.md", "why/three-likelihoods.md"}}
    assert listed == others if pages == PAGES else listed <= others
