"""The wording of the answer to a why."""

import math

import pytest

from servobench.identification.reconciliation.judgement import Share, Size
from servobench.identification.reconciliation.sentences import share_text, size_range_text


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
