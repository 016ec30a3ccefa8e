"""Experiments on a simulated motor with other hidden truths than the exercise's own, such as a dead band or a narrow counter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from servobench.experiment import Experiment
from servobench.experiment.experiment import DeviceChoice

if TYPE_CHECKING:
    from servobench.devices.faults.base import Fault
    from servobench.recording.recording import Recording


def simulated(experiment: Experiment, faults: Sequence[Fault] = (), **settings: object) -> Recording:
    """Carry out an experiment on a twin in virtual time, and return what happened.

    `settings` are the twin's, and go before those that the experiment gives a twin; `faults` are injected. Raises `UsageError`
    for settings that the twin hasn't.
    """
    from servobench.devices.base import connect
    from servobench.devices.faulty import Faulty
    from servobench.loop.run import run

    own = experiment.device.settings if experiment.device.name == "twin" else {}
    chosen = {**own, **settings, "timing": "virtual"}
    made = experiment.model_copy(update={"device": DeviceChoice(name="twin", settings=chosen)})
    twin = connect("twin", **chosen)
    with Faulty(twin, faults) if faults else twin as motor:
        return run(made, motor)
