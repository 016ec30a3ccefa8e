"""`servobench run`: an experiment from the question to the report."""

from __future__ import annotations

import hashlib
import signal
from collections.abc import Callable, Iterator, Sequence
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
    from servobench.cli.progress import Progress, announce_compiling
    from servobench.cli.run_folder import run_folder
    from servobench.cli.terminal import messages, output
    from servobench.core.rounding import count_text

    asked = experiment_asked_for(experiment, device, seed, until, fault or ())
    held_against = nominal or asked.nominal or None
    check_names(structure, "auto", held_against)
    console = messages() if as_json else output()
    with run_folder(out, datetime.now(), overwrite) as folder:
        with Progress() as progress, announce_compiling(progress):
            recording = _carry_out(
                asked, device_asked_for(asked, experiment), folder, console, progress, structure
            )
            result = _identify_run(
                recording, asked, structure, held_against or _own_data_sheet(recording), progress
            )
        if recording.stopped.reason in ("device_lost", "error"):
            complain(recording.stopped.sentence)
        if result is not None:
            recording, result = _note_missed_target(recording, asked, result)
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


def experiment_asked_for(
    file: Path | None, device: str | None, seed: int | None, until: str | None, faults: Sequence[str] = ()
) -> Experiment:
    """The experiment with the command line's settings in place of the file's; faults are added to the file's."""
    from servobench.cli.device_choice import device_choice
    from servobench.identification.design.stopping_rule import parse_wish
    from servobench.recordings.measurement.base import Chain
    from servobench.rig.devices.faults.base import table_of
    from servobench.rig.experiment import PAPER, load_experiment

    asked = PAPER if file is None else load_experiment(file)
    if device is not None:
        where = (
            'in the file of an experiment, with name = "{}" in [device] and the settings in [device.settings]'
        )
        asked = asked.model_copy(update={"device": device_choice(device, asked.device, where)})
    if faults:
        tables = (*asked.device.faults, *map(table_of, faults))
        asked = asked.model_copy(update={"device": asked.device.model_copy(update={"faults": tables})})
    if seed is not None:
        asked = asked.model_copy(update={"seed": seed})
    if until is not None:
        parse_wish(until)  # an empty one is no wish, but a mistake
        asked = asked.model_copy(update={"until": until})
    if asked.until:
        parse_wish(asked.until)
    Chain.parse(asked.chain)  # a mistake in it should show before the motor turns
    return asked


def device_asked_for(asked: Experiment, file: Path | None) -> Device:
    """The requested device, not yet connected; mistakes in its settings are reported with their lines in the file."""
    from pydantic import ValidationError

    from servobench.core.errors import UnknownName, UsageError
    from servobench.rig.devices.base import DEVICES, missing_settings
    from servobench.rig.devices.faults.base import fault_from
    from servobench.rig.devices.faulty import Faulty
    from servobench.rig.experiment import explain
    from servobench.rig.motor.parameters import data_sheet

    kind = DEVICES[asked.device.name]
    held_against = asked.limits.plausibility.motor if asked.limits.plausibility else ""
    part: tuple[str | int, ...] = ("limits", "plausibility", "motor")
    try:
        if held_against:
            data_sheet(held_against)
        part = ("device", "settings")
        if missing := missing_settings(asked.device.name, asked.device.settings):
            raise UsageError("; ".join(missing))
        device = kind(kind.Settings.model_validate(asked.device.settings))
        faults = []
        for place, table in enumerate(asked.device.faults):
            part = ("device", "faults", place)
            faults.append(fault_from(table))
    except (ValidationError, UsageError) as error:
        text = file.read_text(encoding="utf-8-sig") if file else ""
        part = (*part, "name") if isinstance(error, UnknownName) and "faults" in part else part
        raise explain(error, text, str(file or asked.device.name), part) from None
    return Faulty(device, faults) if faults else device


