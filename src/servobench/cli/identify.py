"""`servobench identify`: recordings that somebody already has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from servobench.cli.conclusion import Evidence
    from servobench.recording.recording import Recording


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
    from servobench.cli.conclusion import check_names, concluded, deliver, status_of
    from servobench.cli.progress import Progress, told_when_compiling
    from servobench.cli.recordings import chosen, loaded
    from servobench.cli.terminal import messages, output

    check_names(structure, estimator, nominal)
    _check_can_hold_a_file(report)
    _check_is_no_input(report, [*files, *(validate_with or ())])
    said = _Said(
        time=time, input=input_column, output=output_column, sample_time=_seconds(sample_time), chain=chain
    )
    with Progress() as progress:
        fitted = [said.of(each) for each in chosen(loaded(files, progress), recording or ())]
        others = [said.of(each) for each in loaded(validate_with or (), progress)]
        with told_when_compiling(progress):
            result = concluded(
                fitted, progress, structure=structure, estimator=estimator, nominal=nominal, others=others
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


@dataclass(frozen=True, kw_only=True)
class _Said:
    """What the command line says about the columns, the same for every recording."""

    time: str | None
    input: str | None
    output: str | None
    sample_time: float | None
    chain: str

    def of(self, recording: Recording) -> Evidence:
        """Return the recording with what was said of it; raises `MissingInformation` where that isn't enough."""
        from servobench.cli.chain import with_chain
        from servobench.formats.mapping import assign

        assigned = assign(
            recording, time=self.time, input=self.input, output=self.output, sample_time=self.sample_time
        )
        return with_chain(assigned, self.chain)


def _check_is_no_input(report: Path | None, inputs: Sequence[Path]) -> None:
    """Raise `UsageError` where the report would be written over a recording."""
    from servobench.errors import UsageError

    if report is not None and any(report.resolve() == Path(each).resolve() for each in inputs):
        raise UsageError(f"--report {report}: is one of the recordings, and would be lost; give another name")


def _seconds(text: str | None) -> float | None:
    """A sample time with its unit, or in seconds."""
    from servobench.errors import UnitError, UsageError
    from servobench.units import quantity

    if text is None:
        return None
    try:
        return quantity(text, "s")
    except UnitError as error:
        raise UsageError(f"--sample-time: {error}") from None


def _check_can_hold_a_file(path: Path | None) -> None:
    """Raise `UsageError` where no file can be written there, before any work is done."""
    from servobench.errors import UsageError

    if path is not None and path.is_dir():
        raise UsageError(f"--report {path}: is a folder; name a file in it")
    if path is not None and not path.parent.is_dir():
        raise UsageError(f"--report {path}: there is no folder {path.parent}")
