"""`servobench ensemble`: what the tolerances of a motor do to it, and to its controller."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from secrets import randbits
from typing import TYPE_CHECKING, Annotated, Any

import typer

from servobench.cli.failures import DONE, PartialStop
from servobench.cli.options import AsJson, Seed

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.cli.progress import Progress
    from servobench.fleet.ensemble import IdentifiedMotor
    from servobench.rig.devices.twin import TwinSettings
    from servobench.rig.ensemble.ensemble import Ensemble
    from servobench.rig.experiment import Experiment

_SEED_BITS = 32  # of a random one: short enough to type again


def ensemble(
    context: typer.Context,
    experiment: Annotated[
        Path | None,
        typer.Argument(metavar="EXPERIMENT.toml", hidden=True),
    ] = None,
    spread: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=TOLERANCE",
            help="How far a parameter of the motor may be off: resistance=10%, or a half width with its unit; may be repeated.",
        ),
    ] = None,
    count: Annotated[int, typer.Option(metavar="N", min=1, max=200_000, help="How many motors.")] = 1000,
    seed: Seed = None,
    threads: Annotated[
        int | None,
        typer.Option(metavar="N", min=1, max=256, help="How many processors to use; by default all."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="The folder for report and table; by default a new one named after the time.",
        ),
    ] = None,
    identify: Annotated[
        bool,
        typer.Option("--identify", help="Identify every motor from its counts: do the intervals cover?"),
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Simulate many motors with tolerances: what they do to gain, time constant and a controller.

    The experiment is that of `servobench run`, on the twin: without a file a square wave of 1 to 3 V for 10 s. Each motor's
    parameters lie anywhere within the tolerances, equally likely.

    The folder gets report.html, motors.csv with a row for each motor, ensemble.json and experiment.toml. Ctrl-C while motors are
    identified keeps what is known so far.
    """
    from servobench.cli.experiment_choice import choose_experiment
    from servobench.cli.output_folder import empty_folder
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.terminal import messages, output, print_json, say

    chosen = choose_experiment(experiment, None, seed, None)
    if chosen.seed is None:  # kept in the folder's experiment, so that these motors can be drawn again
        chosen = chosen.model_copy(update={"seed": randbits(_SEED_BITS)})
    motor = _motor(chosen, experiment)
    tolerances = _tolerances(spread or ())
    console = messages() if as_json else output()
    with empty_folder(out, "ensemble", datetime.now()) as folder:
        identified_motors: list[IdentifiedMotor] = []
        with Progress() as progress, announce_compiling(progress):
            made = _simulate(motor, chosen, count, tolerances, threads, progress)
            _write(folder, "experiment.toml", chosen.to_toml())
            stopped = identify and _identify(made, threads, progress, identified_motors)
            document = _keep(made, identified_motors, folder, context.obj or "", progress)
        _show(console, made, identified_motors)
        say(console, f"\ntable: {folder / 'motors.csv'}; report: {folder / 'report.html'}")
        if as_json:
            print_json(document)
        if stopped:
            raise PartialStop(
                f"interrupted: {len(identified_motors)} of {len(made)} motors identified; they are in "
                f"{folder / 'motors.csv'} and the report"
            )
    raise typer.Exit(DONE)


def _simulate(
    motor: TwinSettings,
    experiment: Experiment,
    count: int,
    tolerances: dict[str, str],
    threads: int | None,
    progress: Progress,
) -> Ensemble:
    from servobench.core.rounding import count_text
    from servobench.rig.ensemble.ensemble import ensemble as simulated

    progress.begin(f"simulating {count_text(count, 'motor')}")
    return simulated(
        motor,
        experiment,
        count,
        tolerances,
        seed=experiment.seed or 0,
        threads=threads,
        progress=progress.advance,
    )


def _motor(experiment: Experiment, file: Path | None) -> TwinSettings:
    """The twin that the experiment names; its settings are checked as `servobench run` does."""
    from servobench.cli.experiment_choice import make_device
    from servobench.core.errors import UsageError
    from servobench.rig.devices.twin import Twin
    from servobench.rig.ensemble.simulation import check_can_be_simulated

    if experiment.device.name != "twin":
        raise UsageError(
            f'the experiment\'s device is {experiment.device.name}; an ensemble is simulated: put name = "twin" in [device]'
        )
    plain = experiment.model_copy(update={"device": experiment.device.model_copy(update={"faults": ()})})
    device = make_device(plain, file)
    if not isinstance(device, Twin):
        raise UsageError(f"the experiment's device is a {type(device).__name__}; expected the twin")
    check_can_be_simulated(experiment, device.settings)
    return device.settings


