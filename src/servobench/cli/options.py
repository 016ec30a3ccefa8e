"""Options that several commands share, such as how to read a recording. Each has one name, one meaning and one help text."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_type_hints

import typer

T = TypeVar("T")

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
        help="A constant input that no column holds, such as 50:%; once for all files, or once for each. "
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
        help="The encoder's counts per turn of the shaft, usually four per line; an output in counts is then in rad.",
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
ControllerSampleTime = Annotated[
    str | None,
    typer.Option(
        "--controller-sample-time",
        metavar="S",
        help="The time between two ticks of the controller that will run, or of a simulation [s].",
    ),
]
VoltageLimit = Annotated[
    str | None, typer.Option("--voltage-limit", metavar="V", help="The largest voltage, either way [V].")
]
Until = Annotated[
    str | None,
    typer.Option(
        "--until",
        metavar="WISH",
        help="Stop when an interval is this narrow: time_constant=0.5% (its half width over the value).",
    ),
]
DeviceName = Annotated[
    str | None,
    typer.Option(
        "--device",
        metavar="NAME",
        help='The device, instead of the one in the file; see `servobench devices`. Settings may follow: "rig:PORT supply=9V".',
    ),
]
DataSheet = Annotated[
    str | None,
    typer.Option("--nominal", metavar="NAME", help="The data sheet of the motor, such as qube_servo_2."),
]
Seed = Annotated[
    int | None,
    typer.Option(
        "--seed",
        metavar="N",
        min=0,
        help="The seed of simulated noise, instead of the experiment's; each further run takes the next.",
    ),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")]
StructureName = Annotated[
    str,
    typer.Option(
        "--structure", metavar="NAME", help="The model structure; auto chooses the one that the data need."
    ),
]
EstimatorName = Annotated[
    str,
    typer.Option(
        "--estimator",
        metavar="NAME",
        help="The method; auto chooses the one that suits the noise in the data.",
    ),
]
KnownParameters = Annotated[
    list[str] | None,
    typer.Option(
        "--known",
        metavar="NAME=VALUE[+-SD]",
        help="A known parameter of the motor, such as resistance=8.4, to find the others; may be repeated.",
    ),
]
LimitsFile = Annotated[
    Path | None,
    typer.Option(
        "--limits",
        metavar="FILE.toml",
        help="The limits of parameters and the decision rule; each motor passes, fails or is undecided.",
    ),
]
NamePatternText = Annotated[
    str | None,
    typer.Option(
        "--pattern",
        metavar="TEXT",
        help="What the files are called, such as '{line}/{serial}_{date}.csv'; each name in braces becomes a column.",
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        metavar="N",
        min=1,
        max=256,
        help="How many processes to use; by default one for each processor.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print only the answer, as JSON, on standard output.")]
MemberName = Annotated[str | None, typer.Argument(metavar="NAME", hidden=True)]
AllFindings = Annotated[
    bool, typer.Option("--all-findings", help="Print all findings, not only the five that matter most.")
]
ReportFile = Annotated[Path | None, typer.Option("--report", metavar="FILE", help="Write a report (HTML).")]


@dataclass(frozen=True, kw_only=True)
class Reading:
    """The options for reading recordings: the same in every command that takes any.

    The columns `time`, `input`, `output`, `supply`, `reference` and `current`, the `input_value` in place of a column, the
    `sample_time`, `counts_per_rev`, the `chain`, the `mapping` file and the names in `recording` are as they were typed; the help
    of each option says what it means.
    """

    time: TimeColumn = None
    input: InputColumn = None
    input_value: InputValues = None
    output: OutputColumn = None
    supply: SupplyColumn = None
    reference: ReferenceColumn = None
    current: CurrentColumn = None
    sample_time: SampleTime = None
    counts_per_rev: CountsPerRev = None
    chain: ChainText = ""
    mapping: MappingFile = None
    recording: RecordingNames = None

    @property
    def flags(self) -> tuple[str, ...]:
        """The options that aren't left out, as they are typed."""
        return tuple(
            f"--{each.name.replace('_', '-')}"
            for each in fields(self)
            if getattr(self, each.name) not in (None, "", [])
        )

    @property
    def options(self) -> dict[str, Any]:
        """The same by the names that Python has for them; raises `UsageError` for a sample time that can't be one."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        values = {name: None if value == "" else value for name, value in values.items()}
        names = values.pop("recording")
        return {**values, "sample_time": _seconds(self.sample_time), "recordings": names or None}


AS_IT_IS = Reading()
"""Nothing is said of how to read."""


def with_reading(command: Callable[..., T]) -> Callable[..., T]:
    """Give a command the options of `Reading`, in the place of its argument `reading`, which they become."""
    kinds = get_type_hints(Reading, include_extras=True)
    names = [each.name for each in fields(Reading)]
    own = inspect.signature(command, eval_str=True)
    parameters: list[inspect.Parameter] = []
    for each in own.parameters.values():
        if each.name != "reading":
            parameters.append(each.replace(kind=inspect.Parameter.KEYWORD_ONLY))
            continue
        for field in fields(Reading):
            option = inspect.Parameter(
                field.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=field.default,
                annotation=kinds[field.name],
            )
            parameters.append(option)

    @wraps(command)
    def read(**arguments: Any) -> T:
        reading = Reading(**{name: arguments.pop(name) for name in names})
        return command(**arguments, reading=reading)

    read.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined]
    return read


def _seconds(text: str | None) -> float | None:
    """The sample time in a text, with its unit or in seconds; raises `UsageError` where it can't be one."""
    from servobench.core.errors import UnitError, UsageError
    from servobench.recordings.formats.timing import seconds

    if text is None:
        return None
    try:
        return seconds(text)
    except (UnitError, UsageError) as error:
        raise UsageError(f"--sample-time: {error}") from None
