"""`servobench stability`: poles, verdict and reasons of an identified motor, and of a position loop around it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from servobench.cli.failures import DONE
from servobench.cli.options import (
    AS_IT_IS,
    AsJson,
    ControllerSampleTime,
    Reading,
    StartsAtRest,
    with_reading,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from servobench.export.summary import ResultSummary
    from servobench.identification.estimators.base import Fit
    from servobench.identification.result import Result
    from servobench.recordings.measurement.dataset import Dataset
    from servobench.systems.stability.proportional import ProportionalLoop
    from servobench.systems.transfer_function import TransferFunction

# What poles, rates and margins are made of; friction is no part of them.
_NEEDED = ("gain", "time_constant", "electrical_time_constant", "delay")
_IN_COUNTS = (
    "The motor is in counts, and so is this gain: identify with --counts-per-rev N to have both in rad."
)
_MOST_DELAYED = 1000  # ticks; each is a state of the loop, and the work grows with their cube
_ADDED = (
    "A phase margin below zero comes from a loop whose gain is 1 at several frequencies: it is phase that "
    "may be added, not lost."
)
_FALLS = "A gain margin below 1 is the factor to which the gain may fall."
_ON_PAPER = "They are for the continuous loop; a sampled loop has a smaller gain margin."
_UNSTATED = "The result doesn't contain the sample time of its data: give --controller-sample-time for the sampled loop."


@with_reading
def stability(
    motor: Annotated[Path, typer.Argument(metavar="RESULT | FILE", hidden=True)],
    kp: Annotated[
        str,
        typer.Option(
            metavar="K",
            help="The gain of a position loop around the motor, in the motor's units: V/rad, V/counts, %/rad ...",
        ),
    ] = "1",
    controller_sample_time: ControllerSampleTime = None,
    continuous: Annotated[
        bool,
        typer.Option(
            "--continuous",
            help=("Judge the continuous loop, without sampling; a sampled one tolerates less gain."),
        ),
    ] = False,
    reading: Reading = AS_IT_IS,
    starts_at_rest: StartsAtRest = False,
    as_json: AsJson = False,
) -> None:
    """Say whether an identified motor and a position loop around it are stable.

    RESULT is a run's folder or a result.json; a FILE with a recording is identified first, with the same column options as
    `servobench identify`. The output lists the poles and their meaning, a bounded input that makes the position unbounded,
    and verdict and margins of the sampled loop with its delay, at the sample time of the data, or at
    --controller-sample-time. For a FILE it adds what the record itself shows, and whether the verdicts hold for all parameters
    consistent with the data.
    """
    from servobench.cli.recordings import is_result, refuse_reading
    from servobench.cli.stability_document import SCHEMA
    from servobench.cli.terminal import messages, output, print_json
    from servobench.core.json_numbers import finite
    from servobench.export.summary import ResultSummary

    out = messages() if as_json else output()
    document: dict[str, Any] = {"schema": SCHEMA, "records": [], "over_intervals": []}
    requested_ticks = _ticks_of(controller_sample_time, continuous)
    fit, gain_unit = None, ""
    if is_result(motor):
        refuse_reading(motor, reading, starts_at_rest)
        answer = ResultSummary.read(motor)
    else:
        result, document["records"] = _result_and_records(out, motor, reading, starts_at_rest, kp)
        answer, fit = ResultSummary.of(result), result.fit
        gain_unit = _gain_unit(result.data[0])
    ticks = None if continuous else requested_ticks or answer.sample_time
    _check_ticks(answer, ticks)
    document |= _of_an_answer(out, answer, kp, ticks, continuous)
    if fit is not None:
        document["over_intervals"] = _over_intervals(out, fit, _gain(kp, gain_unit), ticks)
    if as_json:
        print_json(finite(document))
    raise typer.Exit(DONE)


def _ticks_of(text: str | None, continuous: bool) -> float | None:
    """The sample time of the loop [s] where one is requested; raises `UsageError` where it can't be one."""
    from servobench.core.errors import UnitError, UsageError
    from servobench.recordings.formats.timing import seconds

    if text is None:
        return None
    if continuous:
        raise UsageError(
            f"--controller-sample-time {text}: a continuous loop has no ticks; leave out --continuous or "
            "--controller-sample-time"
        )
    try:
        return seconds(text)
    except (UnitError, UsageError) as error:
        raise UsageError(f"--controller-sample-time: {error}") from None


