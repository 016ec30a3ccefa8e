"""An exercise worked through: what a lecturer is told of it, and what isn't known as a figure."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from servobench.cli.lab.shown import show_worked
from servobench.core.errors import UsageError
from servobench.lab.exercise_file import read_exercise
from servobench.lab.stand import stand_on_the_twin
from servobench.lab.worked_exercise import WorkedExercise

HOW_TO = Path(__file__).parents[2] / "docs" / "how-to" / "exercise.md"


def half(old: str = "", new: str = "") -> WorkedExercise:
    """The exercise of the guide on the twin, with something in it replaced."""
    text = HOW_TO.read_text(encoding="utf-8").partition("```markdown\n")[2].partition("\n```\n")[0]
    assert old in text
    exercise = read_exercise(text.replace(old, new, 1), "half", "half.md")
    return WorkedExercise(exercise=exercise, stand=stand_on_the_twin(exercise), given={})


def shown(worked: WorkedExercise, width: int = 80) -> str:
    text = io.StringIO()
    show_worked(Console(file=text, width=width), worked, solution=True, studies=False)
    return text.getvalue()


def test_the_guides_exercise_has_nothing_to_tell_a_lecturer() -> None:
    worked = half()

    assert worked.unnoticed_mistakes == ()
    assert worked.limited == ""


def test_a_mistake_that_counts_as_right_is_reported() -> None:
    """0.7 is 1 % more than ln 2 = 0.693, and 5 % are allowed; half of τ is 28 % less."""
    worked = half('"500 * time_constant"', '"700 * time_constant"')

    (sentence,) = worked.unnoticed_mistakes
    assert sentence.startswith(
        "half: the mistake `700 * time_constant` is within the tolerance of the right answer"
    )
    assert "! half: the mistake" in shown(worked)


def test_a_mistake_that_cannot_be_worked_out_is_reported_with_its_line() -> None:
    with pytest.raises(
        UsageError, match=r"half\.md:16: blank 'half', a mistake: no fact called 'way_value_9'"
    ):
        _ = half('"500 * time_constant"', '"way_value_9"').unnoticed_mistakes


def test_a_signal_beyond_the_limit_is_reported() -> None:
    """The twin is given 10 V at most, as its data sheet says."""
    worked = half('final = "2 V"', 'final = "50 V"')

    assert worked.limited.replace("\N{NO-BREAK SPACE}", " ").startswith(
        "the commanded voltage reaches 50 V, and the motor got at most 10 V"
    )
    assert "! the commanded voltage reaches 50" in shown(worked)


def test_a_controller_may_go_to_its_limit() -> None:
    """The position is 4 rad off at the start: 100 V/rad ask for 400 V, which a loop is meant to do."""
    controller = '[controller]\ntype = "pid"\nkp = 100\n\n[signal]\ntype = "step"\nfinal = "4 rad"'
    worked = half('[signal]\ntype = "step"\nfinal = "2 V"', controller)

    assert worked.stand.recording["saturated"].values.any()
    assert worked.limited == ""


def test_what_the_recording_does_not_tell_stands_below_the_table() -> None:
    """The step comes after the end, so that the motor never turns."""
    text = shown(half('start = "1 s"', 'start = "9 s"'))

    assert "  half   not known  Time until half of the steady speed" in text
    assert "! half can't be determined: the recording doesn't determine" in text
    assert ".." not in text
    assert ".:" not in text
    assert max(map(len, text.splitlines())) <= 80


def test_what_is_known_by_less_than_its_own_size_is_no_answer_and_no_figure() -> None:
    """The guard stops the run after 16 ms of motion: the interval of what is identified from it is wider than its value."""
    worked = half("[signal]", '[limits]\nspeed = "3 rad/s"\n\n[signal]')

    (corrected,) = worked.corrections
    assert corrected.value is None
    assert (
        "can't be determined here: the recording doesn't determine time_constant: its 95 % interval is ±"
        in corrected.ours
    )
    # Nor is there an answer: anything would lie within that interval.
    assert "! half can't be determined: the recording doesn't determine" in shown(worked)
    assert "s, as large as itself" in corrected.ours
