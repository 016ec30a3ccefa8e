"""The wording of the answer to a why."""

import math

import pytest

from servobench.identification.reconciliation.base import Decision, share_of
from servobench.identification.reconciliation.judgement import JudgedCause, Share, Size
from servobench.identification.reconciliation.probabilities import SOMETHING_ELSE, Hypothesis
from servobench.identification.reconciliation.questions import about_sheet
from servobench.identification.reconciliation.sentences import sentences, share_text, size_range_text
from tests.identification.reconciliation.motors import SHEET, identified


def test_an_interval_whose_ends_are_alike_is_not_written_out() -> None:
    size = Size(value=0.1, text="below 28 rad/s", low="below 28 rad/s", high="below 28 rad/s")

    assert size_range_text(size) == "below 28 rad/s"


def test_an_open_end_keeps_its_unit() -> None:
    size = Size(value=0.1, text="33 rad/s", low="below 28 rad/s", high="40 rad/s")

    assert size_range_text(size) == "33 rad/s (below 28 rad/s to 40 rad/s)"


@pytest.mark.parametrize(
    ("value", "low", "high", "text"),
    [
        (0.76, 0.58, 1.08, "76 %"),
        (1.0, 0.998, 1.002, "all"),
        (1.4, 1.2, 1.7, "more than all"),
        (1.27, 0.49, 99.28, "at least 49 %"),
        (0.5, -3.0, 4.0, "an unknown part"),
        (-0.5, -3.0, -0.2, "none"),
        (0.3, math.nan, math.nan, "30 %"),
        (50.0, math.nan, math.nan, "an unknown part"),
    ],
)
def test_a_part_of_a_difference_is_as_much_as_is_known_of_it(
    value: float, low: float, high: float, text: str
) -> None:
    assert share_text(Share(name="gain", value=value, interval=(low, high))) == text


@pytest.mark.parametrize(
    ("factor", "text"),
    [(0.938, "6.2 % less"), (1.31, "31 % more"), (2.4, "140 % more"), (2.5, "2.5 times"), (4.0, "4 times")],
)
def test_a_factor_is_a_percentage_until_it_is_several_times(factor: float, text: str) -> None:
    assert share_of(factor) == text


@pytest.mark.parametrize(("probability", "said"), [(0.48, False), (0.52, True)])
def test_something_else_is_likely_where_it_is_likelier_than_all_that_is_considered(
    probability: float, said: bool
) -> None:
    fit = identified().fit
    assert fit is not None
    friction = JudgedCause(
        name="viscous_friction", label="friction", law="", probability=0.0, possible=False, against="none",
        needed=None, likely=None, explains=(), decision=Decision(sentence=""),
    )  # fmt: skip
    hypotheses = [Hypothesis(causes=(SOMETHING_ELSE,), probability=probability)]

    lines = sentences(about_sheet(fit, SHEET), [friction], hypotheses, [])

    assert any("something else is likely" in line for line in lines) == said
