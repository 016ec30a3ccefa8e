"""From recordings to the result: the steps that `run` and `identify` share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from servobench.cli.failures import DONE, REFUSED, PartialStop
from servobench.core.finding import Verdict

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import Console

    from servobench.cli.progress import Progress
    from servobench.identification.result import Result
    from servobench.recordings.evidence import Evidence
    from servobench.recordings.recording import Recording


def conclude(
    evidence: Sequence[Evidence],
    progress: Progress,
    *,
    structure: str = "auto",
    estimator: str = "auto",
    nominal: str | None = None,
    others: Sequence[Evidence] = (),
    known: Mapping[str, tuple[float, float]] | None = None,
    starts_at_rest: bool = False,
) -> Result:
    """Return what recordings say about the motor; `others` are those to try the model on. The rest is as for `identify`."""
    from servobench.identification.identify import identify_evidence

    progress.begin("identifying")
    return identify_evidence(
        evidence,
        structure,
        estimator,
        nominal,
        validate_on=others,
        known=known,
        starts_at_rest=starts_at_rest,
    )


def deliver(
    result: Result,
    recordings: Sequence[Recording],
    *,
    console: Console,
    as_json: bool,
    report: Path | None,
    command: str,
    heading: str = "",
    all_findings: bool = False,
) -> None:
    """Write the report, if one is wanted, and print the result: as words, and as JSON where that is wanted, too.

    `command` is the line that was typed, for the report. The result is printed even where the report can't be written, or
    Ctrl-C comes before it is.
    """
    from servobench.cli.result_text import show_dangers, show_result
    from servobench.cli.terminal import print_json, say
    from servobench.report.document import Report

    try:
        if report is not None:
            Report(recordings, result, command=command).write(report)
    except KeyboardInterrupt:
        raise PartialStop(
            f"interrupted before {report} was written; the result is complete, and printed"
        ) from None
    finally:
        show_dangers(console, result.findings)
        if heading:
            say(console, f"{heading}\n")
        _say_timing(console, recordings)
        show_result(console, result, all_findings)
        if as_json:
            print_json(result.to_dict())
    if report is not None:
        say(console, f"\nreport: {report}")


def _say_timing(console: Console, recordings: Sequence[Recording]) -> None:
    """Say how late the samples were, of each recording in which time passed."""
    from servobench.cli.terminal import say
    from servobench.rig.lateness import lateness

    for recording in recordings:
        timing = lateness(recording)
        if timing is not None:
            whose = f" of {recording.name}" if len(recordings) > 1 else ""
            say(console, f"timing{whose}: {timing.sentence}\n")


def status_of(result: Result) -> int:
    """Return the exit status that a result ends a command with."""
    return REFUSED if result.verdict is Verdict.REFUSED else DONE


def check_names(structure: str, estimator: str, nominal: str | None) -> None:
    """Raise `UnknownName` for a structure, an estimator or a data sheet that there isn't, before any work is done."""
    from servobench.identification.estimators.base import ESTIMATORS
    from servobench.identification.models.base import STRUCTURES
    from servobench.rig.motor.parameters import data_sheet

    if structure != "auto":
        STRUCTURES[structure]
    if estimator != "auto":
        ESTIMATORS[estimator]
    if nominal is not None:
        data_sheet(nominal)
