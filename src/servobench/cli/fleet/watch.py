"""`servobench fleet watch`: recordings as a test stand drops them, a line for each."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.options import (
    AS_IT_IS,
    DataSheet,
    EstimatorName,
    KnownParameters,
    LimitsFile,
    NamePatternText,
    Reading,
    StartsAtRest,
    StructureName,
    Workers,
    with_reading,
)

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.fleet.limits import Limits
    from servobench.fleet.name_pattern import NamePattern
    from servobench.fleet.parts import Results
    from servobench.fleet.row import Row
    from servobench.fleet.settings import Settings
    from servobench.fleet.source import Source


@with_reading
def watch(
    context: typer.Context,
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", hidden=True)],
    out: Annotated[
        Path,
        typer.Option(
            metavar="RESULTS",
            help="The folder for the results: new, or the one from an earlier run of this command.",
        ),
    ],
    pattern: NamePatternText = None,
    limits: LimitsFile = None,
    workers: Workers = None,
    reading: Reading = AS_IT_IS,
    starts_at_rest: StartsAtRest = False,
    nominal: DataSheet = None,
    known: KnownParameters = None,
    structure: StructureName = "auto",
    estimator: EstimatorName = "auto",
) -> None:
    """Identify recordings as they come into FOLDER, and print a line for each: the verdict or, with --limits, the decision.

    A file is read once it has stayed the same for half a second. RESULTS is the same as from `servobench fleet FOLDER` with the
    same options. Ctrl-C ends the watch, and writes table and report.
    """
    from servobench.cli.fleet.identify import settings_from
    from servobench.cli.fleet.outcome import conclude_fleet, status_of_fleet
    from servobench.cli.progress import Progress
    from servobench.cli.run import terminate_like_ctrl_c
    from servobench.cli.terminal import output, say
    from servobench.core.errors import UsageError
    from servobench.fleet.identification import results_of
    from servobench.fleet.limits import Limits
    from servobench.fleet.name_pattern import NamePattern
    from servobench.fleet.source import Folder

    if "://" in str(folder):
        raise UsageError(f"{folder}: only a folder of this machine can be watched")
    if not folder.is_dir():
        raise UsageError(f"{folder}: there is no such folder; expected the one that the stand writes into")
    wanted = Limits.read(limits) if limits is not None else None
    names = NamePattern(pattern) if pattern is not None else None
    settings = settings_from(reading, structure, estimator, nominal, known, starts_at_rest)
    source = Folder(folder, without=out)
    with results_of(source, out, pattern, settings) as results, terminate_like_ctrl_c():
        try:
            _follow(source, settings, names, wanted, results, workers, output())
        except KeyboardInterrupt:
            say(output(), f"ended; {len(results.stamps())} motors in {out}")
    with Progress() as progress:
        if not results.is_empty:
            fleet, _ = conclude_fleet(str(folder), out, settings, wanted, progress, (), context.obj or "")
            raise typer.Exit(status_of_fleet(fleet))


def _follow(
    source: Source,
    settings: Settings,
    pattern: NamePattern | None,
    limits: Limits | None,
    results: Results,
    workers: int | None,
    console: Console,
) -> None:
    """Identify what comes, until Ctrl-C."""
    from servobench.cli.terminal import say
    from servobench.core.processors import processors
    from servobench.fleet.identification import identify, row_or_reason
    from servobench.fleet.pool import Processes
    from servobench.fleet.watch import LOOK, Arrivals

    done = results.stamps()
    arrivals = Arrivals(source, pattern, dict(done))
    with Processes(partial(identify, source, settings, pattern), workers or processors()) as pool:
        say(console, f"watching {source.address}; Ctrl-C ends it")
        while True:
            began = time.monotonic()
            whole = arrivals.look(began)
            took = time.monotonic() - began
            for item, outcome in pool.results(whole):
                row = row_or_reason(item, pattern, outcome)
                results.replace(row, row["file"] in done)
                done[row["file"]] = row["stamp"]
                say(console, _line(row, limits))
            time.sleep(max(LOOK, took))  # a folder of many files is examined less often


def _line(row: Row, limits: Limits | None) -> str:
    """One motor in a line: the decision or the verdict, the file, gain and time constant, and why where it isn't good."""
    from servobench.cli.option_names import with_options
    from servobench.core.parameter_names import parameter_in_words
    from servobench.core.rounding import rounded_interval

    parts = []
    for name in ("gain", "time_constant"):
        low, high = row.get(f"{name}_low"), row.get(f"{name}_high")
        if row.get(f"{name}_state") == "known" and low is not None and high is not None:
            unit = row[f"{name}_unit"]
            parts.append(f"{parameter_in_words(name, unit)} {rounded_interval(row[name], (low, high), unit)}")
    judged = limits.judge(row) if limits is not None else None
    first = str(judged.decision) if judged else str(row.get("verdict") or row["outcome"])
    why = judged.decided_by if judged else row["reason"]
    return f"{first:9} {row['file']}: {', '.join([*parts, *([with_options(why)] if why else [])])}"
