"""`servobench run`: an experiment from the question to the report."""

from __future__ import annotations

import hashlib
import signal
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.failures import CANNOT_WRITE, DEVICE_FAILED, DONE, INTERRUPTED, complain
from servobench.cli.options import (
    AllFindings,
    AsJson,
    DataSheet,
    DeviceName,
    Overwrite,
    Seed,
    StructureName,
    Until,
)

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.cli.progress import Progress
    from servobench.cli.run_folder import RunFolder
    from servobench.identification.result import Result
    from servobench.recordings.recording import Recording, StopReason
    from servobench.rig.devices.base import Device
    from servobench.rig.experiment import Experiment
    from servobench.rig.loop.run import Look
    from servobench.rig.loop.run import Progress as Place

CUT_SHORT: dict[StopReason, int] = {
    "interrupted": INTERRUPTED,
    "fault": DEVICE_FAILED,
    "device_lost": DEVICE_FAILED,
    "error": DEVICE_FAILED,
}
"""The exit status of a run that didn't end as asked."""
RECORDER_FAILED = ("recorder-died", "recorder-ended-early")
"""The findings of a run that an error ended which was the recorder's and not the loop's."""


def run(
    context: typer.Context,
    experiment: Annotated[
        Path | None,
        typer.Argument(metavar="EXPERIMENT.toml", hidden=True),
    ] = None,
    device: DeviceName = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="The folder for the five files of the run; by default a new one named after the time.",
        ),
    ] = None,
    structure: StructureName = "auto",
    nominal: DataSheet = None,
    seed: Seed = None,
    until: Until = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FAULT",
            help='A fault to inject, as "stuck_channel from=2s for=100ms"; repeatable; see `servobench faults`.',
        ),
    ] = None,
    overwrite: Overwrite = False,
    as_json: AsJson = False,
    all_findings: AllFindings = False,
) -> None:
    """Run an experiment: record, identify, validate, report.

    Without a file it is a square wave of 1 to 3 V at 0.4 Hz for 10 s, sampled at 500 Hz, on the simulated motor.
    Ctrl-C stops the motor; the recording up to then is kept and identified.

    The folder of a run holds experiment.toml, recording.mcap, data.csv, result.json and report.html.
    """
    from servobench.cli.conclusion import check_names, deliver
    from servobench.cli.experiment_choice import choose_experiment, make_device
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.run_folder import run_folder
    from servobench.cli.terminal import messages, output
    from servobench.core.rounding import count_text

    chosen = choose_experiment(experiment, device, seed, until, fault or ())
    held_against = nominal or chosen.nominal or None
    check_names(structure, "auto", held_against)
    console = messages() if as_json else output()
    with run_folder(out, datetime.now(), overwrite) as folder:
        with Progress() as progress, announce_compiling(progress):
            recording = _carry_out(
                chosen, make_device(chosen, experiment), folder, console, progress, structure
            )
            result = _identify_run(
                recording, chosen, structure, held_against or _own_data_sheet(recording), progress
            )
        if recording.stopped.reason in ("device_lost", "error"):
            complain(recording.stopped.sentence)
        if result is not None:
            recording, result = _note_missed_target(recording, chosen, result)
            folder.write_result(result.to_dict())
            deliver(
                result,
                [recording],
                console=console,
                as_json=as_json,
                report=folder.report,
                command=context.obj or "",
                heading=f"{count_text(len(recording['counts'].values), 'sample')}; {recording.stopped.sentence}",
                all_findings=all_findings,
            )
    raise typer.Exit(_status(recording, result))


def _carry_out(
    experiment: Experiment,
    device: Device,
    folder: RunFolder,
    console: Console,
    progress: Progress,
    structure: str,
) -> Recording:
    """Run the experiment into the folder, and return what happened; the motor is at rest then, whatever that was."""
    from servobench.cli.result_text import show_findings
    from servobench.cli.terminal import say
    from servobench.identification.design.stopping_rule import StoppingRule, parse_wish
    from servobench.recordings.formats.base import save
    from servobench.rig.lost_device import DeviceLost, DeviceSilent

    running = "running" if experiment.duration else "running until Ctrl-C"

    def watch(place: Place) -> None:
        if place.ticks and place.tick + 1 >= place.ticks:
            progress.begin("stopping the motor")
            return
        if progress.what != running:
            progress.begin(running)
        if place.ticks and experiment.duration is not None:
            # In real time the time that is left is the run's own; a simulation has its own pace.
            left = None if device.info.timing == "virtual" else experiment.duration - place.time
            progress.advance(place.tick / place.ticks, left)

    look = (
        StoppingRule(parse_wish(experiment.until), experiment.chain, structure) if experiment.until else None
    )
    with terminate_like_ctrl_c(), _connect(device):
        say(console, _experiment_summary(experiment, device))
        show_findings(console, experiment.findings())
        folder.begin(experiment.to_toml())
        progress.begin("getting ready")
        try:
            recording = _drive(experiment, device, folder.recording, watch, look, progress)
        except DeviceSilent as error:
            hint = f"the recording up to then is kept: servobench recover {folder.path}"
            raise DeviceSilent(f"{error}; {hint}", error.recording) from None
        except DeviceLost as error:
            recording = error.recording
    progress.begin("saving the recording")
    warn_of_danger(recording, progress)
    save(recording, folder.data)
    with folder.recording.open("rb") as file:
        checksum = hashlib.file_digest(file, "sha256").hexdigest()
    return replace(recording, source=replace(recording.source, sha256=checksum))


