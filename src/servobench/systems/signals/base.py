"""The kind `signals`: excitations and references, pure functions of time.

A member is a class of settings that `SIGNALS.member(name)` decorates. `edges` says where times lie in a period, so that an edge
falls on its sample.
"""

from __future__ import annotations

from typing import Annotated, Protocol, TypeAlias, TypeVar, runtime_checkable

from pydantic import AfterValidator, Field, ValidationInfo

from servobench.core.channels import Array
from servobench.core.registry import Registry
from servobench.core.settings import In, MemberOf

T = TypeVar("T")


@runtime_checkable
class Signal(Protocol):
    """A value for every time; the same times give the same values, always and on every machine.

    A signal that has a `start` is at its resting value before it (`low`, `offset`, `rest` or `initial`), and repeats only after
    it. Members are `Settings`, so that a file can hold them; a field without a default has an example.
    """

    def __call__(self, t: Array) -> Array:
        """Return the value at times t [s], shape (N,), as shape (N,)."""
        ...

    @property
    def period(self) -> float | None:
        """The time after which the signal repeats [s]; None where it doesn't."""
        ...

    @property
    def shortest_change(self) -> float | None:
        """The shortest time between two of its changes [s]; None where there are no two.

        Half a period of its highest frequency, or the shortest time between two edges. Less than a sample time can't be put out.
        """
        ...


SIGNALS: Registry[type[Signal]] = Registry("signal", "servobench.systems.signals", "servobench.signals")

AnySignal: TypeAlias = Annotated[Signal, MemberOf(SIGNALS)]
"""A field that holds a signal: any member of the kind, or a table such as `{type = "square", low = "1 V"}`."""

Level: TypeAlias = Annotated[float, In("V")]
"""A value of a signal. A text has to be in volts; a bare number is in the unit of what the signal drives."""


def at_least_one(values: tuple[T, ...]) -> tuple[T, ...]:
    """Return the values; raises ValueError where there are none. A validator of fields that hold several things."""
    if not values:
        raise ValueError("is empty; expected one at least")
    return values


Amplitude: TypeAlias = Annotated[Level, Field(ge=0)]


def _not_below_low(high: float, info: ValidationInfo) -> float:
    low = info.data.get("low", high)
    if high < low:
        raise ValueError(f"high = {high:g} is below low = {low:g}; exchange them")
    return high


HighLevel: TypeAlias = Annotated[Level, Field(validate_default=True), AfterValidator(_not_below_low)]
"""The upper of two levels, in a signal that has a field `low` before it."""
