"""`servobench stability`: poles, verdict and reasons of an identified motor, and of a position loop around it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.failures import DONE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from servobench.result import Result
    from servobench.transfer_function import TransferFunction


def stability(
    motor: Annotated[Path, typer.Argument(metavar="RESULT | FILE", hidden=True)],
    kp: Annotated[
        str,
        typer.Option(metavar="K", help="The gain of a position loop around the motor [V/rad]."),
    ] = "1",
) -> None:
    """Say whether an identified motor is stable, and a position loop around it.

    RESULT is a run's folder or a result.json; a FILE with a recording is identified first. Printed are the poles, what they
    mean, a bounded input that drives the position off, and verdict and margins of the loop with its delay. Of a FILE also what
    the record itself can say, and whether the verdicts hold for all parameters that it leaves open.
    """
    from servobench.cli.terminal import output

    out = output()
    gain = _gain(kp)
    if motor.is_dir() or motor.suffix == ".json" or not motor.exists():
        from servobench.export.answer import Answer

        _of_the_motor(out, Answer.read(motor).transfer_function, gain)
        raise typer.Exit(DONE)
    result = _identified(out, motor)
    if result.transfer_function is None:
        from servobench.errors import NotIdentifiable

        told = " ".join(finding.sentence for finding in result.findings)
        raise NotIdentifiable(f"{motor}: the record tells no motor, so nothing is said of its poles. {told}")
    _of_the_motor(out, result.transfer_function, gain)
    _over_intervals(out, result, gain)
    raise typer.Exit(DONE)


def _gain(text: str) -> float:
    from servobench.errors import UnitError, UsageError
    from servobench.units import quantity

    try:
        gain = quantity(text, "V/rad")
    except UnitError as error:
        raise UsageError(f"--kp {text}: {error}") from None
    if gain == 0:
        raise UsageError("--kp 0: without a gain there is no loop; expected another number, such as 2")
    return gain


def _identified(out: Console, path: Path) -> Result:
    """What a file's recordings tell of the motor, after saying what the records themselves do of stability."""
    from servobench.cli.progress import Progress, told_when_compiling
    from servobench.formats.base import load
    from servobench.identification import identify
    from servobench.measurement.measure import measure
    from servobench.stability_analysis.record import bibo

    records = [measure(each) for each in load(path)]
    for data in records:
        _say(out, f"The record {data.name}", bibo(data).sentences)
    with Progress() as progress, told_when_compiling(progress):
        progress.begin("identifying")
        return identify(records)


def _of_the_motor(out: Console, speed: TransferFunction, kp: float) -> None:
    """Print what the poles mean to the speed and to the position, and what a loop around the latter does."""
    from dataclasses import replace

    from servobench.margins import margins
    from servobench.rounding import plain
    from servobench.stability_analysis.nyquist import closed_loop
    from servobench.stability_analysis.verdict import stability as judged

    turned, _, driven_by = speed.unit.partition("/(s·")
    position = replace(
        speed,
        denominator=(*speed.denominator, 0.0),
        output="position",
        unit=f"{turned}/{driven_by.removesuffix(')')}",
        delay=max(speed.delay, 0.0),
    )
    for system in (speed, position):
        found = judged(system)
        bounded = "BIBO stable" if found.bibo else "not BIBO stable"
        drive = (found.drive.sentence,) if found.drive else ()
        _say(out, f"To the {system.output}: {found.verdict}, {bounded}", (*found.reasons, *drive))
    loop = replace(position, numerator=tuple(kp * c for c in position.numerator))
    closed, left = closed_loop(loop), margins(loop)
    _say(
        out,
        f"The position loop with {plain(kp)} V/rad: {closed.verdict}",
        (
            closed.sentence,
            f"Gain margin {plain(left.gain_margin)}, phase margin {plain(math.degrees(left.phase_margin), 3)}°, delay margin "
            f"{plain(left.delay_margin, 3)} s.",
        ),
    )


def _over_intervals(out: Console, result: Result, kp: float) -> None:
    from servobench.stability_analysis.intervals import loop_over_intervals, stability_over_intervals
    from servobench.transfer_function import TransferFunction

    if result.fit is None:
        return
    feedback = TransferFunction(numerator=(kp,), denominator=(1.0,), output="input", unit="1")
    _say(
        out,
        "What the data leave open",
        (
            stability_over_intervals(result.fit, "speed").sentence,
            loop_over_intervals(result.fit, feedback).sentence,
        ),
    )


def _say(out: Console, heading: str, sentences: Sequence[str]) -> None:
    from servobench.cli.terminal import printable

    out.print(printable(heading))
    for sentence in sentences:
        out.print(printable(f"- {sentence}"))
    out.print()
