"""Files of limits, and the decision for a row."""

from pathlib import Path
from typing import Any

import pytest

from servobench.core.errors import FormatError, UsageError
from servobench.fleet.limits import Limits

ROW: dict[str, Any] = {
    "file": "a.csv", "outcome": "identified", "verdict": "trusted", "reason": "",
    "gain": 20.0, "gain_low": 19.8, "gain_high": 20.2, "gain_unit": "rad/(s·V)", "gain_state": "known",
    "time_constant": 0.1, "time_constant_low": 0.09, "time_constant_high": 0.11, "time_constant_unit": "s",
    "time_constant_state": "known",
}  # fmt: skip


def limits(text: str, folder: Path) -> Limits:
    file = folder / "limits.toml"
    file.write_text(text, encoding="utf-8")
    return Limits.read(file)


@pytest.mark.parametrize(
    ("text", "changed", "decision", "because"),
    [
        ("[gain]\nlow = 19\nhigh = 21", {}, "pass", ""),
        ("[gain]\nlow = '181 rpm/V'\nhigh = 21", {}, "pass", ""),  # 18.95 rad/(s·V)
        ("[gain]\nlow = 21", {}, "fail", "gain is below its limits"),
        ("[gain]\nhigh = 19", {}, "fail", "gain is above its limits"),
        ("[gain]\nlow = 20", {}, "undecided", "gain is within its limits with 50 %"),
        ("[gain]\nlow = 19\n[time_constant]\nhigh = '102 ms'", {}, "undecided", "time_constant is within"),
        ("[gain]\nlow = 21\n[time_constant]\nhigh = '102 ms'", {}, "fail", "gain is below"),
        ("[gain]\nlow = 19", {"verdict": "doubtful", "reason": "noisy"}, "undecided", "doubtful: noisy"),
        ("[gain]\nlow = 19", {"gain_state": "unknown"}, "undecided", "gain isn't known"),
        ("[gain]\nlow = 19", {"gain_high": None}, "undecided", "gain isn't known"),
        ("[delay]\nhigh = 1", {}, "undecided", "delay isn't known"),
        ("[gain]\nlow = 19", {"outcome": "unusable", "verdict": None, "reason": "torn"}, "undecided", "unusable: torn"),
    ],
)  # fmt: skip
def test_a_motor_is_judged(
    text: str, changed: dict[str, Any], decision: str, because: str, tmp_path: Path
) -> None:
    judged = limits(text, tmp_path).judge(ROW | changed)

    assert str(judged.decision) == decision
    assert because in judged.decided_by
    assert (judged.consumer_risk is not None) == (decision == "pass")
    assert (judged.producer_risk is not None) == (decision == "fail")


def test_the_risk_of_a_motor_that_passes_is_that_of_all_its_parameters(tmp_path: Path) -> None:
    """u is 0.2/1.96, so a limit 1.96 u away leaves 2.5 % at each end; so does the time constant's."""
    two_limits = limits(
        "rule = 'simple'\n[gain]\nlow = 19.8\nhigh = 20.2\n[time_constant]\nlow = 0.09", tmp_path
    )

    assert two_limits.judge(ROW).consumer_risk == pytest.approx(0.075, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "because"),
    [
        ("", "there are no limits in it"),
        ("rule = 'coin'\n[gain]\nlow = 1", "no decision rule called 'coin'"),
        ("[gian]\nlow = 1", "did you mean 'gain'"),
        ("[gain]\nlower = 1", "expected low, high or both"),
        ("[gain]\nlow = true", "expected a number"),
        ("[gain]\nlow = nan", "expected a number"),
        ("gain = 3", "expected low, high or both"),
        ("[gain", "isn't TOML"),
    ],
)
def test_what_is_no_limit_is_reported_with_the_file(text: str, because: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"limits\.toml") as raised:
        limits(text, tmp_path)
    assert because in str(raised.value)


@pytest.mark.parametrize(
    ("text", "because"),
    [
        ("[gain]\nlow = '3 s'", "the limit low of gain"),
        ("[time_constant]\nhigh = '3 V'", "the limit high of time_constant"),
        ("[gain]\nlow = 22\nhigh = 21", r"low \(22\) isn't below high \(21\)"),
    ],
)
def test_limits_in_the_unit_of_something_else_are_reported(text: str, because: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=because):
        limits(text, tmp_path).judge(ROW)
