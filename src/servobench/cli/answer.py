"""A result in words and figures, for a terminal or a text file."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from math import floor, isfinite
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from servobench.cli.layout import show_table, show_wrapped
from servobench.finding import Finding, Severity, Verdict

if TYPE_CHECKING:
    from servobench.estimators.base import Estimate
    from servobench.result import Comparison, Result

_MARKS = {
    Severity.REFUSAL: ("✗", "bold red"),
    Severity.WARNING: ("!", "bold yellow"),
    Severity.INFO: ("•", "dim"),
}
_VERDICTS = {
    Verdict.TRUSTED: ("bold green", "nothing in the data speaks against this model"),
    Verdict.DOUBTFUL: (
        "bold yellow",
        "something speaks against relying on this model; see the lines marked with !",
    ),
    Verdict.REFUSED: ("bold red", "these data can't support a model; the lines marked with ✗ say why"),
}
_MOST_ALIKE = 3  # findings of one kind; many files have the same ones


def show_result(console: Console, result: Result) -> None:
    """Print the parameters with their intervals, the transfer function, how well it fits, the verdict and the findings.

    Of a refused result there is the verdict and its reasons only: a table of noise would be read all the same.
    """
    if result.verdict is Verdict.REFUSED:
        _show_refused(console, result)
        return
    if result.fit is not None:
        _show_parameters(console, result.fit.estimates)
        for line in _model(result):
            show_wrapped(console, Text("  "), line, hanging=4)
        console.print()
    if result.motor_parameters:
        _show_parameters(console, result.motor_parameters, "motor")
    if result.nominal:
        _show_comparisons(console, result.nominal)
    _show_verdict(console, result.verdict)
    if result.findings:
        console.print()
        show_findings(console, result.findings)


def _show_refused(console: Console, result: Result) -> None:
    """What is wrong first, then the refusals; of what else there is to say only that the result as JSON has it."""
    from servobench.explanations.base import is_cause

    _show_verdict(console, result.verdict)
    console.print()
    causes = [finding for finding in result.findings if is_cause(finding)]
    refusals = [
        finding
        for finding in result.findings
        if finding.severity is Severity.REFUSAL and finding not in causes
    ]
    show_findings(console, causes)
    show_findings(console, refusals)
    rest = len(result.findings) - len(causes) - len(refusals)
    if rest:
        # The tests of a model that can't be are no news; whoever wants them finds them there.
        console.print(f"    and {rest} more that matter less (--json)", style="dim")


def _show_verdict(console: Console, verdict: Verdict) -> None:
    style, sentence = _VERDICTS[verdict]
    show_wrapped(console, Text(f"{verdict}: ", style=style), sentence, hanging=0)


def show_findings(console: Console, findings: Iterable[Finding]) -> None:
    """Print findings, the weightiest first, each behind its mark; of many of one kind the first few and their number."""
    alike: dict[tuple[Severity, str], list[Finding]] = {}
    for finding in findings:
        alike.setdefault((finding.severity, finding.code), []).append(finding)
    order = list(_MARKS)
    for severity, code in sorted(alike, key=lambda kind: order.index(kind[0])):
        sentences = [finding.sentence + _rows(finding) for finding in alike[severity, code]]
        for sentence in sentences[:_MOST_ALIKE]:
            symbol, style = _MARKS[severity]
            show_wrapped(console, Text.assemble("  ", (symbol, style), " "), sentence, hanging=4)
        if len(sentences) > _MOST_ALIKE:
            console.print(f"    and {len(sentences) - _MOST_ALIKE} more of this kind")


def in_words(name: str) -> str:
    """Return a parameter's name as people write it: `time constant`, `Coulomb voltage`."""
    return name.replace("_", " ").replace("coulomb", "Coulomb")


def _show_parameters(console: Console, estimates: Mapping[str, Estimate], what: str = "parameter") -> None:
    from servobench.rounding import rounded_interval

    level = next(iter(estimates.values())).level
    headings = (what, "value", "±", f"{100 * level:g} % interval", "unit")
    rows = []
    for name, estimate in estimates.items():
        told = rounded_interval(estimate.value, estimate.interval, estimate.unit)
        known = f"{told.low} to {told.high}" if told.low else "not known"
        value = told.value if told.low else ""  # digits of which none is known would be read all the same
        rows.append((in_words(name), *map(_ascii_minus, (value, told.half, known)), told.unit))
    show_table(console, headings, rows, right=headings[1:4])
    console.print()


def _model(result: Result) -> list[str]:
    """The transfer function, and how much of the output it explains, in lines."""
    lines = []
    if result.transfer_function is not None:
        lines.append(result.equation)
    if result.fit is not None:
        lines.append(f"simulates {_percent(result.fit.fit_percent)} of the output")
    if result.validation is not None:
        lines.append(f"validation: {_percent(result.validation.fit_percent)}, {result.validation.how}")
    return lines


def _percent(value: float) -> str:
    """A percentage, rounded down: nothing is simulated to 100 %."""
    return f"{floor(100 * value) / 100:.2f} %" if isfinite(value) else "an unknown part"


def _show_comparisons(console: Console, nominal: Iterable[Comparison]) -> None:
    from servobench.rounding import handy_unit, plain

    headings = ("data sheet", "nominal", "identified", "difference", "unit")
    rows = []
    for each in nominal:
        factor, unit = handy_unit(each.unit, max(abs(each.nominal), abs(each.identified)))
        values = (_ascii_minus(plain(value / factor)) for value in (each.nominal, each.identified))
        rows.append((in_words(each.name), *values, _difference(each), unit))
    show_table(console, headings, rows, right=headings[1:4])
    console.print()


def _difference(comparison: Comparison) -> str:
    """The relative difference; nothing where the two are so far apart that it says no more."""
    ratio = comparison.identified / comparison.nominal if comparison.nominal else 0.0
    return f"{100 * (ratio - 1):+.1f} %" if 0 < ratio < 10 else ""


def _rows(finding: Finding) -> str:
    """The rows concerned, where the sentence doesn't tell them itself."""
    if finding.rows is None or re.search(r"\b(rows?|samples?)\b", finding.sentence, re.IGNORECASE):
        return ""
    first, last = finding.rows
    return f" (row {first})" if first == last else f" (rows {first} to {last})"


def _ascii_minus(text: str) -> str:
    """The same with the minus sign that other programs read."""
    return text.replace("−", "-")