def _check_ticks(answer: ResultSummary, sample_time: float | None) -> None:
    """Raise `UsageError` for a sample time [s] of which the motor's delay takes more than can be worked with."""
    from servobench.core.errors import UsageError

    delay = answer.transfer_function.delay
    if sample_time is not None and delay > _MOST_DELAYED * sample_time:
        raise UsageError(
            f"--controller-sample-time {sample_time:g}: the motor's delay of {delay:.3g} s takes more than {_MOST_DELAYED} "
            f"such ticks; expected {1.1 * delay / _MOST_DELAYED:.2g} s at least, or --continuous for the loop without ticks"
        )


def _gain(text: str, unit: str) -> float:
    """The gain in a text, in the unit that the motor asks for; raises `UsageError` where it isn't one."""
    from servobench.core.errors import UnitError, UsageError
    from servobench.core.units import quantity

    try:
        gain = quantity(text, unit)
    except UnitError as error:
        raise UsageError(f"--kp {text}: {error}") from None
    if gain == 0:
        raise UsageError("--kp 0: without a gain there is no loop; expected another number, such as 2")
    return gain


def _gain_unit(data: Dataset) -> str:
    return f"{data.input_unit}/{data.position_unit}"


def _result_and_records(
    out: Console, path: Path, reading: Reading, starts_at_rest: bool, kp: str
) -> tuple[Result, list[dict[str, Any]]]:
    """The motor from a file's recordings; the records' own evidence of stability is printed."""
    from servobench.cli.conclusion import conclude
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.recordings import evidence_of, load_all
    from servobench.cli.stability_document import of_a_record
    from servobench.recordings.boundedness import bibo

    with Progress() as progress:
        evidence = evidence_of(load_all([path], progress, reading), reading)
    records = [each.dataset(starts_at_rest) for each in evidence]
    _gain(kp, _gain_unit(records[0]))  # a mistake in it is reported before any work is done
    lines = []
    for data in records:
        report = bibo(data)
        _say(out, f"The record {data.name}", report.sentences)
        lines.append(of_a_record(data, report))
    with Progress() as progress, announce_compiling(progress):
        return conclude(evidence, progress, starts_at_rest=starts_at_rest), lines


def _of_an_answer(
    out: Console, answer: ResultSummary, kp: str, sample_time: float | None, continuous: bool
) -> dict[str, Any]:
    """Print what a result lets be said, and return it as plain data.

    The loop runs every `sample_time` [s]; where that is None it is judged without ticks, because that is requested
    (`continuous`) or the result doesn't state any. Raises `NotIdentifiable` where it doesn't know the motor's parameters.
    """
    from servobench.core.errors import NotIdentifiable
    from servobench.core.parameter_names import parameter_in_words

    unknown = [
        parameter_in_words(name, answer.estimates[name].unit)
        for name in _NEEDED
        if name in answer.estimates and not all(map(math.isfinite, answer.estimates[name].interval))
    ]
    if unknown == ["gain"]:
        _of_a_system(out, answer.transfer_function)
    if unknown:
        what = "The gains it allows and the margins of a loop" if unknown == ["gain"] else "Poles and margins"
        raise NotIdentifiable(
            f"{what} can't be computed: the data don't determine the {' and the '.join(unknown)}. `servobench "
            "identify` says what to record instead."
        )
    reasons: list[str] = []
    if answer.verdict == "doubtful":
        reasons = [f["sentence"] for f in answer.document["findings"] if f["severity"] == "warning"]
        _say(out, "The motor's result is doubtful, and so is everything below", reasons)
    if answer.cautions:
        _say(out, "Not all of the motor is known", answer.cautions)
    position, driven_by = answer.units
    unit = f"{driven_by}/{position}"
    unstated = () if continuous or sample_time is not None else (_UNSTATED,)
    return {
        "motor": {"verdict": answer.verdict, "doubts": reasons, "cautions": list(answer.cautions)},
        **_of_the_motor(out, answer.transfer_function, _gain(kp, unit), unit, sample_time, unstated),
    }


