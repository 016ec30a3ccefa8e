"""A result in words and figures, for a terminal or a text file."""

from __future__ import annotations

from collections.abc import Iterable
from math import floor, isfinite
from textwrap import wrap
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
    """Print the parameters with their intervals, the transfer function, how well it fits, the verdict and the findings."""
    if result.fit is not None:
        _show_table(console, _parameters(result.fit.estimates))
        for line in _model(result):
            _show_wrapped(console, Text("  "), line, hanging=4)
        console.print()
    if result.nominal:
        _show_table(console, _comparisons(result.nominal))
    style, sentence = _VERDICTS[result.verdict]
    _show_wrapped(console, Text(f"{result.verdict}: ", style=style), sentence, hanging=0)
    if result.findings:
        console.print()
        show_findings(console, result.findings)


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
            _show_wrapped(console, Text.assemble("  ", (symbol, style), " "), sentence, hanging=4)
        if len(sentences) > _MOST_ALIKE:
            console.print(f"    and {len(sentences) - _MOST_ALIKE} more of this kind")


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
        ends = rounded(
            0.5 * (low + high), half, estimate.unit
        )  # an interval need not lie evenly about its value
        known = f"{ends.low} to {ends.high}" if told.half else "not known"
        table.add_row(in_words(name), *map(_ascii_minus, (told.value, told.half, known)), told.unit)
    return table


def _model(result: Result) -> list[str]:
    """The transfer function, and how much of the output it explains, in lines."""
    lines = []
    if result.transfer_function is not None:
        lines.append(f"G(s) = {result.transfer_function}, in {result.transfer_function.unit}")
    if result.fit is not None:
        lines.append(f"simulates {_percent(result.fit.fit_percent)} of the output")
    if result.validation is not None:
        lines.append(f"validation: {_percent(result.validation.fit_percent)}, {result.validation.how}")
    return lines


def _percent(value: float) -> str:
    """A percentage, rounded down: nothing is simulated to 100 %."""
    return f"{floor(100 * value) / 100:.2f} %" if isfinite(value) else "an unknown part"


def _comparisons(nominal: Iterable[Comparison]) -> Table:
    from servobench.report.numbers import handy_unit, plain

    table = columns(
        "data sheet",
        "nominal",
        "identified",
        "difference",
        "unit",
        right=("nominal", "identified", "difference"),
    )
    for each in nominal:
        factor, unit = handy_unit(each.unit, max(abs(each.nominal), abs(each.identified)))
        values = (_ascii_minus(plain(value / factor)) for value in (each.nominal, each.identified))
        ratio = each.identified / each.nominal if each.nominal else float("nan")
        relative = (
            f"{100 * (ratio - 1):+.1f} %" if 0 < ratio < 10 else ""
        )  # beyond that it is no difference, but another thing
        table.add_row(in_words(each.name), *values, relative, unit)
    return table


def _show_table(console: Console, table: Table) -> None:
    console.print(Padding(table, (0, 0, 1, 2), expand=False))


def _show_wrapped(console: Console, head: Text, sentence: str, *, hanging: int) -> None:
    """Print a sentence behind a head, its further lines behind that many blanks."""
    # Wrapped here and not by the console, which fills lines with blanks and breaks long names apart.
    first, *rest = wrap(
        printable(sentence),
        console.width,
        initial_indent=head.plain,
        subsequent_indent=" " * hanging,
        break_long_words=False,
        break_on_hyphens=False,
    )
    console.print(Text.assemble(head, first[len(head.plain) :]), soft_wrap=True)
    for line in rest:
        console.print(Text(line), soft_wrap=True)


def _rows(finding: Finding) -> str:
    """The rows concerned, where the sentence doesn't tell them itself."""
    if finding.rows is None or "row" in finding.sentence.lower() or "sample" in finding.sentence.lower():
        return ""
    first, last = finding.rows
    return f" (row {first})" if first == last else f" (rows {first} to {last})"


def _ascii_minus(text: str) -> str:
    """The same with the minus sign that other programs read."""
    return text.replace("−", "-")
