"""`servobench identify`: fit a model to existing recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from servobench.cli.options import (
    AS_IT_IS,
    AllFindings,
    AsJson,
    DataSheet,
    EstimatorName,
    KnownParameters,
    Overwrite,
    Reading,
    ReportFile,
    StartsAtRest,
    StructureName,
    with_reading,
)


@with_reading
def identify(
    context: typer.Context,
    files: Annotated[list[Path], typer.Argument(metavar="FILE", hidden=True)],
    each: Annotated[
        bool,
        typer.Option(
            "--each",
            help="Fit each FILE separately, with a folder for each under --out and a line for each with --json.",
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="The folder for the results of --each; new or empty."),
    ] = None,
    reading: Reading = AS_IT_IS,
    starts_at_rest: StartsAtRest = False,
    nominal: DataSheet = None,
    known: KnownParameters = None,
    validate_with: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Test the model on this file instead of a part of the data; may be repeated.",
        ),
    ] = None,
    structure: StructureName = "auto",
    estimator: EstimatorName = "auto",
    as_json: AsJson = False,
    report: ReportFile = None,
    overwrite: Overwrite = False,
    all_findings: AllFindings = False,
) -> None:
    """Identify the motor from existing recordings.

    All recordings in all FILEs are fitted jointly, or with --each those of each FILE separately. The result is a transfer
    function with intervals, a verdict, and the findings behind it. servobench asks for missing information and never guesses it.

    COL is a column's name, a variable's name in a .mat file, or a column's number, counted from 1; FILE#COL for a column of
    another file, 'COL*SIGN' for one whose sign is in another column. UNIT decides whether the output is a position
    (rad, deg, rev, counts, m) or a speed (rad/s, deg/s, rpm, rev/s, counts/s, m/s); for a sensor in V, give its sensitivity,
    such as 'tacho:7 V/krpm'.
    """
    from servobench.cli.conclusion import check_names, conclude, deliver, status_of
    from servobench.cli.each import identify_each
    from servobench.cli.output_file import check_free
    from servobench.cli.parameter_values import parse_parameters
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.recordings import evidence_of, further_evidence_of, load_all
    from servobench.cli.terminal import messages, output, say
    from servobench.core.rounding import count_text
    from servobench.fleet.settings import Settings

    check_names(structure, estimator, nominal)
    stated = parse_parameters(known or ())
    _check_together(each, out, report, validate_with)
    check_free(report, "--report", [*files, *(validate_with or ()), reading.mapping], overwrite)
    if each:
        settings = Settings(
            options=reading.options,
            structure=structure,
            estimator=estimator,
            nominal=nominal,
            known=stated,
            starts_at_rest=starts_at_rest,
        )
        raise typer.Exit(identify_each(files, settings, out, as_json, context.obj or ""))
    with Progress() as progress:
        fitted = evidence_of(load_all(files, progress, reading), reading)
        others = (
            further_evidence_of(load_all(validate_with, progress, reading), reading) if validate_with else []
        )
        with announce_compiling(progress):
            result = conclude(
                fitted,
                progress,
                structure=structure,
                estimator=estimator,
                nominal=nominal,
                others=others,
                known=stated,
                starts_at_rest=starts_at_rest,
            )
    console = messages() if as_json else output()
    if len(fitted) > 1:
        how = "fitted jointly; --each fits each file by itself" if len(files) > 1 else "fitted jointly"
        say(console, f"{count_text(len(fitted), 'recording')} from {count_text(len(files), 'file')}, {how}\n")
    for part in fitted:
        if part.recording.stopped.reason not in ("finished", "unknown"):
            say(console, f"{part.recording.name} ended: {part.recording.stopped.sentence}")
    deliver(
        result,
        [part.recording for part in fitted],
        console=console,
        as_json=as_json,
        report=report,
        command=context.obj or "",
        all_findings=all_findings,
    )
    raise typer.Exit(status_of(result))


def _check_together(
    each: bool, out: Path | None, report: Path | None, validate_with: list[Path] | None
) -> None:
    """Raise `UsageError` for options that don't go with --each, or without it."""
    from servobench.core.errors import UsageError

    if out is not None and not each:
        raise UsageError(f"--out {out} needs --each; a single result is printed, with --json as JSON")
    if each and report is not None:
        raise UsageError(
            "--report and --each don't go together: with --out each file has a report of its own"
        )
    if each and validate_with:
        raise UsageError("--validate-with and --each don't go together: leave one of them out")
