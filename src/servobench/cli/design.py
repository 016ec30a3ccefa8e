"""`servobench design`: the experiment with the smallest interval under limits, and what it will tell."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.failures import DONE
from servobench.cli.options import AS_IT_IS, AsJson, DataSheet, Overwrite, Reading, StartsAtRest, with_reading
from servobench.core.rounding import TWO_SIDED

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from servobench.identification.design.assumed_motor import AssumedMotor
    from servobench.identification.design.search import Design, RatedSignal, Wish

_BAR = 20  # characters of the longest bar


@with_reading
def design(
    voltage_limit: Annotated[
        str, typer.Option("--voltage-limit", metavar="V", help="The largest voltage, either way [V].")
    ],
    nominal: DataSheet = None,
    known_from: Annotated[
        Path | None,
        typer.Option(
            "--from",
            metavar="FILE",
            help="What is known about the motor: a result.json, or a recording, which is identified first.",
        ),
    ] = None,
    duration: Annotated[str, typer.Option(metavar="S", help="The duration [s].")] = "10",
    experiment_sample_time: Annotated[
        str, typer.Option(metavar="S", help="The time between samples of the experiment [s].")
    ] = "0.002",
    current_limit: Annotated[str | None, typer.Option(metavar="A", help="The largest current [A].")] = None,
    speed_limit: Annotated[str | None, typer.Option(metavar="W", help="The largest speed [rad/s].")] = None,
    travel_limit: Annotated[
        str | None,
        typer.Option(
            metavar="X", help="How far the shaft may go from its start, either way [rad], such as 4rev."
        ),
    ] = None,
    wish: Annotated[
        str,
        typer.Option("--for", metavar="WHAT", help="What to determine best: time_constant, gain or both."),
    ] = "both",
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the experiment (TOML), for `servobench run FILE`."),
    ] = None,
    reading: Reading = AS_IT_IS,
    starts_at_rest: StartsAtRest = False,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
) -> None:
    """Find the experiment with the smallest interval under limits.

    Squares, random sequences, staircases and multisines of many sizes and speeds are compared for the motor as far as it is
    known: from a result or a recording, or else from its data sheet, by default that of qube_servo_2. The limits hold for every
    motor within the tolerance, 20 % for a data sheet. The result is an experiment and its predicted standard deviations,
    before anything has moved.
    """
    from servobench.cli.output_file import check_free
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.terminal import messages, output, print_json, say
    from servobench.identification.design.limits import DesignLimits
    from servobench.identification.design.search import best_design as best

    limits = DesignLimits(
        voltage=_in("--voltage-limit", voltage_limit, "V"),
        current=_maybe("--current-limit", current_limit, "A"),
        speed=_maybe("--speed-limit", speed_limit, "rad/s"),
        travel=_maybe("--travel-limit", travel_limit, "rad"),
    )
    target, length = _wish(wish), _in("--duration", duration, "s")
    step = _in("--experiment-sample-time", experiment_sample_time, "s")
    check_free(out, "--out", [known_from, reading.mapping], overwrite)
    motor = _motor(nominal, known_from, reading, starts_at_rest)
    with Progress() as progress, announce_compiling(progress):
        progress.begin("comparing experiments")
        made = best(motor, limits, length, step, target)
    console = messages() if as_json else output()
    if out is not None:
        _write(out, made.experiment.to_toml())
    _show(console, made, motor)
    if out is not None:
        say(console, f"\nexperiment: {out}")
    if as_json:
        print_json(made.to_dict())
    raise typer.Exit(DONE)


def _motor(
    nominal: str | None, known_from: Path | None, reading: Reading, starts_at_rest: bool
) -> AssumedMotor:
    """The assumed motor: from a data sheet, a result, or a recording."""
    from servobench.cli.recordings import identify_file, is_result, refuse_reading
    from servobench.core.errors import UsageError
    from servobench.identification.design.assumed_motor import from_data_sheet, from_result

    if nominal is not None and known_from is not None:
        raise UsageError("--nominal and --from both describe the motor; give one of them")
    if known_from is None:
        flags = [*reading.flags, *(["--starts-at-rest"] if starts_at_rest else [])]
        if flags:
            raise UsageError(
                f"{' and '.join(flags)} can't be used with a data sheet; leave that out, or give a recording with --from FILE"
            )
        return from_data_sheet(nominal or "qube_servo_2")
    if is_result(known_from):
        refuse_reading(known_from, reading, starts_at_rest, usable=("--counts-per-rev",))
        return _of_result(known_from, reading.counts_per_rev)
    return from_result(identify_file(known_from, reading, starts_at_rest), str(known_from))


def _of_result(path: Path, counts_per_rev: float | None) -> AssumedMotor:
    """The motor of a result, whose encoder it doesn't hold; raises `MissingInformation` without that."""
    from servobench.core.errors import MissingInformation, UsageError
    from servobench.export.summary import ResultSummary
    from servobench.identification.design.assumed_motor import from_result_file

    if counts_per_rev is not None and not (math.isfinite(counts_per_rev) and counts_per_rev > 0):
        raise UsageError(f"--counts-per-rev {counts_per_rev:g}: expected a number above 0")
    content = ResultSummary.read(path).document
    if counts_per_rev is None:
        raise MissingInformation(str(path), ["the encoder, which isn't in a result: --counts-per-rev N"])
    return from_result_file(content, str(path), counts_per_rev)


