"""The kind `control`: each member turns a reference and a sample into a voltage."""

from __future__ import annotations

from typing import Any, Protocol, TypeAlias, runtime_checkable

from servobench.core.channels import DeviceInfo, Sample
from servobench.core.registry import Registry

State: TypeAlias = Any


@runtime_checkable
class Controller(Protocol):
    """A control law; its settings are frozen, its state is a value that is passed and returned.

    The law learns what the voltage is limited to from the channel `voltage` of the device's description: who limits it further
    narrows that channel (`DeviceInfo.with_limit`). It returns the voltage that it wants, beyond the limit too, so that whoever
    limits it can tell that it was.
    """

    @property
    def reference_unit(self) -> str:
        """The unit of the reference: V where it is the voltage itself, rad or rad/s where it is followed."""
        ...

    def start(self, sample_time: float, info: DeviceInfo) -> State:
        """Return the state before the first tick of a motor at rest, for that sample time [s] and device.

        Compiles what has to be, so that the first tick doesn't wait for it. Raises `UsageError` where the device lacks what the
        law needs.
        """
        ...

    def step(self, state: State, reference: float, sample: Sample) -> tuple[State, float]:
        """Return the next state and the voltage [V] for this tick."""
        ...

    def take_over(
        self, sample_time: float, info: DeviceInfo, reference: float, sample: Sample, voltage: float
    ) -> State:
        """Return the state from which `step(state, reference, sample)` gives `voltage`, of a motor that may be turning.

        That is a bumpless switch to this law, from any other or from the same with other gains: `voltage` [V] is what was applied
        last. A law without feedback, whose reference is in V, gives its reference instead. `sample.counts` may be the counter's
        value or the unwrapped travel, which agree up to whole wraps: given the travel, the position continues from there, given
        the counter, it starts again within the counter's range.
        Raises `UsageError` as `start` does.
        """
        ...


CONTROLLERS: Registry[type[Controller]] = Registry(
    "controller", "servobench.systems.control", "servobench.control"
)
