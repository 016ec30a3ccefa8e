"""`servobench fleet SOURCE`: every recording under a folder or an address becomes a row of a table."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.options import (
    AS_IT_IS,
    AsJson,
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
    from servobench.cli.progress import Progress
    from servobench.fleet.identification import Progress as FleetProgress
    from servobench.fleet.settings import Settings


@with_reading
def identify(
    context: typer.Context,
    source: Annotated[str, typer.Argument(metavar="SOURCE", hidden=True)],
    out: Annotated[
        Path,
        typer.Option(
            metavar="RESULTS",
            help="The folder for the results: new, or the one from an earlier run of this command.",
        ),
    ],
    pattern: NamePatternText = None,
    limits: LimitsFile = None,
    retry: Annotated[bool, typer.Option("--retry", help="Try the files without a result again.")] = False,
    workers: Workers = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Use the workers of a Dask cluster, such as tcp://stand:8786; they must be able to read SOURCE.",
        ),
    ] = None,
    reading: Reading = AS_IT_IS,
    starts_at_rest: StartsAtRest = False,
    nominal: DataSheet = None,
    known: KnownParameters = None,
    structure: StructureName = "auto",
    estimator: EstimatorName = "auto",
    as_json: AsJson = False,
) -> None:
    """Identify every recording under SOURCE, a folder or an address such as s3://bucket/line-3, each by itself.

    RESULTS gets a table with a row for each file (motors.parquet, motors.csv) and a report. A file that can't be used gets a
    row with the reason. After Ctrl-C, or if the computer stopped, the same command continues from there; files that are new or
    have changed are identified, the others are kept as they are.

    With --limits the exit status is 0 if all motors pass, 6 if one fails, 7 if none fails but some are undecided.
    """
    from servobench.cli.failures import PartialStop
    from servobench.cli.fleet.outcome import conclude_fleet, show_fleet, status_of_fleet
    from servobench.cli.progress import Progress
    from servobench.cli.terminal import messages, output, print_json
    from servobench.core.rounding import count_text
    from servobench.fleet.identification import identify_fleet
    from servobench.fleet.limits import Limits

    wanted = Limits.read(limits) if limits is not None else None
    settings = settings_from(reading, structure, estimator, nominal, known, starts_at_rest)
    with Progress() as progress:
        counting = _Counting(progress)
        try:
            summary = identify_fleet(
                source,
                out,
                pattern=pattern,
                settings=settings,
                workers=workers,
                scheduler=scheduler,
                retry=retry,
                progress=counting,
            )
        except KeyboardInterrupt:
            done, due = counting.done, count_text(counting.due, "file")
            raise PartialStop(
                f"interrupted: {done} of {due} done and kept in {out}; the same command goes on with the others"
            ) from None
        fleet, document = conclude_fleet(
            source, out, settings, wanted, progress, summary.others, context.obj or ""
        )
    show_fleet(messages() if as_json else output(), fleet, summary, out)
    if as_json:
        print_json(document)
    raise typer.Exit(status_of_fleet(fleet))


def settings_from(
    reading: Reading,
    structure: str,
    estimator: str,
    nominal: str | None,
    known: list[str] | None,
    starts_at_rest: bool,
) -> Settings:
    """Return what is requested of each file, checked before any of them is read; raises `UsageError`."""
    from servobench.cli.conclusion import check_names
    from servobench.cli.parameter_values import parse_parameters
    from servobench.fleet.settings import Settings

    check_names(structure, estimator, nominal)
    return Settings(
        options=reading.options,
        structure=structure,
        estimator=estimator,
        nominal=nominal,
        known=parse_parameters(known or ()),
        starts_at_rest=starts_at_rest,
    )


class _Counting:
    """Tells how far it is, and at which rate."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._began = time.monotonic()
        self.done = self.due = 0

    def __call__(self, now: FleetProgress) -> None:
        """Take note of it."""
        from servobench.core.rounding import count_text

        self.done, self.due = now.done, now.due
        if not now.done:
            before = f", {now.before} done before" if now.before else ""
            self._progress.begin(f"identifying {count_text(now.due, 'file')}{before}")
        rate = now.done / max(time.monotonic() - self._began, 1e-9)
        self._progress.advance(now.done / max(now.due, 1), rate=f" {rate:.3g} files/s," if now.done else "")
