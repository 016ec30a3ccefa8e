"""Requests from pages as values: commands, and experiments as the panel runs them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from servobench.core.errors import UsageError
from servobench.panel.frames import speed_chain
from servobench.panel.lease import Refusal
from servobench.rig.experiment import DeviceChoice, Experiment
from servobench.rig.loop.messages import Command

ASSIGNED = "assigned"
"""A student's own device in an assessment: a panel that has it keeps it."""
SIMULATED = ("twin", ASSIGNED)

_SINGULAR = {"parts": "Part", "segments": "Segment", "levels": "Level", "entries": "Entry"}
"""The page's name for one of several; the others get the name of all before their number."""
_EXPECTED = {
    "tuple_type": "an array",
    **dict.fromkeys(("dict_type", "mapping_type", "model_type", "model_attributes_type"), "a table"),
}
"""The expected value by the kind of a mistake, in the words for files of experiments."""


def command_from(message: Mapping[str, Any]) -> Command:
    """Return the command that a page's message describes; raises `UsageError` for what can't be."""
    try:
        command = Command.model_validate({key: value for key, value in message.items() if value is not None})
    except ValidationError as error:
        raise UsageError(settings_error_text(error)) from None
    if command.chain is not None:
        speed_chain(command.chain)
    return command


def experiment_from(now: Experiment, device: object, sample_time: object) -> Experiment:
    """Return the experiment with another device or sample time.

    Raises `UsageError` for what can't be, and `Refusal` for another motor than the one that is assigned.
    """
    from servobench.rig.devices.base import connect

    try:
        changed = now.model_dump()
        if device is not None:
            changed["device"] = device
        if sample_time is not None:
            changed["sample_time"] = sample_time
        asked = for_panel(Experiment.model_validate(changed))
    except ValidationError as error:
        raise UsageError(settings_error_text(error)) from None
    if now.device.name == ASSIGNED and asked.device != for_panel(now).device:
        raise Refusal("this panel has the motor assigned to you; it can't be changed")
    connect(asked.device.name, **asked.device.settings)  # not entered: its settings are checked by that
    return asked


def for_panel(experiment: Experiment) -> Experiment:
    """Return the experiment as the panel runs it: without an end, and a simulated motor in real time."""
    device = experiment.device
    if device.name in SIMULATED:
        device = DeviceChoice(
            name=device.name, settings={**device.settings, "timing": "host"}, faults=device.faults
        )
    chain = experiment.chain or "derivative | lowpass 50 rad/s"
    return experiment.model_copy(update={"device": device, "duration": None, "until": "", "chain": chain})


def settings_error_text(error: ValidationError) -> str:
    """Return what is wrong with settings, as people say it: which one, what it is, and what is expected."""
    return "; ".join(_one(each) for each in error.errors(include_url=False))


def _one(wrong: ErrorDetails) -> str:
    place, message = _place(wrong["loc"]), wrong["msg"].removeprefix("Value error, ")
    if wrong["type"] == "missing":
        return f"{place} isn't given"
    expected = message.removeprefix("Input should be ")
    if expected == message:
        return f"{place}: {message}" if place else message
    expected = _EXPECTED.get(wrong["type"], expected)
    entry = wrong["input"]
    if entry is None:
        return f"{place} isn't given; expected: {expected}"
    value = f"{entry:g}" if isinstance(entry, float) else repr(entry)[:60]
    return f"{place} is {value}; expected: {expected}"


def _place(path: tuple[int | str, ...]) -> str:
    """The place of a setting in the words of the page: `Segment 1: Part 2: low`."""
    places: list[str] = []
    keys: list[str] = []
    for each in path:
        if isinstance(each, str):
            keys.append(each)
            continue
        item = keys.pop() if keys else "entries"
        # A part's own signal is the part, as far as a person sees.
        places += [
            ".".join(key for key in keys if key != "signal"),
            f"{_SINGULAR.get(item, item)} {each + 1}",
        ]
        keys = []
    if places and keys[:1] == ["signal"] and len(keys) > 1:
        keys = keys[1:]
    return ": ".join(filter(None, [*places, ".".join(keys)]))
