"""`servobench identify`: recordings that somebody already has."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from servobench.cli.options import (
    AllFindings,
    AsJson,
    ChainText,
    CountsPerRev,
    CurrentColumn,
    InputColumn,
    InputValues,
    MappingFile,
    OutputColumn,
    RecordingNames,
    ReferenceColumn,
    ReportFile,
    SampleTime,
    StartsAtRest,
    StructureName,
    SupplyColumn,
    TimeColumn,
)


def identify(
    context: typer.Context,
    files: Annotated[list[Path], typer.Argument(metavar="FILE", hidden=True)],
    time: TimeColumn = None,
    input_column: InputColumn = None,
    input_value: InputValues = None,
    output_column: OutputColumn = None,
    supply: SupplyColumn = None,
    reference: ReferenceColumn = None,
    current: CurrentColumn = None,
    mapping: MappingFile = None,
    sample_time: SampleTime = None,
    starts_at_rest: StartsAtRest = False,
    counts_per_rev: CountsPerRev = None,
    chain: ChainText = "",
    nominal: Annotated[
        str | None, typer.Option(metavar="NAME", help="The data sheet to compare the result with.")
    ] = None,
    known: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE[+-SD]",
            help="A known parameter of the motor, such as resistance=8.4, to find the others; may be repeated.",
        ),
    ] = None,
    validate_with: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Test the model on this file instead of a part of the data; may be repeated.",
        ),
    ] = None,
    recording: RecordingNames = None,
    structure: StructureName = "auto",
    estimator: Annotated[
        str,
        typer.Option(
            metavar="NAME", help="The method; auto chooses the one that suits the noise in the data."
        ),
    ] = "auto",
    as_json: AsJson = False,
    report: ReportFile = None,
    all_findings: AllFindings = False,
) -> None:
    """Identify the motor from existing recordings.

    All recordings in all FILEs are fitted jointly. The result is a transfer function with intervals, a verdict, and the
    findings behind it. Missing information is asked for, never guessed.

    COL is a column's name, a variable's name in a .mat file, or a column's number, counted from 1; FILE#COL for a column of
    another file. UNIT decides whether the output is a position (rad, deg, rev, counts, m) or a speed (rad/s, deg/s, rpm,
    rev/s, counts/s, m/s).
    """
    from servobench.cli.conclusion import check_names, check_report, conclude, deliver, status_of
    from servobench.cli.parameter_values import parse_parameters
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.recordings import apply_mapping, input_values, load_all, mapping_of, seconds
    from servobench.cli.terminal import messages, output, say
    from servobench.recordings.evidence import evidence_of
    from servobench.recordings.formats.mapping import Mapping

    check_names(structure, estimator, nominal)
    stated = parse_parameters(known or ())
    check_report(report, [*files, *(validate_with or ()), *([mapping] if mapping else [])])
    base = mapping_of(mapping)
    said = Mapping(
        time=time,
        input=input_column,
        output=output_column,
        supply=supply,
        reference=reference,
        current=current,
        sample_time=seconds(sample_time),
        counts_per_rev=counts_per_rev,
        chain=chain,
        recordings=tuple(recording or ()),
    )
    with Progress() as progress:
        values = input_values(files, input_value or (), input_column)
        fitted = apply_mapping(load_all(files, progress), base, said, values)
        alike = (
            said.override_with(Mapping(input_value=values[str(files[0])]))
            if len(set(values.values())) == 1
            else said
        )
        others = [
            evidence_of(each, base.of(each.name).override_with(alike))
            for each in load_all(validate_with or (), progress)
        ]
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
    for each in fitted:
        if each.recording.stopped.reason not in ("finished", "unknown"):
            say(console, f"{each.recording.name} ended: {each.recording.stopped.sentence}")
    deliver(
        result,
        [each.recording for each in fitted],
        console=console,
        as_json=as_json,
        report=report,
        command=context.obj or "",
        all_findings=all_findings,
    )
    raise typer.Exit(status_of(result))
