"""The causes of a bad fit don't depend on which way the input or the sensor counts."""

from __future__ import annotations

from dataclasses import replace

import pytest

from servobench.identification.trust.explanations.base import explain
from tests.contracts.finding_examples.explanations import EXAMPLES


@pytest.mark.parametrize("code", sorted({each.code for each in EXAMPLES} - {"records-disagree"}))
@pytest.mark.parametrize("mirrored", ["input", "output"])
def test_a_cause_is_the_same_for_a_motor_with_the_other_sign(code: str, mirrored: str) -> None:
    """Which way a wire is connected, or an encoder counts, changes nothing of what is wrong."""
    (record,) = (each.raised.args[0]() for each in EXAMPLES if each.code == code)
    changes = (
        {"u": -record.u, "input_before": -record.input_before} if mirrored == "input" else {"y": -record.y}
    )

    assert [finding.code for finding in explain([replace(record, **changes)])] == [
        finding.code for finding in explain([record])
    ]
