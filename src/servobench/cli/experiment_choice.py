"""The experiment and its device, as a command line and a file describe them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from servobench.rig.devices.base import Device
    from servobench.rig.experiment import Experiment


def choose_experiment(
    file: Path | None, device: str | None, seed: int | None, until: str | None, faults: Sequence[str] = ()
) -> Experiment:
    """Return the experiment with the command line's settings in place of the file's; faults are added to the file's."""
    from servobench.cli.device_choice import device_choice
    from servobench.identification.design.stopping_rule import parse_wish
    from servobench.recordings.measurement.base import Chain
    from servobench.rig.devices.faults.base import table_of
    from servobench.rig.experiment import PAPER, load_experiment

    chosen = PAPER if file is None else load_experiment(file)
    if device is not None:
        where = (
            'in the file of an experiment, with name = "{}" in [device] and the settings in [device.settings]'
        )
        chosen = chosen.model_copy(update={"device": device_choice(device, chosen.device, where)})
    if faults:
        tables = (*chosen.device.faults, *map(table_of, faults))
        chosen = chosen.model_copy(update={"device": chosen.device.model_copy(update={"faults": tables})})
    if seed is not None:
        chosen = chosen.model_copy(update={"seed": seed})
    if until is not None:
        parse_wish(until)  # an empty one is no wish, but a mistake
        chosen = chosen.model_copy(update={"until": until})
    if chosen.until:
        parse_wish(chosen.until)
    Chain.parse(chosen.chain)  # a mistake in it should show before the motor turns
    return chosen


def make_device(experiment: Experiment, file: Path | None) -> Device:
    """Return an experiment's device, not yet connected; mistakes in its settings are reported with their lines in the file."""
    from pydantic import ValidationError

    from servobench.core.errors import UnknownName, UsageError
    from servobench.rig.devices.base import DEVICES, missing_settings
    from servobench.rig.devices.faults.base import fault_from
    from servobench.rig.devices.faulty import Faulty
    from servobench.rig.experiment import explain
    from servobench.rig.motor.parameters import data_sheet

    kind = DEVICES[experiment.device.name]
    held_against = experiment.limits.plausibility.motor if experiment.limits.plausibility else ""
    part: tuple[str | int, ...] = ("limits", "plausibility", "motor")
    try:
        if held_against:
            data_sheet(held_against)
        part = ("device", "settings")
        if missing := missing_settings(experiment.device.name, experiment.device.settings):
            raise UsageError("; ".join(missing))
        device = kind(kind.Settings.model_validate(experiment.device.settings))
        faults = []
        for place, table in enumerate(experiment.device.faults):
            part = ("device", "faults", place)
            faults.append(fault_from(table))
    except (ValidationError, UsageError) as error:
        text = file.read_text(encoding="utf-8-sig") if file else ""
        part = (*part, "name") if isinstance(error, UnknownName) and "faults" in part else part
        raise explain(error, text, str(file or experiment.device.name), part) from None
    return Faulty(device, faults) if faults else device
