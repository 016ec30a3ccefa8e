"""Findings lead to a verdict: the worst one decides."""

import pytest

from servobench.core.finding import Finding, Verdict, info, refusal, verdict, warning


@pytest.mark.parametrize(
    ("findings", "expected"),
    [
        ([], Verdict.TRUSTED),
        ([info("a", "A.")], Verdict.TRUSTED),
        ([info("a", "A."), warning("b", "B.")], Verdict.DOUBTFUL),
        ([refusal("c", "C."), warning("b", "B."), info("a", "A.")], Verdict.REFUSED),
    ],
)
def test_the_worst_finding_decides_the_verdict(findings: list[Finding], expected: Verdict) -> None:
    assert verdict(findings) is expected
    assert verdict(iter(reversed(findings))) is expected


def test_severity_and_verdict_are_written_as_plain_words() -> None:
    assert f"{warning('a', 'A.').severity} {verdict([])}" == "warning trusted"
