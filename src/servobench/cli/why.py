"""`servobench why`: compare a claimed figure, or a data sheet, with a recording."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.option_names import with_options
from servobench.cli.options import (
    AS_IT_IS,
    AsJson,
    DataSheet,
    Overwrite,
    Reading,
    ReportFile,
    StartsAtRest,
    with_reading,
)

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.identification.reconciliation.explanation import Explanation
    from servobench.identification.reconciliation.judgement import JudgedCause, Share

_MOST_CAUSES = 6  # in the table; what is less probable stands in the sentences and in the JSON
_RARE = 0.005  # a probability that is rounded to none


@with_reading
def why(
    context: typer.Context,
    files: Annotated[list[Path], typer.Argument(metavar="FILE", hidden=True)],
    claimed: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="A claimed figure, such as tau=0.13, tau=130ms or gain=23.8; may be repeated.",
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="How the figure was found: step_63, log_linear, rise_time, arx or output_error.",
        ),
    ] = None,
    nominal: DataSheet = None,
    reading: Reading = AS_IT_IS,
    starts_at_rest: StartsAtRest = False,
    as_json: AsJson = False,
    report: ReportFile = None,
    overwrite: Overwrite = False,
) -> None:
    """Explain why a figure differs from the recordings of a motor.

    The figure is a claim or a data sheet's. For each cause (a lag of the measurement, friction, resistance, inertia, the
    method, ...) it states how much of the difference it explains, how probable it is, and which experiment would decide.
    """
    from servobench.cli.conclusion import check_names, conclude, status_of
    from servobench.cli.output_file import check_free
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.recordings import evidence_of, load_all
    from servobench.cli.terminal import messages, output, print_json, say
    from servobench.identification.reconciliation.claim import Claim
    from servobench.identification.reconciliation.reconcile import explain as explained
    from servobench.identification.reconciliation.reenactment import check_method
    from servobench.report.explanation import ExplanationReport

    check_names("auto", "auto", nominal)
    check_method(method)
    for text in claimed or ():
        Claim.parse(text)  # a mistake in it is reported before any work is done
    _check_has_something(claimed, nominal)
    check_free(report, "--report", [*files, reading.mapping], overwrite)
    with Progress() as progress:
        evidence = evidence_of(load_all(files, progress, reading), reading)
        with announce_compiling(progress):
            result = conclude(evidence, progress, starts_at_rest=starts_at_rest)
            explanation = explained(result, claimed or (), nominal=nominal, method=method)
    console = messages() if as_json else output()
    try:
        if report is not None:
            recordings = [each.recording for each in evidence]
            ExplanationReport(recordings, explanation, command=context.obj or "").write(report)
    finally:
        show_explanation(console, explanation)
        if as_json:
            print_json(explanation.to_dict())
    if report is not None:
        say(console, f"\nreport: {report}")
    raise typer.Exit(status_of(result))


def show_explanation(console: Console, explanation: Explanation) -> None:
    """Print what explains the difference: the causes and the re-enacted methods as tables, and the answer in sentences."""
    from rich.text import Text

    from servobench.cli.layout import show_wrapped

    if explanation.differences and not explanation.agrees:
        _show_causes(console, explanation)
        _show_readings(console, explanation)
    for sentence in explanation.sentences:
        show_wrapped(console, Text(), with_options(sentence), hanging=0)
    if explanation.differences and not explanation.agrees:
        console.print()
        note = (
            "The probabilities rest on servobench's assumptions about how often such causes occur and how large "
            "they are (docs/why/claims.md). Causes may act together, so they may add up to more than 100 %."
        )
        show_wrapped(console, Text(), note, hanging=0)


def _show_causes(console: Console, explanation: Explanation) -> None:
    from servobench.cli.layout import show_table
    from servobench.core.parameter_names import parameter_in_words

    shares = [f"of {parameter_in_words(each.name)}" for each in explanation.differences]
    headings = ("cause", "probability", *shares, "the whole difference would need")
    rows = []
    possible = [cause for cause in explanation.causes if cause.possible]
    likely = [cause for cause in possible if cause.probability >= _RARE] or possible[:1]
    for each in likely[:_MOST_CAUSES]:
        parts = {share.name: share for share in each.explains}
        texts = [_share(parts.get(difference.name)) for difference in explanation.differences]
        rows.append((each.label, _percent(each.probability), *texts, _size_needed(each)))
    show_table(console, headings, rows, right=headings[1:-1])
    console.print()


def _show_readings(console: Console, explanation: Explanation) -> None:
    """Readings of different methods from the same data, nearest to the claim marked."""
    from servobench.cli.layout import show_table
    from servobench.core.rounding import plain, with_unit
    from servobench.identification.reconciliation.reenactment import SPOKEN

    if not explanation.readings:
        return
    chain = explanation.readings[0].chain
    headings = ("gain", "time constant", f"read off the same data after {chain}")
    rows = []
    for each in explanation.readings:
        mark = " (nearest)" if each is explanation.nearest else ""
        name = f"{SPOKEN[each.method]}{mark}"
        if each.why_not:
            rows.append(("", "", f"{name}: not possible, as {each.why_not}"))
        else:
            rows.append((plain(each.gain), with_unit(each.time_constant, "s"), name))
    show_table(console, headings, rows, right=headings[:2])
    console.print()


def _share(share: Share | None) -> str:
    from servobench.identification.reconciliation.sentences import share_text

    if share is None or not math.isfinite(share.value):
        return ""
    return share_text(share)


def _percent(probability: float) -> str:
    return f"{100 * probability:.0f} %" if probability >= _RARE else "< 1 %"


def _size_needed(cause: JudgedCause) -> str:
    """The size that explains most, and what speaks against it."""
    from servobench.identification.reconciliation.sentences import size_range_text

    if cause.needed is None:
        return cause.against
    return size_range_text(cause.needed) + (f"; {cause.against}" if cause.against else "")


def _check_has_something(claimed: list[str] | None, nominal: str | None) -> None:
    """Raise `UsageError` where there is nothing to explain."""
    from servobench.core.errors import UsageError

    if not claimed and nominal is None:
        raise UsageError("nothing to explain: give, for example, --claimed tau=0.13, or --nominal NAME")
