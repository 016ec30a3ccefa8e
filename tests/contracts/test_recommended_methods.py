"""The method that an exercise recommends earns full marks, whichever motor `lab assess` assigns.

`tests/lab/recommended_methods.py` has the methods, on counts and voltages alone; the marks are those of the exercise's own rules.
How many were tried once, and where, is in docs/decisions/0035-one-right-method.md; here are as many as a test can wait for.
"""

from pathlib import Path

import pytest

from servobench.lab.assessment.assigned_stand import Assessment
from servobench.lab.assessment.questions import Question, questions
from servobench.lab.check import check_blank
from servobench.lab.exercise_file import exercise, exercises
from servobench.lab.stand import MotorStand
from servobench.rig.motor.individual import TIME_CONSTANT, individual
from tests.lab.recommended_methods import METHODS, Student

SECRET = bytes(range(32))
FEWEST, MOST = 1, 3
"""Students of an exercise in `make test`, and as many as `make test-long` goes on to."""
STEP_FEWEST, STEP_MOST = 4, 40
NUMBERS = {each.name: (FEWEST, MOST) for each in exercises()} | {"step": (STEP_FEWEST, STEP_MOST)}
STUDENTS = [
    *(pytest.param(name, range(few), id=name) for name, (few, _) in NUMBERS.items()),
    *(
        pytest.param(name, range(few, most), id=f"{name}, more", marks=pytest.mark.long)
        for name, (few, most) in NUMBERS.items()
    ),
]


@pytest.fixture(scope="module")
def secret(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mine") / "secret"
    path.write_bytes(SECRET)
    path.chmod(0o600)
    return path


def asked(secret: Path, name: str, number: int) -> tuple[MotorStand, list[Question]]:
    """The stand of a student who has the motor as well, and what they are asked."""
    assessment = Assessment(exercise=exercise(name), secret_file=secret, secret=SECRET, with_motor=True)
    stand = assessment.stand(f"s{number}")
    return stand, [each for each in questions(assessment.exercise, stand) if each.is_answerable]


def written(value: float, question: Question) -> str:
    """An answer as somebody writes it down: four digits, or all of them where it has to be exact."""
    return f"{value:.12g}" if question.blank.tolerance == "exact" else f"{value:.4g}"


@pytest.mark.parametrize(("name", "students"), STUDENTS)
def test_the_recommended_method_gets_full_marks(secret: Path, name: str, students: range) -> None:
    wrong = []
    for number in students:
        stand, to_do = asked(secret, name, number)
        answers = METHODS[name](Student(stand=stand))
        for each in to_do:
            given = written(answers[each.blank.id], each)
            said = check_blank(each.blank, given, stand.facts)
            if not said.right:
                wrong.append(
                    f"s{number} {each.blank.id}: {given}, right is {each.right:.6g}: {said.sentence}"
                )

    assert not wrong, "\n".join(wrong)


def test_the_students_have_quick_and_slow_motors() -> None:
    """The longest and shortest of 40 even draws of ln τ lie within a tenth of the range of its ends, but for 0.9⁴⁰ = 1.5 %."""
    low, high = TIME_CONSTANT
    edge = (high / low) ** 0.1
    own = [individual(SECRET, "step", f"s{number}") for number in range(STEP_MOST)]
    tau = [
        each.resistance * each.inertia / (each.resistance * each.viscous_friction + each.motor_constant**2)
        for each in own
    ]

    assert min(tau) < low * edge
    assert max(tau) > high / edge


def test_taking_the_filters_time_constant_off_a_reading_is_no_right_answer(secret: Path) -> None:
    """Two lags pass 63.2 % later than at their sum: by 3.4 ms for 40 ms, 1.6 ms for 140 ms, and a difference is 1 ms late."""
    right = 0
    for number in range(2):
        stand, to_do = asked(secret, "step", number)
        tau = next(each for each in to_do if each.blank.id == "time_constant")
        read = METHODS["step"](Student(stand=stand))["read"]
        right += check_blank(tau.blank, written(read - 0.02, tau), stand.facts).right

    assert right == 0
