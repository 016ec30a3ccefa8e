"""Options that several commands have: what the columns of a recording are, and the like. Each is said in the same words."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

TimeColumn = Annotated[str | None, typer.Option("--time", metavar="COL[:UNIT]", help="The column of times.")]
InputColumn = Annotated[
    str | None,
    typer.Option("--input", metavar="COL[:UNIT]", help="The column of the input that drives the motor."),
]
InputValues = Annotated[
    list[str] | None,
    typer.Option(
        "--input-value",
        metavar="VALUE:UNIT",
        help="An input that no column holds, one value throughout, such as 50:%; once for all files, or once for each. "
        "If the file's name has it: --input '{level}pwr:%'.",
    ),
]
OutputColumn = Annotated[
    str | None,
    typer.Option(
        "--output", metavar="COL[:UNIT]", help="The column of the measured output: a position or a speed."
    ),
]
SupplyColumn = Annotated[
    str | None,
    typer.Option(
        "--supply",
        metavar="COL[:UNIT]",
        help="The supply voltage for an input in per cent: a column, or a constant such as '7.4 V'.",
    ),
]
ReferenceColumn = Annotated[
    str | None,
    typer.Option("--reference", metavar="COL[:UNIT]", help="The column of a feedback loop's reference."),
]
CurrentColumn = Annotated[
    str | None,
    typer.Option(
        "--current", metavar="COL[:UNIT]", help="The column of the measured current of the armature."
    ),
]
MappingFile = Annotated[
    Path | None,
    typer.Option(
        "--mapping",
        metavar="FILE.toml",
        help="What the columns are, as proposed by `servobench inspect FILE --write-mapping`; options override it.",
    ),
]
SampleTime = Annotated[
    str | None,
    typer.Option(
        "--sample-time",
        metavar="S",
        help="The time between samples [s], where the file has no times or wrong ones.",
    ),
]
StartsAtRest = Annotated[
    bool,
    typer.Option(
        "--starts-at-rest",
        help="The motor is at rest when the record begins, and the input was zero until then.",
    ),
]
CountsPerRev = Annotated[
    float | None,
    typer.Option(
        "--counts-per-rev",
        metavar="N",
        help="The counts per turn of the shaft of an output in counts (usually four per encoder line); the result "
        "is then in rad.",
    ),
]
ChainText = Annotated[
    str,
    typer.Option(
        "--chain",
        metavar="TEXT",
        help="What lies between the shaft and the output, such as 'derivative | lowpass 50 rad/s', a device that "
        "`servobench chains` lists, or none; applied now if the column shows that it wasn't.",
    ),
]
RecordingNames = Annotated[
    list[str] | None,
    typer.Option(
        "--recording",
        metavar="NAME",
        help="Use only the recording of that name, if a file has several; may be repeated.",
    ),
]
StructureName = Annotated[
    str,
    typer.Option(
        "--structure", metavar="NAME", help="The model structure; auto chooses the one that the data need."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print only JSON, the answer, on standard output.")]
AllFindings = Annotated[
    bool, typer.Option("--all-findings", help="Print all findings, not only the five that matter most.")
]
ReportFile = Annotated[Path | None, typer.Option("--report", metavar="FILE", help="Write a report (HTML).")]
