"""Answers: right within the tolerance, and told what is wrong with them otherwise."""

import math

import pytest

from servobench.core.errors import NotIdentifiable, UnknownName, UsageError
from servobench.lab.check import check, check_blank, right_answer
from servobench.lab.exercise import Blank, Mistake
from servobench.lab.exercise_file import read_exercise
from servobench.lab.expression import Fact
from servobench.lab.tolerance import Tolerance

TAU = {"time_constant": Fact(value=0.1, half=0.004)}


def blank(**given: object) -> Blank:
    return Blank(
        **{"id": "tau", "label": "τ", "unit": "s", "answer": "time_constant", "tolerance": "5 %"} | given  # type: ignore[arg-type]
    )


@pytest.mark.parametrize(
    ("text", "allowed"),
    [("exact", 0.0), ("interval", 0.004), ("5 %", 0.005), ("2 ms", 0.002), ("interval + 5 % + 2 ms", 0.011)],
)
def test_a_tolerance_is_the_sum_of_its_parts(text: str, allowed: float) -> None:
    # 1e-9 of the value is what decimal digits may lose.
    assert Tolerance(text, "s").around(TAU["time_constant"]) == pytest.approx(allowed, abs=1.1e-10)


def test_a_tolerance_without_a_unit_goes_with_a_blank_without_one_or_in_per_cent() -> None:
    overshoot = Fact(value=20.0, half=0.1)

    assert Tolerance("5", "").around(TAU["time_constant"]) == pytest.approx(5, rel=1e-9)
    assert Tolerance("interval + 0.5", "%").around(overshoot) == pytest.approx(0.6)  # percentage points
    assert Tolerance("0.5 %", "%").around(overshoot) == pytest.approx(0.1)  # of 20 %


@pytest.mark.parametrize(
    "text",
    ["", "about", "-5 %", "0 s", "5 V", "exact + 1 %", "interval interval", "1 % +", "5", "interval + 5"],
)
def test_a_tolerance_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="tolerance"):
        Tolerance(text, "s")


@pytest.mark.parametrize("text", ["0.1", "0.1 s", "100 ms", "0.1049", "95.1ms", " 1e-1 s ", "1.0e5 us"])
def test_what_is_within_the_tolerance_is_right_in_any_unit_of_its_kind(text: str) -> None:
    assert check_blank(blank(), text, TAU).right


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0.1049", "close: within 5 %, a little too large"),
        ("0.0951", "close: within 5 %, a little too small"),
        ("-0.1", "The sign is wrong; the size is right."),
        ("-0.1009", "The sign is wrong; the size is right."),  # 0.9 % off, with 1 % allowed
        ("-0.104", "The sign is wrong. It is close: within 5 %, a little too large"),
        ("100", "too large by 10^3"),
        ("0.0001", "too small by 10^3"),
        ("0.955", "60/2π"),
        ("0.01047", "2π/60"),
        ("5.73", "180/π"),
        ("0.001745", "π/180"),
        ("0.6283", "2π"),
        ("0.0159", "1/2π"),
        ("0.025", "quadrature"),
        ("0.2", "twice"),
        ("0.05", "half"),
        ("0.13", "too large, by more than 5 %; the order of magnitude is right"),
        ("0.316", "too large, by more than 5 %; the order of magnitude is right"),  # √10 is 3.162
        ("0.03165", "too small, by more than 5 %; the order of magnitude is right"),
        ("0.317", "It is about 3 times too large: the order of magnitude is wrong."),
        ("0.0315", "It is about 3 times too small: the order of magnitude is wrong."),
        ("0.01016", "It is about 10 times too small: the order of magnitude is wrong."),
        ("3.3", "It is about 30 times too large: the order of magnitude is wrong."),
        ("321", "It is about 3000 times too large"),
        ("-3.3", "The sign is wrong. It is about 30 times too large"),
        ("3.3e30", "It is about 3×10³¹ times too large"),
        ("1e308", "too large by more than any number can say"),
        ("0", "It isn't zero."),
        ("", "no answer yet"),
        ("5 V", "is a voltage"),
        ("0,1", "decimal point"),
        ("fast", "can't be read"),
        ("nan", "can't be read"),
        ("1e999", "can't be read"),
        ("9" * 200, "characters at most"),
    ],
)
def test_what_is_wrong_is_reported(text: str, said: str) -> None:
    answer = check_blank(blank(tolerance="1 %"), text, TAU)

    assert not answer.right
    assert said in answer.sentence


def test_a_mistake_that_the_exercise_knows_is_reported_in_its_words_and_the_hint_otherwise() -> None:
    rule = blank(
        hint="Look again.",
        mistakes=(Mistake(answer="1 / time_constant", sentence="That is the pole."),),
    )

    assert check_blank(rule, "10", TAU).sentence == "That is the pole."
    assert check_blank(rule, "0.17", TAU).sentence.endswith("Look again.")


