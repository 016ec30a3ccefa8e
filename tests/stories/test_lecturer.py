"""The story of a lecturer: an exercise copied, changed and shown in terminal and panel, checked, with no line of Python."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

from tests import forks
from tests.stories.program import Page, Program, running, truth_of_the_twin

# What a lecturer types into the copy: another title, one blank and one table of their own, and where the table stands.
BLANK = """[[blanks]]
id = "half"
label = "Time until half of the steady speed, without the filter"
unit = "ms"
answer = "1000 * log(2) * time_constant"
tolerance = "interval + 5 %"

[[blanks.mistakes]]
answer = "500 * time_constant"
sentence = "Half of the way takes longer than half of the time constant."

[studies.mine]
type = "values"
title = "Of my motor"

[[studies.mine.rows]]
label = "half of the way"
answer = "1000 * log(2) * time_constant"
unit = "ms"
paper = 90.1

[[blanks]]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a copy of the exercise on the step response, changed with a text editor."""
    made = tmp_path_factory.mktemp("lecture")
    with (
        files("servobench").joinpath("lab/exercises/step.md").open("rb") as found,
        (made / "half.md").open("wb") as copy,
    ):
        shutil.copyfileobj(found, copy)
    text = (made / "half.md").read_text(encoding="utf-8")
    changed = re.sub('^title = ".*"$', 'title = "Half of the way"', text, count=1, flags=re.MULTILINE)
    changed = changed.replace("[[blanks]]\n", BLANK, 1) + "\n{{ mine }}\n"
    assert changed.count("half of the way") == 1
    (made / "half.md").write_text(changed, encoding="utf-8")
    return made


@pytest.fixture(scope="module")
def program(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Program]:
    with running(tmp_path_factory.mktemp("panel"), "--exercises", str(folder)) as found:
        yield found


def terminal(*words: str) -> str:
    """The output of a command; it has to end well."""
    ended = forks.run(["-m", "servobench", *words], cwd=Path.cwd())
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def half_of_the_way() -> float:
    """The simulated motor's time to half of its speed [ms]: τ ln 2, with τ from the equations of a DC motor."""
    return 1000 * math.log(2) * truth_of_the_twin().time_constant


def test_it_is_shown_in_the_terminal_and_answers_are_checked(folder: Path, tmp_path: Path) -> None:
    listed = terminal("lab", "list", "--folder", str(folder))
    page = str(tmp_path / "page.html")
    shown = terminal("lab", "do", "half", "--folder", str(folder), "--studies", "--page", page)
    given = [f"half={half_of_the_way():.1f} ms", f"half={0.72 * half_of_the_way():.1f}"]
    right, wrong = (
        terminal("lab", "do", "half", "--folder", str(folder), "--answer", each) for each in given
    )

    assert "Half of the way" in listed
    assert "Of my motor" in shown
    assert "half of the way" in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "✓" in right
    assert "Half of the way takes longer" in wrong  # 500 τ is 0.7213 of 1000 τ ln 2


def test_it_is_shown_in_the_panel_and_answers_are_checked(program: Program, browser: Any) -> None:
    with Page(browser, program.address) as page:
        page.drive()
        page.tab("Exercises")
        page.button(re.compile("^Half of the way")).click()
        found = page.page.get_by_role("region", name="What is found: mine")
        found.get_by_role("button", name="Show the results").click()
        found.get_by_role("table").wait_for()
        row = found.locator("tbody tr").inner_text().split()

        field = page.page.get_by_label("Time until half of the steady speed")
        said = page.page.locator(".exercises-blank", has=field).locator(".exercises-said")
        field.fill(f"{half_of_the_way():.1f} ms")
        page.button("Check the answers").click()
        said.get_by_text("Right.").wait_for()
        field.fill(f"{0.72 * half_of_the_way():.1f}")
        page.button("Check the answers").click()
        said.get_by_text("Half of the way takes longer").wait_for()

        assert row[:4] == ["half", "of", "the", "way"]
        # An encoder at 500 Hz tells the time constant of a step to half a per cent, as tests/lab/test_exercises.py has it.
        assert float(row[4]) == pytest.approx(half_of_the_way(), rel=5e-3)
        assert row[5] == "90.1"
        assert page.complaints == []
