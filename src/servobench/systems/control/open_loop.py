"""No control: the reference is the voltage."""

from __future__ import annotations

from typing import Any

from pydantic import model_validator

from servobench.core.channels import DeviceInfo, Sample
from servobench.core.settings import Settings
from servobench.systems.control.base import CONTROLLERS


@CONTROLLERS.member("open_loop")
class OpenLoop(Settings):
    """u[k] = r[k]: the reference [V] goes to the motor as it is, from the first sample on.

    Nothing fades in, not even after a switch from another law: any transition would be a signal that nobody asked for
    (docs/decisions/0019-control.md).
    """

    @model_validator(mode="before")
    @classmethod
    def _without_fade(cls, settings: Any) -> Any:
        """Read the files of earlier versions, which had a time constant for such a transition."""
        if isinstance(settings, dict):
            return {name: value for name, value in settings.items() if name != "fade_time"}
        return settings

    @property
    def reference_unit(self) -> str:
        """Volts."""
        return "V"

    @property
    def symbol(self) -> tuple[str, ...]:
        """The factor of the reference, for a diagram."""
        return ("1",)

    def start(self, sample_time: float, info: DeviceInfo) -> None:
        """Return the state: there is none."""

    def step(self, state: None, reference: float, sample: Sample) -> tuple[None, float]:
        """Return the reference as the voltage [V]."""
        return None, reference

    def take_over(
        self, sample_time: float, info: DeviceInfo, reference: float, sample: Sample, voltage: float
    ) -> None:
        """Return the state: the next voltage is the reference, whatever was applied before."""