def test_a_negative_answer_is_right_with_either_minus() -> None:
    rule = blank(answer="-1 / time_constant", unit="rad/s")

    assert check_blank(rule, "-10", TAU).right
    assert check_blank(rule, "\u221210 rad/s", TAU).right


@pytest.mark.parametrize(("text", "said"), [("-7.69", "too small in size"), ("-13", "too large in size")])
def test_of_a_number_below_zero_the_size_is_spoken_of(text: str, said: str) -> None:
    assert said in check_blank(blank(answer="-1 / time_constant", unit="rad/s"), text, TAU).sentence


@pytest.mark.parametrize("text", ["-10", "-10 1/s", "-10 rad/s", "−10.2rad/s"])
def test_a_pole_may_be_reported_in_radians_a_second_too(text: str) -> None:
    """The radian is the number one: python-control's `damp` and many a textbook have poles in rad/s."""
    assert check_blank(blank(unit="1/s", answer="-1 / time_constant"), text, TAU).right


def test_a_pole_in_hertz_is_told_to_be_a_frequency() -> None:
    said = check_blank(blank(unit="1/s", answer="-1 / time_constant"), "-1.59 Hz", TAU)

    assert not said.right
    assert "'-1.59 Hz' is a frequency" in said.sentence


def test_a_part_of_one_is_reported_from_per_cent() -> None:
    level = blank(answer="100 * (1 - exp(-1))", unit="%", tolerance="0.5 %")

    assert "in per cent it is a hundred times as much" in check_blank(level, "0.632", TAU).sentence
    assert "not the power of ten" in check_blank(blank(), "0.001", TAU).sentence


@pytest.mark.parametrize(
    "text", ["2*pi/2048", "2π/2048", "pi / 1024", "(2 pi) / 2^11", "3.0679615757712823e-3"]
)
def test_an_answer_may_be_worked_out_in_its_place(text: str) -> None:
    rule = blank(answer="2 * pi / 2048", unit="rad/count", tolerance="exact")

    assert check_blank(rule, text, {}).right


@pytest.mark.parametrize(
    "text", ["1/0", "9**9**9**9", "2 048", "2(3)", "5pi pi", "((1", "pie", "1/2 s 3", "time_constant"]
)
def test_what_cannot_be_worked_out_is_reported_as_any_other_text(text: str) -> None:
    assert "can't be read" in check_blank(blank(), text, TAU).sentence


def test_the_right_answer_is_reported_in_the_unit_that_a_bare_answer_is_taken_in() -> None:
    # 0.1 s ± 5 % would be 100 ms with a prefix; 20 ms stay ms.
    assert right_answer(blank(), TAU) == "0.1000 ± 0.0050\u00a0s".replace(" ", "\u00a0")
    lag = blank(answer="200 * time_constant", unit="ms", tolerance="2 %")
    assert right_answer(lag, TAU) == "20.00 ± 0.40 ms".replace(" ", "\u00a0")


def test_the_tolerance_follows_from_what_the_recording_leaves_open() -> None:
    rule = blank(tolerance="interval")

    assert check_blank(rule, "0.1039", TAU).right
    assert not check_blank(rule, "0.1041", TAU).right
    # The pole's interval: 0.004 s times 1/τ² = 100.
    pole = blank(answer="1 / time_constant", unit="rad/s", tolerance="interval")
    assert check_blank(pole, "10.39", TAU).right
    assert not check_blank(pole, "10.41", TAU).right


def test_where_nothing_is_known_no_answer_is_called_right_or_wrong() -> None:
    open_ended = {"time_constant": Fact(value=0.1, half=math.inf)}

    with pytest.raises(NotIdentifiable, match="its interval has no end"):
        check_blank(blank(tolerance="interval"), "0.1", open_ended)


def test_of_an_exact_answer_nothing_is_forgiven() -> None:
    rule = blank(answer="2048", unit="counts", tolerance="exact")

    assert check_blank(rule, "2048", {}).right
    assert not check_blank(rule, "2047", {}).right
    assert check_blank(rule, "2047", {}).sentence == "It is close, but outside the tolerance."
    assert right_answer(rule, {}) == "2048\u00a0counts"


FILE = """+++
title = "T"
[signal]
type = "constant"
[[blanks]]
id = "one"
label = "one"
answer = "gain"
unit = "rad/(s·V)"
tolerance = "exact"
+++
Text.
"""


def test_a_rule_that_asks_for_what_there_is_not_is_reported_with_its_file_and_line() -> None:
    with pytest.raises(
        UsageError, match=r"mine\.md:5: blank 'one': no fact called 'gain' \(did you mean 'gains'"
    ):
        check(read_exercise(FILE, "mine", "mine.md"), {"one": "1"}, {"gains": Fact(value=1.0)})


def test_an_answer_to_no_blank_is_refused() -> None:
    with pytest.raises(UnknownName, match="no blank called 'two'; known: one"):
        check(read_exercise(FILE, "mine", "mine.md"), {"two": "1"}, {})
