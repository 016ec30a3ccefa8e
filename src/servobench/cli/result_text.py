"""A result in words and figures, for a terminal or a text file."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from math import floor, isfinite
from typing import TYPE_CHECKING

from rich.console import Console
from rich.text import Text

from servobench.cli.layout import show_table, show_wrapped
from servobench.cli.option_names import with_options
from servobench.cli.terminal import printable
from servobench.core.finding import Finding, Severity, Verdict, by_weight
from servobench.core.parameter_names import parameter_in_words

if TYPE_CHECKING:
    from servobench.core.estimate import Estimate
    from servobench.identification.result import Comparison, Result

_MARKS = {
    Severity.DANGER: ("✗", "bold red"),
    Severity.REFUSAL: ("✗", "bold red"),
    Severity.WARNING: ("!", "bold yellow"),
    Severity.INFO: ("•", "dim"),
}
_VERDICTS = {
    Verdict.TRUSTED: ("bold green", "nothing was found that goes beyond the intervals above"),
    Verdict.DOUBTFUL: (
        "bold yellow",
        "there is evidence against this model; see the lines marked with !",
    ),
    Verdict.REFUSED: ("bold red", "these data can't support a model; see the lines marked with ✗"),
}
_TOLD = 0.1  # of the half-width: parts of a budget that are smaller are not worth a word
_MOST = 5  # findings, unless all are requested
_REMEDIES = {"rest-to-state"}  # remarks on what the user may know, and what the data then tell
_MOST_ALIKE = 3  # findings of one kind; many files have the same ones


def show_result(console: Console, result: Result, all_findings: bool = False) -> None:
    """Print the parameters with their intervals, the transfer function, how well it fits, the verdict and the findings.

    Of several findings the weightiest are printed, or `all_findings`. A refused result has its verdict and the reasons only, as
    a table of noise would be read all the same; where nothing but what the data tell is wanting, the table says that.
    """
    if result.verdict is Verdict.REFUSED:
        _show_refused(console, result, all_findings)
        return
    if result.fit is not None:
        _show_answers(console, result)
        for line in (*_model(result), *_budget(result), result.good_for):
            if line:
                show_wrapped(console, Text("  "), line, hanging=4)
        console.print()
    if result.motor_parameters:
        _show_parameters(console, result.motor_parameters, "motor")
    if result.nominal:
        _show_comparisons(console, result.nominal)
    _show_verdict(console, result)
    rest = [finding for finding in result.findings if finding.severity is not Severity.DANGER]  # said first
    if rest:
        console.print()
        most, alike = (len(rest), len(rest)) if all_findings else (_MOST, 1)
        show_findings(console, rest, most, alike)


def _show_refused(console: Console, result: Result, all_findings: bool) -> None:
    """Refusals first, then causes, where only the data want something warnings, and remedies; of others the number, or all."""
    from servobench.identification.trust.explanations.base import is_cause

    if result.fit is not None and _determines_nothing(result):
        _show_answers(console, result)
    _show_verdict(console, result)
    console.print()
    causes = [finding for finding in result.findings if is_cause(finding)]
    severities = {Severity.REFUSAL, Severity.WARNING} if _determines_nothing(result) else {Severity.REFUSAL}
    refusals = [
        finding
        for finding in result.findings
        if finding not in causes and (finding.severity in severities or finding.code in _REMEDIES)
    ]
    decisive = [each for each in (*causes, *refusals) if each.severity is Severity.REFUSAL]
    show_findings(console, decisive)
    show_findings(console, [each for each in causes if each not in decisive])
    show_findings(console, [each for each in refusals if each not in decisive])
    rest = [finding for finding in result.findings if finding not in causes and finding not in refusals]
    if all_findings:
        show_findings(console, rest)
    elif rest:
        # The tests of a model that can't be are no news.
        _show_rest(console, len(rest))


def _determines_nothing(result: Result) -> bool:
    """Whether a result is refused only because the data determine no parameter."""
    return {each.code for each in result.findings if each.severity is Severity.REFUSAL} == {"nothing-known"}


def _show_verdict(console: Console, result: Result) -> None:
    style, sentence = _VERDICTS[result.verdict]
    left = _unknown_text(result) if result.verdict is Verdict.TRUSTED else ""
    show_wrapped(console, Text(f"{result.verdict}: ", style=style), f"{sentence}{left}", hanging=0)


def _unknown_text(result: Result) -> str:
    """What a trusted result without a gain doesn't tell: intervals that hold aren't yet a model."""
    from servobench.identification.uncertainty.identifiability import State

    answers = result.answers
    unknown = [
        name
        for name in ("gain", "time_constant")
        if name in answers and answers[name].state is not State.KNOWN
    ]
    if "gain" not in unknown:
        return ""
    return f", which leave the {' and the '.join(map(parameter_in_words, unknown))} open"


def show_findings(
    console: Console, findings: Iterable[Finding], most: int | None = None, alike: int = _MOST_ALIKE
) -> None:
    """Print findings, the weightiest first, each behind its mark; of one kind the first `alike`, and the number of the others.

    Of more than `most` kinds those that only tell something are left out, and their number is said.
    """
    groups = by_weight(findings)
    shown = groups if most is None else _weightiest(groups, most)
    for group in shown:
        sentences = [with_options(finding.sentence) + _rows(finding) for finding in group]
        symbol, style = _MARKS[group[0].severity]
        for sentence in sentences[:alike]:
            show_wrapped(console, Text.assemble("  ", (symbol, style), " "), sentence, hanging=4)
        if len(sentences) > alike:
            console.print(f"    and {len(sentences) - alike} more of this kind", style="dim")
    if len(shown) < len(groups):
        _show_rest(console, len(groups) - len(shown))


def _show_rest(console: Console, number: int) -> None:
    console.print(
        f"    and {number} less important {'ones' if number > 1 else 'one'} (--all-findings)", style="dim"
    )


def _weightiest(groups: Sequence[tuple[Finding, ...]], most: int) -> Sequence[tuple[Finding, ...]]:
    """The first groups; all that speak against the result are among them."""
    grave = sum(group[0].severity is not Severity.INFO for group in groups)
    return groups[: max(most, grave)]


def show_dangers(console: Console, findings: Iterable[Finding]) -> None:
    """Print first what a person at the motor has to act on."""
    for finding in findings:
        if finding.severity is Severity.DANGER:
            console.print(Text(printable(finding.sentence), style="bold red"), soft_wrap=True)


def _show_parameters(console: Console, estimates: Mapping[str, Estimate], what: str) -> None:
    _show_estimates(
        console, what, [_row(parameter_in_words(name, each.unit), each) for name, each in estimates.items()]
    )


def _show_answers(console: Console, result: Result) -> None:
    """The parameters and combinations that are known, and sentences on those that aren't."""
    from servobench.identification.uncertainty.status_text import in_words

    estimates = result.fit.estimates if result.fit else {}
    rows = [
        _row(parameter_in_words(name, estimate.unit), estimate, in_words(result.answers.get(name)))
        for name, estimate in estimates.items()
    ]
    rows += [_row(each.meaning, each.estimate) for each in result.combinations]
    _show_estimates(console, "parameter", rows)


