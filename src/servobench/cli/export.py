"""`servobench export`: an identified motor in another program's format."""

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
    from rich.console import Console

    from servobench.export.base import Wishes
    from servobench.export.summary import ResultSummary


@with_reading
def export(
    motor: Annotated[Path, typer.Argument(metavar="RESULT | FILE", hidden=True)],
    target: Annotated[
        str,
        typer.Option(
            "--as",
            metavar="TARGET",
            help="control, matlab, wpilib, java, cpp, python, mujoco, c, json or csv.",
        ),
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
            "--unit",
            metavar="UNIT",
            help="The unit of position: rev, rad, deg, m, ft, inch; by default the file's for robot code, rad for c.",
        ),
    ] = None,
    wheel_diameter: Annotated[
        str | None,
        typer.Option(
            metavar="D",
            help="The diameter of the wheel that turns once with the encoder, such as 6in, for lengths [m].",
        ),
    ] = None,
    measurement_delay: Annotated[
        str | None,
        typer.Option(
            metavar="S", help="How late the robot's loop gets its measurement, beyond the data's delay [s]."
        ),
    ] = None,
    controller_sample_time: ControllerSampleTime = None,
    closed_loop: Annotated[
        str | None,
        typer.Option(
            metavar="S", help="The desired time constant of the closed loop [s], for robot code and c."
        ),
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

    RESULT is a run's folder, or a file that `servobench identify FILE --json` printed; for c also one of `servobench tune
    --json`, whose controller is then exported. A FILE with a recording is identified first, with the column options of
    `servobench identify`. The targets: control (a Python file for
    python-control), matlab (.m and .mat, Octave too), wpilib (kS, kV, kA, kG or kCos and feedback gains as JSON), java, cpp,
    python (the same as robot code), mujoco (a joint and its actuator), c (a speed controller in C99, with its test), json,
    csv. A refused result exports nothing.
    """
    from servobench.cli.output_file import check_free
    from servobench.cli.recordings import motor_in
    from servobench.cli.terminal import messages, output, print_json, say
    from servobench.cli.written import document_of_files
    from servobench.core.errors import UsageError
    from servobench.export.base import TARGETS, Wishes, check_wishes
    from servobench.export.base import export as exported
    from servobench.export.c_law import export_law, read_tuning

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
        wheel_diameter=_quantity("--wheel-diameter", _with_its_unit(wheel_diameter), "m"),
        measurement_delay=_quantity("--measurement-delay", measurement_delay, "s"),
    )
    console = messages() if as_json else output()
    tuned = read_tuning(motor)
    if tuned is not None and target != "c":
        raise UsageError(f"{motor} is a tuned controller, which is exported as c; {target} takes a result")
    answer = None if tuned is not None else motor_in(motor, reading, starts_at_rest)
    try:
        if tuned is not None:
            files = export_law(tuned, file, wishes)
        elif answer is not None:
            check_wishes(target, wishes)
            _show_constants(console, answer, target, wishes)
            # A target may write more files than the one that is named.
            files = exported(
                answer,
                target,
                file,
                wishes,
                check=lambda each: check_free(each, "--out", [motor, reading.mapping], overwrite),
            )
    except UsageError as error:  # which calls by Python's keyword what is an option of this command
        error.args = (with_options(str(error), CONTROLLER),)
        raise
    for written in files:
        say(console, f"written: {written}")
    if answer is not None and answer.verdict == "doubtful":
        say(console, "The result is doubtful; the file gives the reasons where it has room for them.")
    for caution in answer.cautions if answer is not None else ():
        say(console, f"! {caution}")
    if as_json:
        print_json(document_of_files(files))


def default_name(target: str) -> str:
    """Return the file that a target writes without --out: another one for each, so that none replaces another's."""
    from servobench.export.base import TARGETS

    if target in _NAMES:
        return _NAMES[target]
    suffix = TARGETS[target].suffix
    shared = any(TARGETS[each].suffix == suffix for each in TARGETS.names() if each not in {target, *_NAMES})
    return f"motor-{target}{suffix}" if shared and suffix != f".{target}" else f"motor{suffix}"


_NAMES = {"java": "MotorConstants.java", "cpp": "motor_constants.h", "python": "motor_constants.py"}


def _show_constants(console: Console, answer: ResultSummary, target: str, wishes: Wishes) -> None:
    """Print the constants of robot code with their intervals; nothing for other targets."""
    from servobench.cli.layout import show_table
    from servobench.cli.terminal import say
    from servobench.export.robot import (
        TARGETS_OF_ROBOTS,
        interval_text,
        next_tests_of,
        number_text,
        robot_constants,
    )

    if target not in TARGETS_OF_ROBOTS:
        return
    constants = robot_constants(answer, target, wishes)
    rows = [
        (name, number_text(e.value, e), e.unit, interval_text(e)) for name, e in constants.feedforward.items()
    ]
    show_table(console, ("constant", "value", "unit", "95 % interval"), rows, right=("value",))
    for note in constants.notes:
        say(console, note)
    if further := next_tests_of(answer, constants.period):
        say(console, "Tests that would sharpen kA, the best first:")
        for number, sentence in enumerate(further, 1):
            say(console, f"  {number}. {sentence}")
    console.print()


def _with_its_unit(diameter: str | None) -> str | None:
    """A wheel's diameter as it was typed; raises `UsageError` for a bare number, which some mean in inches."""
    from servobench.core.errors import UsageError

    try:
        float(diameter or "")
    except ValueError:
        return diameter
    raise UsageError(
        f"--wheel-diameter {diameter} has no unit; write one, such as {diameter}in or {diameter}cm"
    )


def _quantity(option: str, text: str | None, si: str) -> float | None:
    """The value of an option in its SI unit."""
    from servobench.core.errors import UnitError, UsageError
    from servobench.core.units import quantity

    if text is None:
        return None
    try:
        return quantity(text, si)
    except UnitError as error:
        raise UsageError(f"{option}: {error}") from None