def _tolerances(texts: Sequence[str]) -> dict[str, str]:
    """Each NAME=TOLERANCE; raises `UsageError` for none, for another text and for a name given twice."""
    from servobench.core.errors import UsageError

    tolerances: dict[str, str] = {}
    for text in texts:
        name, _, tolerance = (part.strip() for part in text.partition("="))
        if not (name and tolerance):
            raise UsageError(f"--spread {text}: expected NAME=TOLERANCE, such as resistance=10%")
        if name in tolerances:
            raise UsageError(f"--spread {text}: {name} was given before; give it once")
        tolerances[name] = tolerance
    if not tolerances:
        raise UsageError(
            "no parameter has a tolerance, so all motors would be alike; give one with --spread, such as --spread resistance=10%"
        )
    return tolerances


def _identify(
    made: Ensemble, workers: int | None, progress: Progress, identified_motors: list[IdentifiedMotor]
) -> bool:
    """Identify all motors into `identified_motors`; return whether Ctrl-C came before the last."""
    from servobench.core.rounding import count_text
    from servobench.fleet.ensemble import identify_ensemble

    progress.begin(f"identifying {count_text(len(made), 'motor')}")
    try:
        for each in identify_ensemble(made, workers):
            identified_motors.append(each)
            progress.advance(len(identified_motors) / len(made))
    except KeyboardInterrupt:
        return True
    return False


def _keep(
    made: Ensemble, identified_motors: list[IdentifiedMotor], folder: Path, command: str, progress: Progress
) -> dict[str, Any]:
    """Write table, report and JSON, and return the latter as plain data."""
    from servobench.core.json_numbers import finite
    from servobench.fleet.ensemble import coverages
    from servobench.fleet.ensemble_page import write_page_of, write_table

    progress.begin("writing table and report")
    files = [
        write_table(made, identified_motors, folder),
        write_page_of(made, identified_motors, folder, command),
    ]
    verdicts: dict[str, int] = {}
    for each in identified_motors:
        verdicts[each.verdict or "unusable"] = verdicts.get(each.verdict or "unusable", 0) + 1
    document = {
        **made.to_dict(),
        "identified": {
            "motors": len(identified_motors),
            "verdicts": verdicts,
            "coverage": {
                each.parameter: {
                    "known": each.known,
                    "covered": each.covered,
                    **{name: finite(getattr(each, name)) for name in ("share", "scatter", "bias")},
                }
                for each in coverages(made, identified_motors)
            },
        },
        "files": [str(each) for each in files],
    }
    _write(folder, "ensemble.json", json.dumps(document, ensure_ascii=False, indent=2) + "\n")
    return document


def _write(folder: Path, name: str, text: str) -> None:
    from servobench.core.errors import StorageError

    try:
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise StorageError(f"{folder / name} can't be written: {error.strerror or error}") from error


def _show(console: Console, made: Ensemble, identified_motors: Sequence[IdentifiedMotor]) -> None:
    """Print what the tolerances do, how the outcomes are spread, and whether the intervals cover."""
    from rich.text import Text

    from servobench.cli.layout import show_table, show_wrapped
    from servobench.cli.terminal import say
    from servobench.core.parameter_names import plain_words
    from servobench.core.rounding import count_text
    from servobench.fleet.ensemble import coverages
    from servobench.fleet.ensemble_page import coverage_text, outcome_row, remark, sentences

    say(console, f"{count_text(len(made), 'motor')}: {', '.join(map(str, made.tolerances))}")
    headings = ("outcome", "nominal", "5 %", "median", "95 %", "motors")
    show_table(console, headings, [outcome_row(made, name) for name in made.outcomes], right=headings[1:])
    for sentence in sentences(made):
        show_wrapped(console, Text(""), sentence, hanging=2)
    for name in made.outcomes:
        if note := remark(made, name):
            show_wrapped(console, Text(f"{plain_words(name)}: "), note, hanging=2)
    for each in coverages(made, identified_motors):
        show_wrapped(console, Text(""), coverage_text(each), hanging=2)
