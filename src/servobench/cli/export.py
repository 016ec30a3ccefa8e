"""`servobench export`: an identified motor in the form that another program takes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.option_names import CONTROLLER, with_options
from servobench.cli.options import (
    AS_IT_IS,
    AsJson,
    ControllerSampleTime,
    Overwrite,
    Reading,
    StartsAtRest,
    VoltageLimit,
    with_reading,
)

if TYPE_CHECKING:
    from servobench.export.base import Wishes
    from servobench.export.summary import ResultSummary


@with_reading
def export(
    motor: Annotated[Path, typer.Argument(metavar="RESULT | FILE", hidden=True)],
    target: Annotated[
        str, typer.Option("--as", metavar="TARGET", help="control, matlab, wpilib, mujoco, c, json or csv.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="The file to write; by default, motor with TARGET's ending, and motor-wpilib.json for wpilib.",
        ),
    ] = None,
    position_unit: Annotated[
        str | None,
        typer.Option(
            "--unit", metavar="UNIT", help="The unit of position for wpilib and c: rev, rad, deg, m."
        ),
    ] = None,
    controller_sample_time: ControllerSampleTime = None,
    closed_loop: Annotated[
        str | None,
        typer.Option(metavar="S", help="The desired time constant of the closed loop [s], for wpilib and c."),
    ] = None,
    controller_counts_per_rev: Annotated[
        float | None,
        typer.Option(
            metavar="N", help="The counts per turn of the encoder that the controller reads, for c."
        ),
    ] = None,
    voltage_limit: VoltageLimit = None,
    inertia: Annotated[
        str | None,
        typer.Option(
            metavar="J",
            help=(
                "The inertia of everything that turns, for mujoco, such as 2.1e-5 or '210 g*cm^2' [kg*m^2]."
            ),
        ),
    ] = None,
    reading: Reading = AS_IT_IS,
    starts_at_rest: StartsAtRest = False,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Write an identified motor for another program.

    RESULT is a run's folder, or a file that `servobench identify FILE --json` printed; a FILE with a recording is identified
    first, with the column options of that command. The targets: control (a Python file for
    python-control), matlab (.m and .mat, Octave too), wpilib (kS, kV, kA, kG and feedback gains), mujoco (a joint and its
    actuator), c (a speed controller in C99, with its test), json, csv. A refused result exports nothing.
    """
    from servobench.cli.output_file import check_free
    from servobench.cli.recordings import motor_in
    from servobench.cli.terminal import messages, output, print_json, say
    from servobench.cli.written import document_of_files
    from servobench.export.base import TARGETS, Wishes

    suffix = TARGETS[target].suffix
    file = out if out is not None else Path(default_name(target))
    named = file if file.suffix else file.with_name(file.name + suffix)
    check_free(named, "--out", [motor, reading.mapping], overwrite)
    wishes = Wishes(
        unit=position_unit,
        sample_time=_quantity("--controller-sample-time", controller_sample_time, "s"),
        inertia=_quantity("--inertia", inertia, "kg*m^2"),
        closed_loop=_quantity("--closed-loop", closed_loop, "s"),
        counts_per_rev=controller_counts_per_rev,
        voltage_limit=_quantity("--voltage-limit", voltage_limit, "V"),
    )
    answer = motor_in(motor, reading, starts_at_rest)
    files = _export(answer, target, file, wishes)
    console = messages() if as_json else output()
    for written in files:
        say(console, f"written: {written}")
    if answer.verdict == "doubtful":
        say(console, "The result is doubtful; the file gives the reasons where it has room for them.")
    if as_json:
        print_json(document_of_files(files))


def _export(answer: ResultSummary, target: str, file: Path, wishes: Wishes) -> tuple[Path, ...]:
    """The files written; what a message calls by Python's keyword it calls by this command's option."""
    from servobench.core.errors import UsageError
    from servobench.export.base import export as exported

    try:
        return exported(answer, target, file, wishes)
    except UsageError as error:
        error.args = (with_options(str(error), CONTROLLER),)
        raise


def default_name(target: str) -> str:
    """Return the file that a target writes without --out: another one for each, so that none replaces another's."""
    from servobench.export.base import TARGETS

    suffix = TARGETS[target].suffix
    shared = any(TARGETS[each].suffix == suffix for each in TARGETS.names() if each != target)
    return f"motor-{target}{suffix}" if shared and suffix != f".{target}" else f"motor{suffix}"


def _quantity(option: str, text: str | None, si: str) -> float | None:
    """What an option says, in its SI unit."""
    from servobench.core.errors import UnitError, UsageError
    from servobench.core.units import quantity

    if text is None:
        return None
    try:
        return quantity(text, si)
    except UnitError as error:
        raise UsageError(f"{option}: {error}") from None