def _carry_out(
    asked: Experiment, device: Device, folder: RunFolder, console: Console, progress: Progress, structure: str
) -> Recording:
    """Run the experiment into the folder, and return what happened; the motor is at rest then, whatever that was."""
    from servobench.cli.result_text import show_findings
    from servobench.cli.terminal import say
    from servobench.identification.design.stopping_rule import StoppingRule, parse_wish
    from servobench.recordings.formats.base import save
    from servobench.rig.lost_device import DeviceLost, DeviceSilent

    running = "running" if asked.duration else "running until Ctrl-C"

    def watch(place: Place) -> None:
        if place.ticks and place.tick + 1 >= place.ticks:
            progress.begin("stopping the motor")
            return
        if progress.what != running:
            progress.begin(running)
        if place.ticks and asked.duration is not None:
            # In real time the time that is left is the run's own; a simulation has its own pace.
            left = None if device.info.timing == "virtual" else asked.duration - place.time
            progress.advance(place.tick / place.ticks, left)

    look = StoppingRule(parse_wish(asked.until), asked.chain, structure) if asked.until else None
    with terminate_like_ctrl_c(), _connect(device):
        say(console, _experiment_summary(asked, device))
        show_findings(console, asked.findings())
        folder.begin(asked.to_toml())
        progress.begin("getting ready")
        try:
            recording = _drive(asked, device, folder.recording, watch, look, progress)
        except DeviceSilent as error:
            kept = f"the recording up to then is kept: servobench recover {folder.path}"
            raise DeviceSilent(f"{error}; {kept}", error.recording) from None
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
    asked: Experiment,
    device: Device,
    to: Path,
    watch: Callable[[Place], None],
    look: Look | None,
    progress: Progress,
) -> Recording:
    """Carry the experiment out: at once where time is computed, in a process of its own where it passes."""
    if device.info.timing == "virtual":
        from servobench.rig.loop.run import run as carry_out

        return carry_out(asked, device, to=to, watch=watch, look=look)
    from servobench.rig.loop.live import run_live

    def over(sentence: str) -> None:
        progress.note(f"{sentence}; saving and identifying the recording ...")

    return run_live(asked, to=to, watch=watch, look=look, say=progress.begin, over=over, alarm=progress.alarm)


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
    recording: Recording, asked: Experiment, structure: str, nominal: str | None, progress: Progress
) -> Result | None:
    """The result; None where a run that was cut short left nothing that can be looked at."""
    from servobench.cli.conclusion import conclude
    from servobench.core.errors import UsageError
    from servobench.recordings.evidence import Evidence

    try:
        return conclude([Evidence(recording, asked.chain)], progress, structure=structure, nominal=nominal)
    except UsageError as error:
        if recording.stopped.reason not in CUT_SHORT:
            raise
        complain(f"not identified: {error}")
        return None


def _note_missed_target(recording: Recording, asked: Experiment, result: Result) -> tuple[Recording, Result]:
    """The recording and its result; if the target interval wasn't reached, both say so."""
    from servobench.core.finding import info
    from servobench.identification.design.stopping_rule import StoppingRule, parse_wish

    rule = StoppingRule(parse_wish(asked.until)) if asked.until else None
    if rule is None or rule.is_met(result):
        return recording, result
    unmet = f"the target interval ({asked.until}) was not reached: {rule.progress_text(result)}"
    stopped = replace(recording.stopped, sentence=f"{recording.stopped.sentence}; {unmet}")
    told = info(
        "wish-not-reached", f"{unmet[0].upper()}{unmet[1:]}. Record for longer, or choose a wider target."
    )
    return replace(recording, stopped=stopped), replace(result, findings=(*result.findings, told))


def _own_data_sheet(recording: Recording) -> str | None:
    """The data sheet that the device itself names, as the twin does."""
    from servobench.rig.motor.parameters import DATA_SHEETS

    named = dict(recording.info.settings).get("motor") if recording.info else None
    return named if named in DATA_SHEETS else None


def _experiment_summary(asked: Experiment, device: Device) -> str:
    from servobench.rig.loop.blocks.block_pass import FEWEST_TICKS, tick_by_tick_reason
    from servobench.systems.signals.base import SIGNALS

    length = "endless" if asked.duration is None else f"{asked.duration:g} s"
    name = f"{asked.name}: " if asked.name else ""
    worth_telling = device.info.timing == "virtual" and (asked.samples or FEWEST_TICKS) >= FEWEST_TICKS
    reason = tick_by_tick_reason(device, asked.controller) if worth_telling else ""
    return (
        f"{name}{SIGNALS.name_of(asked.signal)}, {length} at {asked.sample_rate:g} Hz, on {asked.device.name}"
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