def _of_the_motor(
    out: Console,
    speed: TransferFunction,
    kp: float,
    kp_unit: str,
    sample_time: float | None,
    unstated: tuple[str, ...],
) -> dict[str, Any]:
    """Print what the poles mean to the speed and to the position, and what a loop around the latter does."""
    from dataclasses import replace

    from servobench.cli.stability_document import of_a_loop
    from servobench.core.rounding import plain
    from servobench.systems.stability.proportional import (
        continuous_proportional_loop,
        sampled_proportional_loop,
    )

    turned, _, driven_by = speed.unit.partition("/(s·")
    position = replace(
        speed,
        denominator=(*speed.denominator, 0.0),
        output="position",
        unit=f"{turned}/{driven_by.removesuffix(')')}",
        delay=max(speed.delay, 0.0),
    )
    systems = [_of_a_system(out, system) for system in (speed, position)]
    loop = (
        continuous_proportional_loop(position, kp)
        if sample_time is None
        else sampled_proportional_loop(position, kp, sample_time)
    )
    sentences = (
        loop.closed.sentence,
        *_margin_sentences(loop),
        *(_bears(loop.stable_factors) if loop.stable_factors is not None else ()),
        *unstated,
        *((_IN_COUNTS,) if turned == "counts" else ()),
    )
    how = "continuous" if sample_time is None else f"computed every {plain(1000 * sample_time)} ms"
    _say(out, f"The position loop with {plain(kp)} {kp_unit}, {how}: {loop.closed.verdict}", sentences)
    return {"systems": systems, "loop": of_a_loop(kp, kp_unit, loop, sentences)}


def _of_a_system(out: Console, system: TransferFunction) -> dict[str, Any]:
    from servobench.cli.stability_document import of_a_system
    from servobench.systems.stability.verdict import stability as judged

    report = judged(system)
    bounded = "BIBO stable" if report.bibo else "not BIBO stable"
    drive = (report.drive.sentence,) if report.drive else ()
    _say(out, f"To the {system.output}: {report.verdict}, {bounded}", (*report.reasons, *drive))
    return of_a_system(system, report)


def _margin_sentences(loop: ProportionalLoop) -> tuple[str, ...]:
    """The margins of a stable loop; nothing for an unstable one."""
    from servobench.core.rounding import plain

    left = loop.margins
    if left is None or loop.delay_margin is None:
        return ()
    return (
        f"Gain margin {plain(left.gain_margin)}, phase margin {plain(math.degrees(left.phase_margin), 3)}°, delay margin "
        f"{plain(loop.delay_margin, 3)} s.",
        *((_ADDED,) if left.phase_margin < 0 else ()),
        *((_FALLS,) if left.gain_margin < 1 else ()),
        *((_ON_PAPER,) if loop.sample_time is None else ()),
    )


def _bears(ranges: Sequence[tuple[float, float]]) -> tuple[str, ...]:
    """With what part or multiple of its gain a loop that isn't stable would be."""
    from servobench.core.rounding import plain

    smaller = [(low, min(high, 1.0)) for low, high in ranges if low < 1]
    if smaller:
        low, high = smaller[-1]
        below = f"between {plain(low)} and {plain(high)}" if low else f"less than {plain(high)}"
        return (f"With {below} of this gain it would be stable.",)
    why = "It has no margins, as only a stable loop has them:"
    if ranges:
        return (
            f"{why} only a larger gain makes this loop stable, from {plain(ranges[0][0])} times this gain.",
        )
    return (f"{why} no gain of this sign makes this loop stable.",)


def _over_intervals(out: Console, fit: Fit, kp: float, sample_time: float | None) -> list[dict[str, Any]]:
    from servobench.cli.stability_document import over_intervals
    from servobench.identification.uncertainty import stability as intervals
    from servobench.systems.transfer_function import TransferFunction

    feedback = TransferFunction(numerator=(kp,), denominator=(1.0,), output="input", unit="1")
    speed = intervals.stability_over_intervals(fit, "speed")
    if sample_time is None:
        loop = intervals.continuous_loop_over_intervals(fit, feedback)
    else:
        loop = intervals.loop_over_intervals(fit, feedback, sample_time=sample_time)
    _say(out, "What the data leave undetermined", (speed.sentence, loop.sentence))
    return [over_intervals("speed", speed), over_intervals("position_loop", loop)]


def _say(out: Console, heading: str, sentences: Sequence[str]) -> None:
    from servobench.cli.option_names import with_options
    from servobench.cli.terminal import printable

    out.print(printable(heading))
    for sentence in sentences:
        out.print(printable(f"- {with_options(sentence)}"))
    out.print()
