"""The stand of an exercise: a motor to run experiments on, or a recording alone, and all facts that come of it.

A study's facts are found when they are first requested, by a rule or by another study. A stand carries each study out once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from threading import RLock
from typing import TYPE_CHECKING

from servobench.core.channels import DeviceInfo
from servobench.core.errors import NotIdentifiable, UnknownName, UsageError
from servobench.lab.evidence import Evidence
from servobench.lab.exercise import Exercise
from servobench.lab.expression import Fact
from servobench.lab.studies.base import StudyResult, carry_out, facts_in
from servobench.rig.experiment import Experiment
from servobench.rig.experiment.experiment import DeviceChoice

if TYPE_CHECKING:
    from servobench.recordings.recording import Recording
    from servobench.rig.devices.base import Device

TWIN = "twin"


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorStand:
    """The `Stand` of an exercise's studies; `carry_out` runs an experiment on the motor."""

    exercise: Exercise
    experiment: Experiment
    """The exercise's own experiment, as it is carried out here."""
    info: DeviceInfo
    """The device's description."""
    made: Recording | None = None
    """The recording of the experiment, where there is one already."""
    carry_out: Callable[[Experiment], Recording]
    _shown: dict[str, StudyResult] = field(default_factory=dict, init=False)
    _under_way: list[str] = field(default_factory=list, init=False)
    _one_at_a_time: RLock = field(default_factory=RLock, init=False)  # a panel asks from several threads

    @cached_property
    def recording(self) -> Recording:
        """The recording of the exercise's experiment; it is made on first use."""
        with self._one_at_a_time:
            return self.made or self.carry_out(self.experiment)

    def run(self, experiment: Experiment) -> Recording:
        """Carry out another experiment on the same motor, and return what happened."""
        return self.carry_out(experiment)

    @cached_property
    def facts(self) -> Mapping[str, Fact]:
        """All facts by name: of the evidence, and of the studies as `NAME_...`."""
        return _AllFacts(Evidence(self.experiment, self.info, lambda: self.recording), self)

    def study_result(self, name: str) -> StudyResult:
        """Return the results of the study of that name, which is carried out on first use.

        Raises `UnknownName` for a study that the exercise hasn't, `UsageError` with file and line for one that can't be carried
        out or that asks for what only it will tell, and `NotIdentifiable` where the motor or the recording doesn't tell it.
        """
        if name not in self.exercise.studies:
            raise UnknownName("study", name, self.exercise.studies)
        place = self.exercise.place_of_study(name)
        with self._one_at_a_time:
            if name in self._under_way:
                around = " → ".join([*self._under_way[self._under_way.index(name) :], name])
                raise UsageError(
                    f"{place}: the study {name!r} needs its own facts to find them ({around}); leave one of them out there"
                )
            if name not in self._shown:
                self._under_way.append(name)
                try:
                    self._shown[name] = carry_out(self.exercise.studies[name], self)
                except NotIdentifiable as error:
                    raise NotIdentifiable(f"the study {name!r}: {error}") from error
                except UsageError as error:
                    if str(error).startswith(f"{self.exercise.source}:"):
                        raise  # the study that it comes from is named already
                    raise UsageError(f"{place}: the study {name!r}: {error}") from error
                finally:
                    self._under_way.pop()
            return self._shown[name]

    def facts_so_far(self) -> Mapping[str, Fact]:
        """Return the facts of the studies that were carried out until now, by name."""
        return {
            key: fact for name, shown in self._shown.items() for key, fact in facts_in(name, shown).items()
        }


@dataclass(frozen=True, eq=False)
class _AllFacts(Mapping[str, Fact]):
    """The evidence, and the facts of studies; a study is carried out when one of its facts is used, not to list them."""

    evidence: Evidence
    stand: MotorStand

    def __getitem__(self, name: str) -> Fact:
        """Return a fact; raises `KeyError` where there is none of that name."""
        study, _, rest = name.partition("_")
        if rest and study in self.stand.exercise.studies:
            return facts_in(study, self.stand.study_result(study))[name]
        return self.evidence[name]

    def __iter__(self) -> Iterator[str]:
        return iter({**dict.fromkeys(self.evidence), **dict.fromkeys(self.stand.facts_so_far())})

    def __len__(self) -> int:
        return len(list(iter(self)))


