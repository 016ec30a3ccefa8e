"""Findings lead to a verdict: the worst one decides."""

import pytest

from servobench.core.finding import (
    Finding,
    Verdict,
    by_weight,
    danger,
    info,
    list_text,
    refusal,
    verdict,
    warning,
)


@pytest.mark.parametrize(
    ("findings", "expected"),
    [
        ([], Verdict.TRUSTED),
        ([info("a", "A.")], Verdict.TRUSTED),
        ([info("a", "A."), warning("b", "B.")], Verdict.DOUBTFUL),
        ([info("a", "A."), danger("d", "D.")], Verdict.DOUBTFUL),
        ([refusal("c", "C."), warning("b", "B."), info("a", "A.")], Verdict.REFUSED),
    ],
)
def test_the_worst_finding_decides_the_verdict(findings: list[Finding], expected: Verdict) -> None:
    assert verdict(findings) is expected
    assert verdict(iter(reversed(findings))) is expected


def test_severity_and_verdict_are_written_as_plain_words() -> None:
    assert f"{warning('a', 'A.').severity} {verdict([])}" == "warning trusted"


def test_findings_come_by_severity_then_those_about_figures_and_each_code_together() -> None:
    findings = [
        info("note", "N."),
        warning("file", "F."),
        warning("gain", "G.", parameters=("gain",)),
        refusal("data", "D."),
        warning("file", "Once more."),
        danger("driven", "S."),
        info("lag", "L.", parameters=("delay",)),
    ]

    groups = by_weight(findings)

    assert [group[0].code for group in groups] == ["driven", "data", "gain", "file", "lag", "note"]
    assert [each.sentence for each in groups[3]] == ["F.", "Once more."]


def test_words_are_listed_as_a_sentence_does() -> None:
    assert [list_text(words) for words in ([], ["a"], ["a", "b"], ["a", "b", "c"])] == [
        "",
        "a",
        "a and b",
        "a, b and c",
    ]
    assert list_text(("a", "b", "c"), "or") == "a, b or c"
