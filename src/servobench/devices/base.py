"""The kind `devices`: what turns a voltage into motion, and counts it."""

from __future__ import annotations

from types import TracebackType
from typing import Protocol, Self, runtime_checkable

from servobench.channels import DeviceInfo, Sample
from servobench.registry import Registry


@runtime_checkable
class Device(Protocol):
    """A motor, simulated or real; a context manager: entering connects at zero volts, leaving stops and closes.

    Each tick of a run is one `read` and then one `write`. Any method but `stop` may raise `DeviceError`.
    """

    @property
    def info(self) -> DeviceInfo:
        """What the device is."""
        ...

    def __enter__(self) -> Self:
        """Connect; the motor is at zero volts."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop the motor and close the connection."""
        ...

    def start(self, sample_time: float, seed: int | None) -> None:
        """Prepare a run with that sample time [s]; the motor is at rest; a seed makes simulated noise repeatable."""
        ...

    def read(self) -> Sample:
        """Latch and return the inputs at t_k; waits for the tick where the device is its own time base."""
        ...

    def write(self, voltage: float) -> float:
        """Hold a finite voltage [V] from t_k (+ `info.delay`) to t_k+1 and return the voltage that the device puts out.

        The two differ where the device limits. Never sleeps. Raises `UsageError` for a voltage that isn't finite.
        """
        ...

    def stop(self) -> None:
        """Put the motor into its safe state, zero volts; may be called twice; never raises."""
        ...


DEVICES: Registry[type[Device]] = Registry("device", "servobench.devices")
