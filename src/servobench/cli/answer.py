"""A result in words and figures, for a terminal or a text file."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from servobench.cli.terminal import printable
from servobench.finding import Finding, Severity, Verdict

if TYPE_CHECKING:
    from servobench.estimators.base import Estimate
    from servobench.result import Comparison, Result

_SYMBOLS = {Severity.REFUSAL: ("✗", "bold red"), Severity.WARNING: ("!", "bold yellow"), Severity.INFO: ("•", "dim")}
_VERDICTS = {
    Verdict.TRUSTED: ("bold green", "nothing in the data speaks against this model"),
    Verdict.DOUBTFUL: ("bold yellow", "something speaks against relying on this model; see the lines marked with !"),
    Verdict.REFUSED: ("bold red", "these data can't support a model; the lines marked with ✗ say why"),
}
_INDENT = (0, 0, 0, 2)


def show_result(console: Console, result: Result) -> None:
    """Print the parameters with their intervals, the transfer function, how well it fits, the verdict and the findings."""
    if result.fit is not None:
        console.print(Padding(_parameters(result.fit.estimates), _INDENT))
        console.print()
        console.print(Padding(_model(result), _INDENT))
    if result.nominal:
        console.print()
        console.print(Padding(_comparisons(result.nominal), _INDENT))
    console.print()
    style, sentence = _VERDICTS[result.verdict]
    console.print(Text.assemble((str(result.verdict), style), f": {sentence}"))
    if result.findings:
        console.print()
        show_findings(console, result.findings)


def show_findings(console: Console, findings: Iterable[Finding]) -> None:
    """Print findings, the weightiest first, each behind its mark."""
    order = list(_SYMBOLS)
    table = Table.grid(padding=(0, 1))
    table.add_column(no_wrap=True)
    table.add_column()
    for finding in sorted(findings, key=lambda each: order.index(each.severity)):
        symbol, style = _SYMBOLS[finding.severity]
        table.add_row(Text(symbol, style=style), Text(printable(finding.sentence) + _rows(finding)))
    console.print(Padding(table, _INDENT))


def columns(*headings: str, right: Iterable[str] = ()) -> Table:
    """Return a table without lines, its headings dimmed; the columns in `right` hold numbers."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="dim", pad_edge=False)
    for heading in headings:
        table.add_column(heading, justify="right" if heading in right else "left", overflow="fold")
    return table


def in_words(name: str) -> str:
    """Return a parameter's name as people write it: `time constant`, `Coulomb voltage`."""
    return name.replace("_", " ").replace("coulomb", "Coulomb")


def _parameters(estimates: dict[str, Estimate]) -> Table:
    from servobench.report.numbers import rounded

    level = next(iter(estimates.values())).level
    interval = f"{100 * level:g} % interval"
    table = columns("parameter", "value", "±", interval, "unit", right=("value", "±", interval))
    for name, estimate in estimates.items():
        low, high = estimate.interval
        half = 0.5 * (high - low)
        told = rounded(estimate.value, half, estimate.unit)
        ends = rounded(0.5 * (low + high), half, estimate.unit)  # an interval need not lie evenly about its value
        known = f"{ends.low} to {ends.high}" if told.half else "not known"
        table.add_row(in_words(name), *map(_ascii_minus, (told.value, told.half, known)), told.unit)
    return table


def _model(result: Result) -> Text:
    """The transfer function, and how much of the output it explains."""
    lines = []
    if result.transfer_function is not None:
        lines.append(f"G(s) = {result.transfer_function}, in {result.transfer_function.unit}")
    if result.fit is not None:
        lines.append(f"simulates {result.fit.fit_percent:.1f} % of the output")
    if result.validation is not None:
        lines.append(f"validation: {result.validation.fit_percent:.1f} %, {result.validation.how}")
    return Text("\n".join(lines))


def _comparisons(nominal: Iterable[Comparison]) -> Table:
    from servobench.report.numbers import plain

    table = columns("held against", "nominal", "identified", "difference", "unit", right=("nominal", "identified", "difference"))
    for each in nominal:
        relative = f"{100 * (each.identified / each.nominal - 1):+.1f} %" if each.nominal else ""
        values = (_ascii_minus(plain(value)) for value in (each.nominal, each.identified))
        table.add_row(in_words(each.name), *values, relative, each.unit)
    return table


def _rows(finding: Finding) -> str:
    if finding.rows is None:
        return ""
    first, last = finding.rows
    return f" (row {first})" if first == last else f" (rows {first} to {last})"


def _ascii_minus(text: str) -> str:
    """The same with the minus sign that other programs read."""
    return text.replace("−", "-")
