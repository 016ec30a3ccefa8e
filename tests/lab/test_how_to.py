"""The page on how to write an exercise holds one that works."""

import math
import re
from pathlib import Path

from servobench.lab.check import check
from servobench.lab.exercise import read_exercise
from servobench.lab.facts import facts_on_the_twin

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "exercise.md"


def test_the_example_is_an_exercise_and_its_answers_are_checked() -> None:
    text = PAGE.read_text(encoding="utf-8")
    example = re.search(r"```markdown\n(.*?)```", text, re.DOTALL)
    assert example is not None
    found = read_exercise(example[1], "half", "half.md")
    facts = facts_on_the_twin(found)

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

    known = set(facts_on_the_twin(read_exercise(example[1], "half", "half.md")))

    assert known == named