@lru_cache(maxsize=64)
def stand_on_the_twin(exercise: Exercise) -> MotorStand:
    """Return the stand of an exercise with the simulated motor, in virtual time; raises `UsageError` if another is requested."""
    if exercise.experiment.device.name != TWIN:
        raise UsageError(
            f"{exercise.source}: the device is {exercise.experiment.device.name!r}; only the twin runs without a motor"
        )
    return stand_with(exercise, exercise.experiment.device)


def stand_with(exercise: Exercise, device: DeviceChoice) -> MotorStand:
    """Return the stand of an exercise with a device, a twin in virtual time; nothing moves until a recording is requested.

    Raises `UnknownName` for a device that isn't known, and `UsageError` for settings that it hasn't.
    """
    chosen = _in_virtual_time(device) if device.name == TWIN else device

    def carry_out(experiment: Experiment) -> Recording:
        from servobench.rig.loop.live import run_where_its_time_passes

        chosen_experiment = experiment.model_copy(update={"device": _same_motor(chosen, experiment.device)})
        recording = run_where_its_time_passes(chosen_experiment, _make_device(chosen_experiment.device))
        if recording.stopped.reason == "interrupted":
            raise KeyboardInterrupt(recording.stopped.sentence)  # who stops a run doesn't want the next one
        return recording

    return MotorStand(
        exercise=exercise,
        experiment=exercise.experiment.model_copy(update={"device": chosen}),
        info=_make_device(chosen).info,
        carry_out=carry_out,
    )


def stand_of(exercise: Exercise, recording: Recording, called: str = "") -> MotorStand:
    """Return the stand of an exercise with a recording alone: a study that needs a run gets an error that there is no motor.

    `called` is what the recording is called in what is told of it, such as its file; by its own name without one.
    Raises `UsageError` for a recording that doesn't say what device it is of.
    """
    if recording.info is None:
        raise UsageError(
            f"{called or recording.name} doesn't name its device, so it can't be used for an exercise; expected a "
            "recording made by the panel or by `servobench run`. For any other, `servobench identify "
            f"{called or recording.name}` finds the motor"
        )

    def refuse(experiment: Experiment) -> Recording:
        raise NotIdentifiable(
            f"this takes further runs of the motor, and {called or recording.name} is a single recording; do the "
            "exercise with the motor, or with the simulated one"
        )

    return MotorStand(
        exercise=exercise,
        experiment=exercise.experiment,
        info=recording.info,
        made=recording,
        carry_out=refuse,
    )


def check_made_for(exercise: Exercise, recording: Recording, called: str = "") -> None:
    """Raise `UsageError` for a recording whose own experiment drives the motor otherwise than the exercise's.

    `called` is what the recording is called then, by its own name without one. A recording that doesn't say what experiment it
    is of is taken as it is.
    """
    from servobench.rig.experiment.reading import read_experiment

    if not recording.experiment:
        return
    made, own = read_experiment(recording.experiment, recording.name), exercise.experiment
    parts = {
        "signal": (made.signal, own.signal),
        "controller": (made.controller, own.controller),
        "sample time": (made.sample_time, own.sample_time),
    }
    other = [name for name, (theirs, ours) in parts.items() if theirs != ours]
    if other:
        raise UsageError(
            f"{called or recording.name} comes from another experiment than the exercise {exercise.name!r}: its "
            f"{' and '.join(other)} {'is' if len(other) == 1 else 'are'} not the exercise's. Load the exercise's "
            f"experiment in the panel, or copy it from the page of `servobench lab do {exercise.name} --page PAGE.html`, "
            "and record it"
        )


def _make_device(device: DeviceChoice) -> Device:
    """The device, not yet entered."""
    from servobench.rig.devices.base import connect
    from servobench.rig.devices.faulty import with_faults

    return with_faults(connect(device.name, **device.settings), device.faults)


def _in_virtual_time(device: DeviceChoice) -> DeviceChoice:
    return device.model_copy(update={"settings": {**device.settings, "timing": "virtual"}})


def _same_motor(own: DeviceChoice, choice: DeviceChoice) -> DeviceChoice:
    """The stand's own motor; what a study asks of a twin beside, such as another dead band, is set on top."""
    if own.name != choice.name or own.name != TWIN:
        return own
    return _in_virtual_time(choice.model_copy(update={"settings": {**own.settings, **choice.settings}}))
