"""The kind `tuning`: a method that finds a controller for a motor and a specification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self, TypeAlias, runtime_checkable

from servobench.core.errors import UsageError
from servobench.core.registry import Registry
from servobench.systems.control.lead import Lead
from servobench.systems.control.pid import Pid
from servobench.systems.control.running import Output
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.first_order import FirstOrderMotor

Tunable: TypeAlias = Pid | Lead | StateFeedback


@dataclass(frozen=True, kw_only=True)
class Wish:
    """The specification of a closed loop; None for unspecified values.

    `controller` is the law's name, `output` what it follows, `sample_time` [s] the time between its ticks, `voltage_limit` [V]
    what it may put out, `step` [rad or rad/s] a change of the reference that shall not ask for more than that. For pole
    placement: `damping` ζ and `bandwidth` ω [rad/s] of a pair of poles, or `poles` [rad/s], each negative or one of a complex
    pair. For λ-tuning: `closed_loop` λ [s]. `cutoff` [rad/s] of the speed's filter.
    """

    controller: str
    output: Output
    sample_time: float
    voltage_limit: float = 10.0
    step: float | None = None
    damping: float | None = None
    bandwidth: float | None = None
    poles: tuple[complex, ...] = ()
    closed_loop: float | None = None
    cutoff: float | None = None

    def slower(self, factor: float) -> Self:
        """Return the same wish for a loop that is slower by a factor."""
        return replace(
            self,
            bandwidth=None if self.bandwidth is None else self.bandwidth / factor,
            poles=tuple(pole / factor for pole in self.poles),
            closed_loop=None if self.closed_loop is None else self.closed_loop * factor,
        )


class Unreachable(UsageError):
    """A wish that no gains fulfil, though a slower or a faster one may be reached."""


@runtime_checkable
class Method(Protocol):
    """A way to find gains."""

    def __call__(self, motor: FirstOrderMotor, wish: Wish) -> Tunable:
        """Return the controller of a motor, in rad, for a wish; whether it is a good one its poles and margins say.

        Raises `UsageError` where the wish lacks something, `Unreachable` where no gains of the right sign fulfil it.
        """
        ...

    def poles(self, wish: Wish) -> tuple[complex, ...]:
        """Return the specified poles [1/s] of the closed loop, both of a pair; raises `UsageError` as the call does."""
        ...

    def poles_cancelled(self, motor: FirstOrderMotor, wish: Wish) -> tuple[complex, ...]:
        """Return the motor's poles [1/s] that the controller's zeros cancel."""
        ...

    def quantities(self, wish: Wish, poles: Sequence[complex]) -> Mapping[str, tuple[float, str]]:
        """Return what a wish is made of besides poles, by name, as it follows from some poles, with its unit."""
        ...

    def speed_text(self, wish: Wish) -> str:
        """Return the part of a wish that makes the loop fast or slow, in the words of the command line."""
        ...


METHODS: Registry[Method] = Registry("method", "servobench.systems.tuning", "servobench.tuning")


def as_printed(value: float, digits: int = 5) -> float:
    """Return a gain as it is printed and pasted, so that what is judged is what runs: to so many digits."""
    return float(f"{value:.{digits}g}")


def law_error(wish: Wish, method: str, can: str) -> UsageError:
    """Return the error for a law that a method doesn't tune."""
    return UsageError(
        f"{method} finds no gains of {wish.controller!r} for the {wish.output}; it does for {can}"
    )
