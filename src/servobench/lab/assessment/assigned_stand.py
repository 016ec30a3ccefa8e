"""A student's stand: a motor of their own, and recordings that contain nothing of it but measurements."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from servobench.core.errors import UsageError
from servobench.lab.exercise import Exercise
from servobench.lab.stand import TWIN, MotorStand, stand_of
from servobench.recordings.recording import Source
from servobench.rig.experiment import Experiment
from servobench.rig.experiment.experiment import DeviceChoice
from servobench.rig.motor.individual import same_name
from servobench.rig.motor.secret import hash_words

if TYPE_CHECKING:
    from servobench.recordings.recording import Recording

_FORM = "servobench.form/1"
_NO_NUMBER = "k"
"""A letter before a code: a spreadsheet takes twelve digits, or 12e3456, for a number, and saves it rounded."""
_OWN_TIME = "timing"


@dataclass(frozen=True, kw_only=True)
class Assessment:
    """An exercise that is assessed, and the secret that makes the students' motors, from `secret_file`.

    `with_motor` says that students have their motor in a panel as well, not only its recording.

    Raises `UsageError` for an exercise that isn't done on the twin.
    """

    exercise: Exercise
    secret_file: Path
    secret: bytes
    with_motor: bool = False

    def __post_init__(self) -> None:
        name = self.exercise.experiment.device.name
        if name != TWIN:
            raise UsageError(
                f"{self.exercise.source}: it uses the device {name!r}; only exercises on the simulated motor (twin) "
                "can be assessed, as each student needs a different motor"
            )

    def code(self, student: str) -> str:
        """Return the code on a student's form, which says whose it is and by which secret; it tells nothing else."""
        digest = hash_words(self.secret, _FORM, self.exercise.name, same_name(student)).hex()[:12]
        return f"{_NO_NUMBER}{digest}"

    def stand(self, student: str) -> MotorStand:
        """Return the stand of a student: the recording that they get and, where they have the motor, further runs of it."""
        own = device_of_student(student, self.exercise, self.secret_file)
        recording = self._carry_out(own, self.exercise.experiment, student)
        if not self.with_motor:
            return stand_of(self.exercise, recording)
        if recording.info is None:  # a run always says which device it is of
            raise UsageError(f"{recording.name} doesn't say which device it is of")
        return MotorStand(
            exercise=self.exercise,
            experiment=self.exercise.experiment,
            info=recording.info,
            made=recording,
            carry_out=lambda asked: self._carry_out(own, asked, student),
        )

    def _carry_out(self, own: DeviceChoice, experiment: Experiment, student: str) -> Recording:
        from servobench.rig.devices.base import connect
        from servobench.rig.devices.faulty import with_faults
        from servobench.rig.loop.run import run

        # What a study asks of the twin beside, such as another dead band, anybody may know.
        settings = {
            **own.settings,
            "shared": {**own.settings["shared"], **_common_settings(experiment.device)},
        }
        with with_faults(connect(own.name, **settings), experiment.device.faults) as motor:
            recording = run(experiment.model_copy(update={"device": own}), motor)
        if recording.stopped.reason == "interrupted":
            raise KeyboardInterrupt(recording.stopped.sentence)
        return strip_settings(recording, experiment, f"{self.exercise.name} of {student}")


def device_of_student(student: str, exercise: Exercise, secret_file: Path) -> DeviceChoice:
    """Return the device that is a student's motor in an exercise, in virtual time."""
    from servobench.rig.devices.assigned import NAME

    return DeviceChoice(
        name=NAME,
        settings={
            "secret": str(secret_file),
            "exercise": exercise.name,
            "student": student,
            "shared": _common_settings(exercise.experiment.device),
        },
    )


def strip_settings(recording: Recording, experiment: Experiment, name: str) -> Recording:
    """Return a recording with the measurements and the experiment only: no settings, events or seed."""
    public = experiment.model_copy(update={"device": DeviceChoice(), "seed": 0})
    info = None if recording.info is None else replace(recording.info, settings=())
    return replace(
        recording,
        name=name,
        source=Source(name=name),
        info=info,
        experiment=public.to_toml(),
        findings=(),
        events=(),
        versions={},
    )


def _common_settings(device: DeviceChoice) -> dict[str, Any]:
    return {name: value for name, value in device.settings.items() if name != _OWN_TIME}
