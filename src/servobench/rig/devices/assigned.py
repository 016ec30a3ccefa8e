"""A simulated motor assigned to a student: a twin whose parameters only the owner of the secret can compute."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, ValidationError

from servobench.core.channels import DeviceInfo, Sample
from servobench.core.errors import UsageError
from servobench.core.settings import Settings
from servobench.rig.devices.base import DEVICES
from servobench.rig.devices.handover import Handing
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.motor.individual import individual
from servobench.rig.motor.physics import MotorState
from servobench.rig.motor.secret import read_secret

NAME = "assigned"


class AssignedSettings(Settings):
    """Whose motor it is; its parameters stand nowhere."""

    secret: Path
    """The file with the secret that the motors are drawn from."""
    exercise: Annotated[str, Field(min_length=1)]
    """Name of the exercise; in each, everybody has another motor."""
    student: Annotated[str, Field(min_length=1)]
    """Whose motor it is; capitals and blanks around make no difference."""
    shared: Mapping[str, Any] = Field(default_factory=dict)
    """Settings of the twin that all of these motors share, and that anybody may know."""
    timing: Literal["virtual", "host"] = "virtual"
    """Whether time is computed, as fast as can be, or waited for."""


@DEVICES.member(NAME)
class Assigned:
    """A simulated motor that `servobench lab assess` assigned to a student; it doesn't reveal its parameters.

    It behaves as the twin with these parameters does. Raises `UsageError` for a secret that can't be read, or that others can.
    """

    Settings: ClassVar[type[AssignedSettings]] = AssignedSettings

    def __init__(self, settings: AssignedSettings) -> None:
        own = individual(read_secret(settings.secret), settings.exercise, settings.student)
        twin_settings = {**settings.shared, **own.twin_settings, "timing": settings.timing}
        try:
            chosen = TwinSettings.model_validate(twin_settings)
        except ValidationError as error:
            # Told by the names alone: what pydantic says would show the values.
            names = ", ".join(sorted({".".join(map(str, each["loc"])) for each in error.errors()}))
            raise UsageError(f"{NAME}: the twin has no settings {names}, which `shared` gives") from None
        self._twin = Twin(chosen)
        self._noise_seed = own.noise_seed

    @property
    def info(self) -> DeviceInfo:
        """The motor's description: its channels, and none of its settings."""
        return replace(self._twin.info, name=NAME, settings=())

    def __enter__(self) -> Self:
        """Connect; the shaft is at rest."""
        self._twin.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop and close."""
        self._twin.__exit__(kind, error, trace)

    def start(self, sample_time: float, seed: int | None) -> None:
        """Prepare a run with that sample time [s]; a seed makes the noise repeatable, and is not the noise's own."""
        self._twin.start(sample_time, None if seed is None else self._noise_seed + seed)

    def read(self) -> Sample:
        """Let the time since the last sample pass, then latch counts, current and speed."""
        return self._twin.read()

    def read_after(self, delay: float) -> Sample:
        """Latch the next sample a time [s] after its tick."""
        return self._twin.read_after(delay)

    def write(self, voltage: float) -> float:
        """Hold a voltage [V] from now on, and return it within the amplifier's limits."""
        return self._twin.write(voltage)

    def stop(self) -> None:
        """Put zero volts on the motor, at once."""
        self._twin.stop()

    @property
    def in_blocks(self) -> Handing | None:
        """The twin behind it, in virtual time."""
        return self._twin.in_blocks if type(self) is Assigned else None

    def light(self, red: float, green: float, blue: float) -> None:
        """Light the lamp, each colour from 0 to 1."""
        self._twin.light(red, green, blue)

    def block(self, blocked: bool) -> None:
        """Hold the shaft where it is, from the last sample on, or let it go."""
        self._twin.block(blocked)

    @property
    def state(self) -> MotorState:
        """The hidden state at the last sample; for tests."""
        return self._twin.state

    def coast(self, duration: float) -> MotorState:
        """Let time pass without sampling, and return the hidden state after it [s]; for tests."""
        return self._twin.coast(duration)
