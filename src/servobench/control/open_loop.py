"""No control: the reference is the voltage."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from servobench.channels import Sample
from servobench.control.base import CONTROLLERS


@CONTROLLERS.member("open_loop")
class OpenLoop(BaseModel):
    """u[k] = r[k]: the reference [V] goes to the motor as it is."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    def start(self, sample_time: float) -> None:
        """Return the state: there is none."""

    def step(self, state: None, reference: float, sample: Sample) -> tuple[None, float]:
        """Return the reference as the voltage [V]."""
        return None, reference
