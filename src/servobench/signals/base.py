"""The kind `signals`: excitations and references, pure functions of time."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from servobench.channels import Array
from servobench.registry import Registry


@runtime_checkable
class Signal(Protocol):
    """A value for every time; the same times give the same values, for ever and on every machine."""

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s], shape (N,), as shape (N,)."""
        ...

    @property
    def period(self) -> float | None:
        """The time after which the signal repeats [s]; None where it doesn't."""
        ...


SIGNALS: Registry[type[Signal]] = Registry("signal", "servobench.signals")
