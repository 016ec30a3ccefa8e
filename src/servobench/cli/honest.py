"""`servobench honest`: do the intervals cover between runs?"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.failures import DONE
from servobench.cli.options import (
    AS_IT_IS,
    AsJson,
    DeviceName,
    Reading,
    Seed,
    StartsAtRest,
    StructureName,
    with_reading,
)
from servobench.core.rounding import TWO_SIDED

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.cli.progress import Progress
    from servobench.identification.honest.repeatability import Honesty
    from servobench.identification.honest.scatter import Scatter
    from servobench.recordings.recording import Recording
    from servobench.rig.experiment import Experiment

_WIDTH = 40  # characters of a picture
_MOST_DRAWN = 20  # runs
_LONGEST = 28  # characters of a run's name in a picture


@with_reading
def honest(
    files: Annotated[
        list[Path] | None, typer.Argument(metavar="[EXPERIMENT.toml | FILE...]", hidden=True)
    ] = None,
    runs: Annotated[int, typer.Option(metavar="N", min=2, help="The number of runs of the experiment.")] = 10,
    device: DeviceName = None,
    seed: Seed = None,
    reading: Reading = AS_IT_IS,
    starts_at_rest: StartsAtRest = False,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="The folder for the recordings; by default one named after the time."
        ),
    ] = None,
    structure: StructureName = "auto",
    as_json: AsJson = False,
) -> None:
    """Compare runs of one motor: do their 95 % intervals cover?

    Without a file, or with an experiment's, the experiment is repeated and the recordings are kept. With recordings, each is
    a run of the same motor. Intervals that don't cover between runs are widened accordingly, and the cause of the
    differences is named if the joint changes of the parameters show it.
    """
    from servobench.cli.conclusion import check_names
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.recordings import evidence_of, load_all
    from servobench.cli.run import status_after
    from servobench.cli.terminal import messages, output, print_json
    from servobench.identification.honest.repeatability import honest as held_together

    check_names(structure, "auto", None)
    paths = files or []
    experiment = paths[0] if len(paths) == 1 and paths[0].suffix == ".toml" else None
    console = messages() if as_json else output()
    with Progress() as progress, announce_compiling(progress):
        if paths and experiment is None:
            recordings = load_all(paths, progress, reading)
        else:
            _refuse_reading(reading)
            recordings, chain = _repeat_runs(experiment, device, seed, runs, out, console, progress)
            reading = replace(reading, chain=chain)
        progress.begin("identifying")
        evidence = evidence_of(recordings, reading)
        data = [each.dataset(starts_at_rest) for each in evidence]
        measured = _channel_means([each.recording for each in evidence])
        honesty = held_together(data, structure=structure, beside=measured)
    _show(console, honesty)
    if as_json:
        print_json(honesty.to_dict())
    raise typer.Exit(status_after(recordings[-1]) if experiment or not paths else DONE)


def _refuse_reading(reading: Reading) -> None:
    """Raise `UsageError` for options that say how to read a file where runs are made, which say all of that themselves."""
    from servobench.core.errors import UsageError

    if reading.flags:
        raise UsageError(
            f"{' and '.join(reading.flags)}: an experiment's runs need no columns, and the chain is in the experiment's file; "
            "leave that out, or give recordings"
        )


def _repeat_runs(
    file: Path | None,
    device: str | None,
    seed: int | None,
    runs: int,
    out: Path | None,
    console: Console,
    progress: Progress,
) -> tuple[list[Recording], str]:
    """The recordings of an experiment carried out so many times, and the chain for measuring them."""
    from servobench.cli.experiment_choice import choose_experiment, make_device
    from servobench.cli.output_folder import empty_folder
    from servobench.cli.run import terminate_like_ctrl_c, warn_of_danger
    from servobench.cli.terminal import say
    from servobench.rig.loop.live import run_where_its_time_passes

    chosen = choose_experiment(file, device, seed, None)
    recordings = []
    progress.begin("running")
    with empty_folder(out, "honest", datetime.now()) as folder, terminate_like_ctrl_c():
        # Made here and nowhere else: of two commands that were given the same empty folder one has it.
        with (folder / "experiment.toml").open("x", encoding="utf-8", newline="\n") as text:
            text.write(chosen.to_toml())
        for number in range(runs):
            one = _experiment_of_run(chosen, number)
            recording = run_where_its_time_passes(
                one,
                make_device(one, file),
                to=folder / f"run-{number + 1}.mcap",
                alarm=progress.alarm,
            )
            warn_of_danger(recording, progress)
            recordings.append(replace(recording, name=f"run {number + 1}"))
            progress.advance((number + 1) / runs)
            if recording.stopped.reason != "finished":
                break
    say(console, f"{len(recordings)} runs in {folder}")
    return recordings, chosen.chain


def _experiment_of_run(experiment: Experiment, number: int) -> Experiment:
    """The experiment of a run: with a seed of its own, and a twin's shaft where chance left it, as a real one's is."""
    import numpy as np

    changed: dict[str, object] = {"until": ""}
    if experiment.seed is not None:
        changed["seed"] = experiment.seed + number
    if experiment.device.name == "twin" and "start_angle" not in experiment.device.settings:
        angle = float(np.random.default_rng([experiment.seed or 0, number]).uniform(0, 2 * math.pi))
        settings = {**experiment.device.settings, "start_angle": angle}
        changed["device"] = experiment.device.model_copy(update={"settings": settings})
    return experiment.model_copy(update=changed)


def _channel_means(recordings: Sequence[Recording]) -> Mapping[str, list[float]]:
    """The means of the temperatures and supplies that all recordings have as a channel."""
    import numpy as np

    words = {"temp": "the temperature", "supply": "the supply", "batter": "the supply", "bus": "the supply"}
    means: dict[str, list[float]] = {}
    for series in recordings[0].series:
        what = next(
            (quantity for word, quantity in words.items() if word in series.channel.name.lower()), None
        )
        same = [
            next((s for s in each.series if s.channel.name == series.channel.name), None)
            for each in recordings
        ]
        if what is not None and all(s is not None and len(s.values) for s in same):
            means.setdefault(what, [float(np.nanmean(s.values)) for s in same if s is not None])
    return means


def _show(console: Console, honesty: Honesty) -> None:
    """Print how each parameter scatters, a picture of those that matter most, and what was found."""
    from servobench.cli.layout import show_table
    from servobench.cli.result_text import show_findings
    from servobench.cli.terminal import say
    from servobench.core.rounding import plain, round_value

    say(console, f"{len(honesty.runs)} runs, structure {honesty.structure}\n")
    headings = (
        "parameter",
        "over all runs",
        "±",
        "unit",
        "scatter / stated",
        "between 95 %",
        "hold the others' mean",
    )
    rows = []
    for each in honesty.parameters:
        mean = round_value(each.mean, 0.5 * (each.interval[1] - each.interval[0]), each.unit)
        ends = f"{plain(each.ratio_interval[0], 2)} to {plain(each.ratio_interval[1], 2)}"
        cells = (mean.value, mean.half, mean.unit, plain(each.ratio, 2), ends)
        rows.append((each.label, *cells, f"{each.covered} of {len(honesty.runs)}"))
    show_table(console, headings, rows, right=headings[1:3])
    console.print()
    for each in honesty.parameters:
        if each.name in ("gain", "time_constant") or each.differs:
            _draw(console, each, honesty.runs)
    show_findings(console, honesty.findings)


def _draw(console: Console, each: Scatter, runs: Sequence[str]) -> None:
    """Print the runs' intervals below each other, and that over all runs: a forest plot.

    It is as wide as the middle half of the runs asks for; what lies beyond ends in an arrow.
    """
    from statistics import median

    from servobench.cli.layout import show_table
    from servobench.core.rounding import plain

    halves = [TWO_SIDED * sd for sd in each.sds]
    lines = [(name, v - h, v, v + h) for name, v, h in zip(runs, each.values, halves, strict=True)][
        :_MOST_DRAWN
    ]
    lines.append(("over all runs", each.interval[0], each.mean, each.interval[1]))
    reach = max(
        4 * median(halves), each.interval[1] - each.mean, 4 * median(abs(v - each.mean) for v in each.values)
    )
    low = max(min(line[1] for line in lines), each.mean - reach)
    high = min(max(line[3] for line in lines), each.mean + reach)
    rows = [(_short(name), _picture(*ends, low=low, high=high)) for name, *ends in lines]
    scale = f"{plain(low, 6)} to {plain(high, 6)} {each.unit}".replace("−", "-")
    show_table(console, (each.label, scale), rows)
    console.print()


def _short(name: str) -> str:
    """The end of a name, which tells runs apart where their beginnings are alike."""
    return name if len(name) <= _LONGEST else f"...{name[3 - _LONGEST :]}"


def _picture(first: float, middle: float, last: float, *, low: float, high: float) -> str:
    """An interval as a line of dashes with an o at its middle, and arrows where it goes on."""
    scale = (_WIDTH - 1) / (high - low) if high > low else 0.0
    a, b, c = (min(max(round(scale * (value - low)), 0), _WIDTH - 1) for value in (first, middle, last))
    marks = [" "] * _WIDTH
    marks[a : c + 1] = "-" * (c + 1 - a)
    if low <= middle <= high:
        marks[b] = "o"
    if first < low:
        marks[0] = "<"
    if last > high:
        marks[-1] = ">"
    return "".join(marks).rstrip().replace(" ", ".")
