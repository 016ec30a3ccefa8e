"""Mistakes in a page's commands, reported with the names and numbers on the page."""

from __future__ import annotations

from typing import Any

import pytest

from servobench.core.errors import UsageError
from servobench.panel.commands import command_from
from servobench.panel.pages import preview_signal
from servobench.rig.experiment import Experiment

SQUARE = {"type": "square"}
WRONG = {"type": "square", "low": "x"}


def in_sum(*parts: object) -> dict[str, Any]:
    return {"type": "sum", "parts": parts}


def in_sequence(*signals: object) -> dict[str, Any]:
    return {"type": "sequence", "segments": [{"duration": 1, "signal": each} for each in signals]}


@pytest.mark.parametrize(
    ("signal", "told"),
    [
        (in_sum(1), "Part 1: 1 isn't a signal"),
        (in_sum(SQUARE, in_sum(SQUARE, WRONG)), "Part 2: Part 2: low: 'x' isn't a number"),
        (in_sequence(SQUARE, in_sum(WRONG)), "Segment 2: Part 1: low: 'x' isn't a number"),
        (in_sequence(SQUARE, 3), "Segment 2: signal: 3 isn't a signal"),
        ({"type": "sequence", "segments": [3]}, "Segment 1 is 3; expected: a table"),
        ({"type": "sequence", "segments": [{"signal": SQUARE}]}, "Segment 1: duration isn't given"),
        ({"type": "sum", "parts": None}, "parts isn't given; expected: an array"),
        ({"type": "sum", "parts": {}}, "parts is {}; expected: an array"),
        ({"type": "sum"}, "parts isn't given"),
        ({"type": "staircase", "levels": [1, "x"]}, "Level 2: 'x' isn't a number"),
        (WRONG, "low: 'x' isn't a number"),
    ],
)
def test_a_mistake_in_a_signal_is_reported_by_the_number_of_its_part(
    signal: dict[str, Any], told: str
) -> None:
    with pytest.raises(UsageError) as drawn:
        preview_signal({"signal": signal}, Experiment())
    assert str(drawn.value).startswith(told)

    with pytest.raises(UsageError) as applied:
        command_from({"signal": signal})
    assert str(applied.value).removeprefix("signal.").startswith(told)
