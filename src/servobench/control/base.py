"""The kind `control`: what turns a reference and a sample into a voltage."""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias, runtime_checkable

from servobench.channels import Sample
from servobench.registry import Registry

State: TypeAlias = Any


@runtime_checkable
class Controller(Protocol):
    """A control law; its settings are frozen, its state is a value that is passed and returned."""

    def start(self, sample_time: float) -> State:
        """Return the state before the first tick, for that sample time [s]."""
        ...

    def step(self, state: State, reference: float, sample: Sample) -> tuple[State, float]:
        """Return the next state and the voltage [V] for this tick."""
        ...


CONTROLLERS: Registry[type[Controller]] = Registry("controller", "servobench.control")
