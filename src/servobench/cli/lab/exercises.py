"""The exercise that a command names, and the motor for it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from servobench.lab.exercise import Exercise
    from servobench.lab.stand import MotorStand


def exercise_folder(folder: Path | None) -> Path:
    """Return the folder that the exercises lie in; raises `UsageError` where it is none."""
    from servobench.core.errors import UsageError
    from servobench.lab.exercise_file import FOLDER

    if folder is not None and not folder.is_dir():
        raise UsageError(f"--folder {folder} isn't a folder; expected one with exercises, NAME.md")
    return folder or FOLDER


def exercise_by_name(name: str, folder: Path | None) -> Exercise:
    """Return the exercise of a name in the folder, or of a file."""
    from servobench.lab.exercise_file import exercise, load_exercise

    where = exercise_folder(folder)
    return load_exercise(Path(name)) if name.endswith(".md") else exercise(name, where)


def stand_of_recording(exercise: Exercise, recording: Path) -> MotorStand:
    """Return a stand that has a recording of the exercise's experiment, and no motor."""
    from servobench.core.errors import UsageError
    from servobench.lab.stand import check_made_for, stand_of
    from servobench.recordings.loading.load import load

    made = load(recording)
    if len(made) != 1:
        raise UsageError(f"{recording} holds {len(made)} recordings; expected one of this exercise")
    stand = stand_of(exercise, made[0], str(recording))
    check_made_for(exercise, made[0], str(recording))
    return stand


def motor_stand(exercise: Exercise, device: str | None) -> MotorStand:
    """Return a stand with the exercise's own device, or the one that is named."""
    from servobench.cli.device_choice import device_choice
    from servobench.core.errors import UnknownName, UsageError
    from servobench.lab.stand import stand_on_the_twin, stand_with

    own = exercise.experiment.device
    if device is None and own.name == "twin":
        return stand_on_the_twin(exercise)
    if device is None or device == own.name:
        try:
            return stand_with(exercise, own)
        except UnknownName as error:
            if device is not None:
                raise
            raise UsageError(
                f"{exercise.source}: the table [device]: {error}; mend it, or give --device"
            ) from None
    where = (
        'in an exercise of your own, with name = "{}" in [device] and the settings in [device.settings]; for an '
        "existing recording, use `servobench lab do` with --recorded FILE instead of --device"
    )
    return stand_with(exercise, device_choice(device, own, where))