def _connect(device: Device) -> AbstractContextManager[object]:
    """A simulation is run here; a motor in real time is opened by the loop's own process."""
    return device if device.info.timing == "virtual" else nullcontext()


def _drive(
    experiment: Experiment,
    device: Device,
    to: Path,
    watch: Callable[[Place], None],
    look: Look | None,
    progress: Progress,
) -> Recording:
    """Carry the experiment out: at once where time is computed, in a process of its own where it passes."""
    if device.info.timing == "virtual":
        from servobench.rig.loop.run import run as carry_out

        return carry_out(experiment, device, to=to, watch=watch, look=look)
    from servobench.rig.loop.live import run_live

    def over(sentence: str) -> None:
        progress.note(f"{sentence}; saving and identifying the recording ...")

    return run_live(
        experiment, to=to, watch=watch, look=look, say=progress.begin, over=over, alarm=progress.alarm
    )


def warn_of_danger(recording: Recording, progress: Progress) -> None:
    """Report what a person has to act on before anything is saved or identified; a separate loop has reported it already."""
    if recording.info is not None and recording.info.timing == "virtual":
        for sentence in dangers(recording):
            progress.alarm(sentence)


def dangers(recording: Recording) -> tuple[str, ...]:
    """Return the findings of a run that a person has to act on, as the motor may still be driven."""
    from servobench.core.finding import Severity

    return tuple(each.sentence for each in recording.findings if each.severity is Severity.DANGER)


@contextmanager
def terminate_like_ctrl_c() -> Iterator[None]:
    """Let whatever asks the process to end do what Ctrl-C does: the motor is stopped first, and the recording kept."""

    from servobench.rig.loop.requests import REQUESTS, requests_here

    def interrupt(number: int, frame: FrameType | None) -> None:
        name = signal.Signals(number).name
        raise KeyboardInterrupt(f"{name}{REQUESTS[name]}")

    # A request that is ignored, as by nohup, stays so.
    ours = [request for request in requests_here() if signal.getsignal(request) is signal.SIG_DFL]
    for request in ours:
        signal.signal(request, interrupt)
    try:
        yield
    finally:
        for request in ours:
            signal.signal(request, signal.SIG_DFL)


def _identify_run(
    recording: Recording, experiment: Experiment, structure: str, nominal: str | None, progress: Progress
) -> Result | None:
    """The result; None where a run that was cut short left nothing that can be examined."""
    from servobench.cli.conclusion import conclude
    from servobench.core.errors import UsageError
    from servobench.recordings.evidence import Evidence

    try:
        return conclude(
            [Evidence(recording, experiment.chain)], progress, structure=structure, nominal=nominal
        )
    except UsageError as error:
        if recording.stopped.reason not in CUT_SHORT:
            raise
        complain(f"not identified: {error}")
        return None


def _note_missed_target(
    recording: Recording, experiment: Experiment, result: Result
) -> tuple[Recording, Result]:
    """The recording and its result; if the target interval wasn't reached, both say so."""
    from servobench.core.finding import info
    from servobench.identification.design.stopping_rule import StoppingRule, parse_wish

    rule = StoppingRule(parse_wish(experiment.until)) if experiment.until else None
    if rule is None or rule.is_met(result):
        return recording, result
    unmet = f"the target interval ({experiment.until}) was not reached: {rule.progress_text(result)}"
    stopped = replace(recording.stopped, sentence=f"{recording.stopped.sentence}; {unmet}")
    finding = info(
        "wish-not-reached", f"{unmet[0].upper()}{unmet[1:]}. Record for longer, or choose a wider target."
    )
    return replace(recording, stopped=stopped), replace(result, findings=(*result.findings, finding))


def _own_data_sheet(recording: Recording) -> str | None:
    """The data sheet that the device itself names, as the twin does."""
    from servobench.rig.motor.parameters import DATA_SHEETS

    named = dict(recording.info.settings).get("motor") if recording.info else None
    return named if named in DATA_SHEETS else None


def _experiment_summary(experiment: Experiment, device: Device) -> str:
    from servobench.rig.loop.blocks.block_pass import FEWEST_TICKS, tick_by_tick_reason
    from servobench.systems.signals.base import SIGNALS

    length = "endless" if experiment.duration is None else f"{experiment.duration:g} s"
    name = f"{experiment.name}: " if experiment.name else ""
    worth_telling = device.info.timing == "virtual" and (experiment.samples or FEWEST_TICKS) >= FEWEST_TICKS
    reason = tick_by_tick_reason(device, experiment.controller) if worth_telling else ""
    return (
        f"{name}{SIGNALS.name_of(experiment.signal)}, {length} at {experiment.sample_rate:g} Hz, on {experiment.device.name}"
        f"{reason and f'; tick by tick: {reason}'}"
    )


def _status(recording: Recording, result: Result | None) -> int:
    """The exit status: how the run ended comes before what its data say."""
    from servobench.cli.conclusion import status_of

    return status_after(recording) or (DONE if result is None else status_of(result))


def status_after(recording: Recording) -> int:
    """Return the exit status of a run by how it ended; `DONE` where it ended as asked, with the device as it should be."""
    from servobench.rig.loop.messages import NOT_CLOSED

    codes = {finding.code for finding in recording.findings}
    if dangers(recording) or NOT_CLOSED in codes:
        return DEVICE_FAILED
    if recording.stopped.reason == "error" and codes.intersection(RECORDER_FAILED):
        return CANNOT_WRITE
    return CUT_SHORT.get(recording.stopped.reason, DONE)
