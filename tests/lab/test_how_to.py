"""The page on how to write an exercise holds one that works, all keys and facts; the page on studies all studies."""

import importlib.util
import math
import re
from pathlib import Path
from types import ModuleType

from servobench.lab.check import check
from servobench.lab.exercise import Blank, Correction, Mistake
from servobench.lab.exercise_file import _Front, read_exercise
from servobench.lab.paper_items import PaperItem
from servobench.lab.stand import stand_on_the_twin

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how-to" / "exercise.md"


def test_the_example_is_an_exercise_and_its_answers_are_checked() -> None:
    text = PAGE.read_text(encoding="utf-8")
    example = re.search(r"```markdown\n(.*?)```", text, re.DOTALL)
    assert example is not None
    found = read_exercise(example[1], "half", "half.md")
    facts = stand_on_the_twin(found).facts

    # The time constant of the simulated motor: R J / (R b + k²).
    tau = 8.4 * 2.0952e-5 / (8.4 * 1e-6 + 0.042**2)
    assert check(found, {"half": f"{tau * math.log(2)} s"}, facts)["half"].right
    assert "half of the time constant" in check(found, {"half": f"{500 * tau} ms"}, facts)["half"].sentence


def test_every_fact_that_the_page_lists_is_there() -> None:
    text = PAGE.read_text(encoding="utf-8")
    table = text.partition("## The facts")[2]
    named = {
        name
        for row in re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)
        for name in re.findall(r"`(\w+)`", row)
    }
    example = re.search(r"```markdown\n(.*?)```", text, re.DOTALL)
    assert example is not None

    known = set(stand_on_the_twin(read_exercise(example[1], "half", "half.md")).facts)

    assert known == named


def test_every_key_that_a_file_may_have_is_listed() -> None:
    table = PAGE.read_text(encoding="utf-8").partition("## What the file may have")[2].partition("\n## ")[0]
    rows = {
        re.findall(r"`([^`]+)`", row.partition(" | ")[0])[0]: set(
            re.findall(r"`([^`]+)`", row.partition(" | ")[2])
        )
        for row in table.splitlines()
        if row.startswith("| `")
    }

    own = {"title", "sentence", "order", "[[blanks]]", "[studies.NAME]", "[[corrections]]", "[[paper]]"}
    assert {key.strip("[]").partition(".")[0] for key in own} == set(_Front.model_fields)
    assert own | {"[experiment]"} == set(rows)
    mistakes = set(Mistake.model_fields)
    assert rows["[[blanks]]"] == set(Blank.model_fields) - {"mistakes"} | {"[[blanks.mistakes]]"} | mistakes
    assert rows["[[corrections]]"] == set(Correction.model_fields)
    assert rows["[[paper]]"] == set(PaperItem.model_fields)


def write_studies() -> ModuleType:
    spec = importlib.util.spec_from_file_location("write_studies", ROOT / "tools" / "write_studies.py")
    assert spec is not None
    assert spec.loader is not None
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    return tool


def test_the_page_on_studies_is_what_they_say_of_themselves() -> None:
    tool = write_studies()

    assert tool.PAGE.read_text(encoding="utf-8") == tool.page(), "run make generate"


def test_the_example_shows_its_study_and_its_correction() -> None:
    from servobench.lab.worked_exercise import WorkedExercise

    text = PAGE.read_text(encoding="utf-8")
    example = re.search(r"```markdown\n(.*?)```", text, re.DOTALL)
    assert example is not None
    found = read_exercise(example[1], "half", "half.md")
    shown = WorkedExercise(exercise=found, stand=stand_on_the_twin(found), given={})

    # The time constant of the simulated motor: R J / (R b + k²).
    tau = 8.4 * 2.0952e-5 / (8.4 * 1e-6 + 0.042**2)
    assert shown.corrections[0].value is not None
    assert abs(shown.corrections[0].value / (1000 * tau) - 1) < 5e-3  # as of a step, see test_exercises.py
    assert shown.study_result("way").tables[0].columns[1].paper == (130.0,)
