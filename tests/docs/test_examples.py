"""The examples of the documentation do what the pages say: each page is followed from top to bottom, as printed."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import jupytext
import pytest

from servobench.rig.experiment.reading import read_experiment
from tests.docs.pages import DOCS, RUN, SHOWN, Block, Reader, blocks

PAGES = sorted(page for page in DOCS.rglob("*.md") if any(True for _ in blocks(page)))
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.md"))
OTHERS = [page for page in PAGES if page not in NOTEBOOKS]
FOLLOWED = [page for page in OTHERS if any(b.language in RUN and b.file is None for b in blocks(page))]


def named(page: Path) -> str:
    return page.relative_to(DOCS).as_posix()


LONG = {
    "how-to/assess.md",
    "how-to/experiment.md",
    "how-to/fleet.md",
    "how-to/loop.md",
}
"""Pages of many runs, or of commands that start processes of their own; the tests of these commands show them with less."""


def parameters(pages: list[Path]) -> list[Any]:
    """Pages as parameters, those of `LONG` for `make test-long`."""
    return [
        pytest.param(page, id=named(page), marks=[pytest.mark.long] if named(page) in LONG else [])
        for page in pages
    ]


@pytest.mark.parametrize("page", parameters(FOLLOWED))
def test_a_page_can_be_followed_as_it_is_printed(page: Path, tmp_path: Path) -> None:
    assert Reader(tmp_path).follow(page) >= 1


# tests/stories/test_data_at_hand.py runs each one in Jupyter, and holds it against what it shows.
@pytest.mark.parametrize("page", NOTEBOOKS, ids=named)
def test_a_notebook_opens_as_one_with_the_same_cells(page: Path) -> None:
    cells = [cell.source.strip() for cell in jupytext.read(page).cells if cell.cell_type == "code"]

    assert cells == [block.text.strip() for block in blocks(page) if block.language == "python"]


def test_the_notebooks_are_listed_and_short() -> None:
    assert [named(page) for page in NOTEBOOKS] == [
        f"notebooks/{name}.md" for name in ("arrays", "compare", "design", "fleet", "frc", "identify")
    ]


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_block_says_what_it_is_in(page: Path) -> None:
    """A block without a language, or in one that nobody runs or reads, would be an example that nobody tries."""
    unknown = [(block.line, block.language) for block in blocks(page) if block.language not in RUN | SHOWN]
    assert not unknown


def test_the_pages_that_lead_through_something_are_followed() -> None:
    assert {"tutorial.md", "how-to/csv.md", "how-to/structure.md", "how-to/device.md", "how-to/class.md"} <= {
        named(page) for page in FOLLOWED
    }


TOML = [(page, block) for page in PAGES for block in blocks(page) if block.language == "toml"]


@pytest.mark.parametrize(("page", "block"), TOML, ids=[f"{named(page)}:{block.line}" for page, block in TOML])
def test_toml_is_toml_and_an_experiment_is_one(page: Path, block: Block) -> None:
    given = tomllib.loads(block.text)

    assert given
    if "signal" in given:
        read_experiment(block.text, named(page))


@pytest.mark.parametrize(
    ("example", "told"),
    [
        ("```sh\nservobench signals sine\n```\n\n```text\nsine  A cosine wave.\n```\n", "not printed"),
        ("```sh\nservobench signals sime\n```\n", "page.md:1.*did you mean"),
        ("```sh\nservobench --version    # exit status 2\n```\n", "servobench --version"),
        ("```sh\nrm -r .\n```\n", "no test knows how to run rm"),
        ("```python\nraise SystemExit(1)\n```\n", "page.md:1"),
        ("Save it as `a.py`:\n\n```python\nprint(1)\n```\n\n```sh\npython b.py\n```\n", "b.py"),
    ],
)
def test_an_example_that_does_not_work_is_found(example: str, told: str, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(example, encoding="utf-8")
    folder = tmp_path / "reader"
    folder.mkdir()

    with pytest.raises(AssertionError, match=f"(?s){told}"):
        Reader(folder).follow(page)
