"""`servobench tune`: gains of a controller for an identified motor, and the margins that are left."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.failures import DONE
from servobench.cli.option_names import TUNE, with_options
from servobench.cli.options import (
    AS_IT_IS,
    AsJson,
    ControllerSampleTime,
    Reading,
    StartsAtRest,
    VoltageLimit,
    with_reading,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rich.console import Console

    from servobench.export.summary import ResultSummary
    from servobench.systems.control.running import Output
    from servobench.systems.tuning.base import Wish
    from servobench.systems.tuning.loop import LoopValue
    from servobench.systems.tuning.tune import TuningResult

_VOLTAGE_LIMIT = 10.0  # V
_NOTHING = 1e-6  # of a margin, an overshoot, a time [s]
_WORDS = {
    "gain_margin": "gain margin (factor)",
    "gain_margin_downwards": "gain margin downwards (factor)",
    "phase_margin": "phase margin",
    "delay_margin": "delay margin",
    "gain_crossover": "gain crossover",
    "overshoot": "overshoot",
    "rise_time": "rise time, 10 to 90 %",
}


@with_reading
def tune(
    motor: Annotated[Path, typer.Argument(metavar="RESULT | FILE", hidden=True)],
    controller: Annotated[
        str, typer.Option("--as", metavar="CONTROLLER", help="pid, state_feedback or lead.")
    ] = "pid",
    loop: Annotated[
        str, typer.Option(metavar="WHAT", help="What the controller follows: position or speed.")
    ] = "position",
    method: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="pole_placement or lambda_tuning; --lambda alone means the latter."
        ),
    ] = None,
    damping: Annotated[
        float | None, typer.Option(metavar="Z", help="The damping of a pair of poles, such as 0.8.")
    ] = None,
    bandwidth: Annotated[
        str | None, typer.Option(metavar="W", help="The distance of these poles from zero [rad/s].")
    ] = None,
    poles: Annotated[
        str | None,
        typer.Option(
            metavar="P,P",
            help="The poles themselves [rad/s], such as -20,-15+10j: three for an integral part.",
        ),
    ] = None,
    closed_loop: Annotated[
        str | None,
        typer.Option("--lambda", metavar="S", help="The desired time constant of the closed loop [s]."),
    ] = None,
    controller_sample_time: ControllerSampleTime = None,
    voltage_limit: VoltageLimit = None,
    step: Annotated[
        str | None,
        typer.Option(
            metavar="X", help="A step of the reference that must stay within that limit [rad or rad/s]."
        ),
    ] = None,
    cutoff: Annotated[
        str | None, typer.Option(metavar="W", help="The cut-off of the speed's filter [rad/s].")
    ] = None,
    reading: Reading = AS_IT_IS,
    starts_at_rest: StartsAtRest = False,
    as_json: AsJson = False,
) -> None:
    """Find the gains of a controller for an identified motor.

    RESULT is a run's folder or a result.json; a FILE with a recording is identified first, with the column options of
    `servobench identify`. The controller runs at the sample time of the data and puts out 10 V at most, unless options say
    otherwise. The output lists the obtained and
    the requested poles, the margins and the step response, with 95 % intervals from the uncertainty of the data, and a table
    [controller] to paste into an experiment's file. A request that delay, sample time or voltage don't allow, or that would
    be missed by more than 3 %, is refused with the nearest possible one.
    """
    from servobench.cli.recordings import motor_in
    from servobench.cli.terminal import messages, print_json
    from servobench.cli.terminal import output as standard_output
    from servobench.systems.tuning.base import Wish

    followed = _loop_output(loop)
    answer = motor_in(motor, reading, starts_at_rest)
    made = _tune(
        answer,
        method or ("lambda_tuning" if closed_loop is not None else "pole_placement"),
        Wish(
            controller=controller,
            output=followed,
            sample_time=_positive("--controller-sample-time", controller_sample_time, "s")
            or _own_sample_time(answer),
            voltage_limit=_positive("--voltage-limit", voltage_limit, "V") or _VOLTAGE_LIMIT,
            step=_positive("--step", step, "rad" if followed == "position" else "rad/s"),
            damping=damping,
            bandwidth=_positive("--bandwidth", bandwidth, "rad/s"),
            poles=_poles(poles),
            closed_loop=_positive("--lambda", closed_loop, "s"),
            cutoff=_positive("--cutoff", cutoff, "rad/s"),
        ),
    )
    _show(messages() if as_json else standard_output(), made)
    if as_json:
        print_json(made.to_dict())
    raise typer.Exit(DONE)


def _tune(answer: ResultSummary, method: str, wish: Wish) -> TuningResult:
    """The gains; what a message calls by Python's keyword it calls by this command's option."""
    from servobench.core.errors import UsageError
    from servobench.export.first_order import first_order_motor
    from servobench.systems.tuning.tune import tune as tuned

    if answer.units[0] == "m":
        raise UsageError(
            "the axis of this result moves in m; tune only handles a shaft that turns, in rad: give the angle "
            "of the drum or the wheel as the output"
        )
    try:
        return tuned(first_order_motor(answer, "tune", "rad"), method, wish)
    except UsageError as error:
        error.args = (with_options(str(error), TUNE),)
        raise


def _own_sample_time(answer: ResultSummary) -> float:
    """The sample time of the data that the result was made from."""
    from servobench.core.errors import UsageError

    if answer.sample_time is None:
        raise UsageError(
            "the result doesn't contain the sample time of its data; give --controller-sample-time, such as 2ms"
        )
    return answer.sample_time


def _loop_output(text: str) -> Output:
    from servobench.core.errors import UnknownName

    known: dict[str, Output] = {"position": "position", "speed": "speed"}
    if text not in known:
        raise UnknownName("loop", text, known)
    return known[text]


def _positive(option: str, text: str | None, si: str) -> float | None:
    """The value of an option in its SI unit."""
    from servobench.core.errors import UnitError, UsageError
    from servobench.core.units import quantity

    if text is None:
        return None
    try:
        value = quantity(text, si)
    except UnitError as error:
        raise UsageError(f"{option}: {error}") from None
    if value <= 0:
        raise UsageError(f"{option} {text}: expected more than 0 {si}")
    return value


def _poles(text: str | None) -> tuple[complex, ...]:
    from servobench.core.errors import UsageError

    if text is None:
        return ()
    try:
        return tuple(complex(each.strip().replace("i", "j")) for each in text.split(","))
    except ValueError:
        raise UsageError(
            f"--poles {text}: expected numbers separated by commas [rad/s], such as -20,-30 or -20,-15+10j"
        ) from None


def _show(console: Console, made: TuningResult) -> None:
    """Print the gains, what is left of the margins, the step response, and the table to paste."""
    from servobench.cli.layout import show_table
    from servobench.cli.result_text import show_findings
    from servobench.cli.terminal import say
    from servobench.systems.control.base import CONTROLLERS

    name = CONTROLLERS.name_of(made.controller)
    say(
        console,
        f"{name} for the {made.wish.output}, every {1000 * made.wish.sample_time:.4g} ms, by {made.method}",
    )
    console.print()
    show_table(
        console, ("of the loop", "wished", "obtained", "unit"), _wish_rows(made), right=("wished", "obtained")
    )
    console.print()
    rows = [*_rows(made.margins), *_rows(made.response)]
    show_table(console, ("of the loop", "value", "95 % interval", "unit"), rows, right=("value",))
    console.print()
    show_findings(console, made.findings)
    console.print()
    for line in made.toml.splitlines():
        say(console, line)


def _wish_rows(made: TuningResult) -> list[tuple[str, str, str, str]]:
    """The specification next to the loop's properties, in the same words and as poles."""
    rows = [
        (name, f"{wished:.4g}", f"{obtained:.4g}", unit)
        for name, (wished, obtained, unit) in made.quantities.items()
    ]
    poles = [("pole", _pole(each.wished), _pole(each.obtained), "1/s") for each in made.poles]
    return [*rows, *poles]


def _pole(at: complex) -> str:
    return f"{at.real:.4g}{at.imag:+.4g}j" if at.imag else f"{at.real:.4g}"


def _rows(quantities: Mapping[str, LoopValue]) -> list[tuple[str, str, str, str]]:
    rows = []
    for name, each in quantities.items():
        if name == "gain_margin_downwards" and math.isinf(min(each.value, each.interval[0])):
            continue  # less gain makes most loops slower, and none of them unstable
        factor, unit = {"rad": (180 / math.pi, "deg"), "1": (1.0, "")}.get(each.unit, (1.0, each.unit))
        if name == "overshoot":
            factor, unit = 100.0, "%"
        if math.isnan(each.value):
            continue
        value, low, high = (
            f"{factor * x:.3g}" if abs(x) > _NOTHING else "0" for x in (each.value, *each.interval)
        )
        rows.append((_WORDS[name], value, f"{low} to {high}", unit))
    return rows
