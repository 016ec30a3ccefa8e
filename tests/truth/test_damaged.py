"""Damaged recordings are told by the right name, and sound ones aren't doubted.

The damages and the recordings are those of `bench/damaged.py`, one seed each.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from servobench.core.finding import Severity
from servobench.identification.trust.doubts.base import DOUBTS

sys.path.append(str(Path(__file__).resolve().parent.parent.parent / "bench"))

from damaged_parts.damages import Copy, copies  # type: ignore[import-not-found]
from damaged_parts.recordings import Ours, undamaged  # type: ignore[import-not-found]
from damaged_parts.runs import identified  # type: ignore[import-not-found]

SEED = 1


@pytest.mark.parametrize(
    "copy",
    # What is told of the mild damage is rarely missed in the severe one.
    [pytest.param(copy, marks=[pytest.mark.long] if copy.severity == "severe" else []) for copy in copies()],
    ids=lambda copy: f"{copy.damage}, {copy.severity}",
)
def test_a_damaged_recording_is_reported_by_the_right_name(copy: Copy) -> None:
    found = {finding.code for finding in identified(copy.made(SEED), copy.nominal).findings}

    assert found & set(copy.codes), f"{copy.words}: wanted {copy.codes}, found {sorted(found)}"


@pytest.mark.parametrize("ours", undamaged(), ids=lambda ours: ours.words)
def test_a_sound_recording_is_not_doubted(ours: Ours) -> None:
    findings = identified([ours.made(SEED)]).findings

    assert [finding.code for finding in findings if finding.severity != Severity.INFO] == []


def test_there_are_forty_damaged_copies_and_each_damage_is_mild_and_severe() -> None:
    every = copies()

    assert len(every) >= 40
    assert {c.damage for c in every if c.severity == "mild"} == {
        c.damage for c in every if c.severity == "severe"
    }


def test_every_doubt_names_its_codes() -> None:
    codes = [code for doubt in DOUBTS for code in doubt.codes]

    assert len(codes) == len(set(codes))
    assert all(code == code.lower() and " " not in code for code in codes)


@pytest.mark.parametrize(
    "name",
    ["input is the output", "input unrelated", "wheel blocked", "sign of the input", "encoder direction"],
)
def test_a_file_that_cannot_support_a_model_is_refused(name: str) -> None:
    severe = next(c for c in copies() if c.damage == name and c.severity == "severe")

    result = identified(severe.made(SEED))

    assert result.verdict == "refused"
    refusals = [f for f in result.findings if f.severity == Severity.REFUSAL]
    assert any(f.code in severe.codes for f in refusals), [f.code for f in refusals]
