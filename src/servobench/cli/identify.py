"""`servobench identify`: recordings that somebody already has."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def identify(
    context: typer.Context,
    files: Annotated[list[Path], typer.Argument(metavar="FILE", hidden=True)],
    time: Annotated[str | None, typer.Option(metavar="COL[:UNIT]", help="The column of times.")] = None,
    input_column: Annotated[
        str | None, typer.Option("--input", metavar="COL[:UNIT]", help="The column of what drives the motor.")
    ] = None,
    output_column: Annotated[
        str | None,
        typer.Option(
            "--output", metavar="COL[:UNIT]", help="The column of what was measured: a position or a speed."
        ),
    ] = None,
    supply: Annotated[
        str | None,
        typer.Option(
            metavar="COL[:UNIT]",
            help="The supply that an input in per cent is a part of: a column, or a constant such as '7.4 V'.",
        ),
    ] = None,
    reference: Annotated[
        str | None,
        typer.Option(metavar="COL[:UNIT]", help="The column of what a feedback loop was told to follow."),
    ] = None,
    current: Annotated[
        str | None,
        typer.Option(metavar="COL[:UNIT]", help="The column of the measured current of the armature."),
    ] = None,
    mapping: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="What the columns are, as `servobench inspect FILE --write-mapping` proposes it; options come before it.",
        ),
    ] = None,
    sample_time: Annotated[
        str | None,
        typer.Option(
            metavar="S", help="The time between samples [s], where the file has no times or wrong ones."
        ),
    ] = None,
    chain: Annotated[
        str,
        typer.Option(
            metavar="TEXT",
            help="What lies between the shaft and the output, such as 'derivative | lowpass 50 rad/s', a device that "
            "`servobench chains` lists, or none; applied now where the column shows that it wasn't.",
        ),
    ] = "",
    nominal: Annotated[
        str | None, typer.Option(metavar="NAME", help="The data sheet to hold the result against.")
    ] = None,
    known: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE[+-SD]",
            help="A parameter of the motor that you know, such as resistance=8.4, to find the others; may be repeated.",
        ),
    ] = None,
    validate_with: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Try the model on this file, in place of a part of the data; may be repeated.",
        ),
    ] = None,
    recording: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME", help="Fit the recording of that name only, of several in a file; may be repeated."
        ),
    ] = None,
    structure: Annotated[
        str, typer.Option(metavar="NAME", help="The model structure; auto takes the one that the data need.")
    ] = "auto",
    estimator: Annotated[
        str,
        typer.Option(metavar="NAME", help="The method; auto takes the one that the noise in the data needs."),
    ] = "auto",
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on standard output.")
    ] = False,
    report: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a report (HTML).")] = None,
) -> None:
    """Identify the motor from recordings that you have.

    All recordings in all FILEs are fitted jointly. The result is a transfer function with intervals, a verdict, and the
    findings that are behind it. Whatever isn't said and can't be known is asked for, never guessed.

    COL is a column's name, a variable's name in a .mat file, or a column's number, counted from 1; FILE#COL where it
    stands in another file. UNIT decides whether the output is a position (rad, deg, rev, counts, m) or a speed (rad/s,
    deg/s, rpm, rev/s, counts/s, m/s).
    """
    from servobench.cli.conclusion import check_names, check_report, concluded, deliver, status_of
    from servobench.cli.known import known_values
    from servobench.cli.progress import Progress, told_when_compiling
    from servobench.cli.recordings import evidence, loaded, mapped, mapping_in, seconds
    from servobench.cli.terminal import messages, output
    from servobench.formats.mapping import Mapping

    check_names(structure, estimator, nominal)
    stated = known_values(known or ())
    check_report(report, [*files, *(validate_with or ()), *([mapping] if mapping else [])])
    base = mapping_in(mapping)
    said = Mapping(
        time=time,
        input=input_column,
        output=output_column,
        supply=supply,
        reference=reference,
        current=current,
        sample_time=seconds(sample_time),
        chain=chain,
        recordings=tuple(recording or ()),
    )
    with Progress() as progress:
        fitted = mapped(loaded(files, progress), base, said)
        others = [
            evidence(each, base.of(each.name).overridden_by(said))
            for each in loaded(validate_with or (), progress)
        ]
        with told_when_compiling(progress):
            result = concluded(
                fitted,
                progress,
                structure=structure,
                estimator=estimator,
                nominal=nominal,
                others=others,
                known=stated,
            )
    deliver(
        result,
        [each.recording for each in fitted],
        console=messages() if as_json else output(),
        as_json=as_json,
        report=report,
        command=context.obj or "",
    )
    raise typer.Exit(status_of(result))