def _row(name: str, estimate: Estimate, instead: str = "") -> tuple[str, ...]:
    """A name, a value with its interval and unit; or what is said `instead`, as digits that aren't known would be read."""
    from servobench.core.rounding import rounded_interval

    text = rounded_interval(estimate.value, estimate.interval, estimate.unit)
    if instead or not text.low:
        return (name, "", "", _ascii_minus(instead or "not known"), "" if instead else text.unit)
    return (name, *map(_ascii_minus, (text.value, text.half, f"{text.low} to {text.high}")), text.unit)


def _show_estimates(console: Console, what: str, rows: Sequence[tuple[str, ...]]) -> None:
    headings = (what, "value", "±", "95 % interval", "unit")
    show_table(console, headings, rows, right=headings[1:4])
    console.print()


def _budget(result: Result) -> list[str]:
    """The parts of the intervals of gain and time constant, the largest first."""
    from servobench.core.rounding import plain
    from servobench.identification.uncertainty.composition import parts_of

    lines = []
    for name in ("gain", "time_constant"):
        parts = parts_of(result.budget, result.answers.get(name))
        if parts:
            estimate = result.answers[name].estimate
            whole = 100 * estimate.half_width / abs(estimate.value)
            shares = ", ".join(
                f"{plain(part, 2)} {line.source}" for part, line in parts if part > _TOLD * whole
            )
            lines.append(
                f"of the ±{plain(whole, 2)} % of the {parameter_in_words(name, estimate.unit)}: {shares}"
            )
    return lines


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
    from servobench.core.rounding import handy_unit, plain

    headings = ("data sheet", "nominal", "identified", "difference", "unit")
    rows = []
    for each in nominal:
        factor, unit = handy_unit(each.unit, max(abs(each.nominal), abs(each.identified)))
        values = (_ascii_minus(plain(value / factor)) for value in (each.nominal, each.identified))
        rows.append((parameter_in_words(each.name, each.unit), *values, _difference(each), unit))
    show_table(console, headings, rows, right=headings[1:4])
    console.print()


def _difference(comparison: Comparison) -> str:
    """The relative difference, how many times as much where that is more than ten; nothing beside zero or another sign."""
    ratio = comparison.identified / comparison.nominal if comparison.nominal else 0.0
    if ratio >= 10:
        return f"{ratio:.0f} times"
    return f"{100 * (ratio - 1):+.1f} %" if ratio > 0 else ""


def _rows(finding: Finding) -> str:
    """The rows concerned, where the sentence doesn't tell them itself."""
    if finding.rows is None or re.search(r"\b(rows?|samples?)\b", finding.sentence, re.IGNORECASE):
        return ""
    first, last = finding.rows
    return f" (row {first})" if first == last else f" (rows {first} to {last})"


def _ascii_minus(text: str) -> str:
    """The same with the minus sign that other programs read."""
    return text.replace("−", "-")