def _show(console: Console, made: Design, motor: AssumedMotor) -> None:
    """Print the experiment, what it will tell, and how it compares."""
    from rich.text import Text

    from servobench.cli.layout import show_wrapped
    from servobench.cli.option_names import with_options
    from servobench.cli.terminal import say

    say(
        console,
        f"{made.chosen.family}, {made.experiment.duration:g} s at {made.experiment.sample_rate:g} Hz:",
    )
    for line in made.experiment.to_toml().partition("[signal]")[2].partition("\n[")[0].strip().splitlines():
        say(console, f"  {line}")
    say(console, "")
    _show_predictions(console, made, motor)
    _show_comparison(console, made)
    limits = ", ".join(f"{name} ({100 * part:.0f} % used)" for name, part in made.chosen.used.items())
    say(console, f"\nlimits: {limits}")
    say(console, f"limited by: {' and '.join(made.active)}")
    say(console, "assumed:")
    for sentence in made.assumptions:
        show_wrapped(console, Text("  - "), with_options(sentence), hanging=4)


def _show_predictions(console: Console, made: Design, motor: AssumedMotor) -> None:
    """Print the predicted standard deviation of each parameter."""
    from servobench.cli.layout import show_table
    from servobench.core.parameter_names import parameter_in_words
    from servobench.core.rounding import round_value
    from servobench.identification.models.base import STRUCTURES

    structure = STRUCTURES[made.chosen.structure]
    values = dict(zip((p.name for p in structure.parameters), motor.theta(structure), strict=False))
    headings = ("parameter", "assumed", "predicted ± (95 %)", "relative", "unit")
    rows = []
    for parameter in structure.parameters:
        value, half = float(values[parameter.name]), TWO_SIDED * made.chosen.sd[parameter.name]
        text = round_value(value, half, parameter.unit.format(position="rad", input="V"))
        share = f"{100 * half / abs(value):.2g} %" if value else ""
        rows.append(
            (parameter_in_words(parameter.name), text.value.replace("−", "-"), text.half, share, text.unit)
        )
    show_table(console, headings, rows, right=headings[1:4])
    console.print()


def _show_comparison(console: Console, made: Design) -> None:
    """Print the experiments side by side, with a picture: bars on a logarithmic scale."""
    from servobench.cli.layout import show_table

    every = (made.chosen, *made.others, made.paper)
    headings = ("experiment", "gain ±", "time constant ±", "smaller is better")
    lengths = _bars([_cost(each, made.wish) for each in every])
    rows = [
        (
            each.family + (" (chosen)" if each is made.chosen else ""),
            *(f"{100 * TWO_SIDED * each.relative[name]:.2g} %" for name in ("gain", "time_constant")),
            "#" * length + _remark(each),
        )
        for each, length in zip(every, lengths, strict=True)
    ]
    show_table(console, headings, rows, right=headings[1:3])


def _remark(each: RatedSignal) -> str:
    """The reason why an experiment can't be used as it is."""
    beyond = [name for name, part in each.used.items() if part > 1]
    if beyond:
        return f" beyond {' and '.join(beyond)}"
    return " rounding repeats" if each.rounding > 1.25 else ""


def _cost(each: RatedSignal, wish: Wish) -> float:
    from servobench.identification.design.search import cost

    return cost(each, wish)


def _bars(costs: Sequence[float]) -> list[int]:
    """Lengths of bars: the longest for the largest, a third less for each factor of ten, at least one character."""
    largest = max(costs)
    return [max(1, round(_BAR * (1 + math.log10(each / largest) / 3))) for each in costs]


def _in(option: str, text: str, unit: str) -> float:
    """A quantity with its unit, or in SI units."""
    from servobench.core.errors import UnitError, UsageError
    from servobench.core.units import quantity

    try:
        return quantity(text, unit)
    except UnitError as error:
        raise UsageError(f"{option}: {error}") from None


def _maybe(option: str, text: str | None, unit: str) -> float | None:
    return None if text is None else _in(option, text, unit)


def _wish(text: str) -> Wish:
    from servobench.core.errors import UnknownName

    known: dict[str, Wish] = {"time_constant": "time_constant", "gain": "gain", "both": "both"}
    if text not in known:
        raise UnknownName("wish", text, known)
    return known[text]


def _write(path: Path, text: str) -> None:
    from servobench.core.errors import StorageError

    try:
        path.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise StorageError(f"--out {path}: can't be written: {error.strerror or error}") from error
