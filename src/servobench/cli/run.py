"""`servobench run`: an experiment from the question to the report."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated

import typer

from servobench.cli.failures import DEVICE_FAILED, DONE, INTERRUPTED, complain

if TYPE_CHECKING:
    from rich.console import Console

    from servobench.cli.run_folder import RunFolder
    from servobench.devices.base import Device
    from servobench.experiment import Experiment
    from servobench.recording.recording import Recording, StopReason
    from servobench.result import Result


def run(
    experiment: Annotated[
        Path | None,
        typer.Argument(
            metavar="[EXPERIMENT.toml]",
            help="What to do; without a file a square wave of 1 to 3 V at 0.4 Hz for 10 s, sampled at 500 Hz.",
        ),
    ] = None,
    device: Annotated[
        str | None, typer.Option(metavar="NAME", help="The device, in place of the experiment's; see `servobench devices`.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="The folder for the five files of the run; without, a new one called after the time."),
    ] = None,
    structure: Annotated[
        str, typer.Option(metavar="NAME", help="The model structure; auto takes the one that the data need.")
    ] = "auto",
    nominal: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="The data sheet to hold the result against; without, the twin's own."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="The seed of simulated noise, in place of the experiment's.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON, and nothing else, on standard output.")] = False,
) -> None:
    """Run an experiment, record it, identify the motor, validate, and report.

    Without a file it is the paper's experiment on the simulated motor. Ctrl-C stops the motor; what was recorded until
    then is kept and identified.
    """
    from servobench.cli.conclusion import check_names
    from servobench.cli.run_folder import run_folder
    from servobench.cli.terminal import print_json, words

    asked = _experiment(experiment, device, seed)
    held_against = nominal or asked.nominal or None
    check_names(structure, held_against)
    console = words(beside_json=as_json)
    folder = run_folder(out, datetime.now())
    happened = _carried_out(asked, _device(asked, experiment), folder, console)
    result = _identified(happened, asked, structure, held_against or happened.motor)
    if result is not None:
        _keep(folder, happened, result)
        _show(console, folder, result)
        if as_json:
            print_json(result.to_dict())
    raise typer.Exit(_status(happened, result))
