"""A finding: one thing to know about data or a model; and the verdict that findings lead to."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum


class Severity(StrEnum):
    """A finding's weight: `info` changes nothing, `warning` makes a result doubtful, `refusal` refuses it.

    `danger` weighs most: the motor may still be driven, and somebody has to act. It makes a result doubtful.
    """

    INFO = "info"
    WARNING = "warning"
    REFUSAL = "refusal"
    DANGER = "danger"


class Verdict(StrEnum):
    """The trust that a result deserves."""

    TRUSTED = "trusted"
    DOUBTFUL = "doubtful"
    REFUSED = "refused"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing to know, in one plain sentence.

    `code` is a stable lower-case name with hyphens (`offset-found`); `parameters` names the parameters concerned;
    `rows` is the first and the last row concerned, counted from 1 as a person counts the rows of the file, or None.
    """

    code: str
    severity: Severity
    """`info` informs, `warning` makes a result doubtful, `refusal` refuses it; `danger`: somebody has to act."""
    sentence: str
    parameters: tuple[str, ...] = ()
    rows: tuple[int, int] | None = None


def info(
    code: str, sentence: str, *, parameters: tuple[str, ...] = (), rows: tuple[int, int] | None = None
) -> Finding:
    """Return a finding that changes nothing."""
    return Finding(code=code, severity=Severity.INFO, sentence=sentence, parameters=parameters, rows=rows)


def warning(
    code: str, sentence: str, *, parameters: tuple[str, ...] = (), rows: tuple[int, int] | None = None
) -> Finding:
    """Return a finding that makes a result doubtful."""
    return Finding(code=code, severity=Severity.WARNING, sentence=sentence, parameters=parameters, rows=rows)


def refusal(
    code: str, sentence: str, *, parameters: tuple[str, ...] = (), rows: tuple[int, int] | None = None
) -> Finding:
    """Return a finding that refuses a result."""
    return Finding(code=code, severity=Severity.REFUSAL, sentence=sentence, parameters=parameters, rows=rows)


def danger(code: str, sentence: str) -> Finding:
    """Return a finding that the motor may still be driven: reported before anything else, and it makes a result doubtful."""
    return Finding(code=code, severity=Severity.DANGER, sentence=sentence)


def verdict(findings: Iterable[Finding]) -> Verdict:
    """Return the verdict: refused with any refusal, doubtful with any warning or danger, otherwise trusted."""
    severities = {finding.severity for finding in findings}
    if Severity.REFUSAL in severities:
        return Verdict.REFUSED
    return Verdict.DOUBTFUL if severities & {Severity.WARNING, Severity.DANGER} else Verdict.TRUSTED


def by_weight(findings: Iterable[Finding]) -> list[tuple[Finding, ...]]:
    """Return findings in groups of one severity and code, the weightiest first.

    Within a severity those come first that concern parameters, and so the figures, then the others, each in their order.
    """
    order = (Severity.DANGER, Severity.REFUSAL, Severity.WARNING, Severity.INFO)
    groups: dict[tuple[int, bool, str], list[Finding]] = {}
    for finding in findings:
        key = (order.index(finding.severity), not finding.parameters, finding.code)
        groups.setdefault(key, []).append(finding)
    return [tuple(groups[key]) for key in sorted(groups, key=lambda key: key[:2])]


def list_text(words: Sequence[str], last: str = "and") -> str:
    """Return words as a sentence lists them: a, b and c, or with another word than "and" before the `last`; "" of none."""
    return f"{', '.join(words[:-1])} {last} {words[-1]}" if len(words) > 1 else "".join(words)


def lower_first(sentence: str) -> str:
    """Return a sentence as it stands behind a colon: with a small letter, unless it begins with an abbreviation such as USB."""
    return sentence if sentence[1:2].isupper() else sentence[:1].lower() + sentence[1:]
