"""The stage `derivative`: the backward difference."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.recordings.measurement.base import STAGES, Kind, speed_of_position


@STAGES.member("derivative")
@dataclass(frozen=True)
class Derivative:
    """The speed y[k] = (x[k] - x[k-1]) / (t[k] - t[k-1]) of a position x; y[0] = 0.

    That is by definition the mean speed since the sample before, not the speed at t[k].
    """

    linear: ClassVar[bool] = True
    examples: ClassVar[tuple[str, ...]] = ("derivative",)

    @classmethod
    def parse(cls, arguments: tuple[str, ...]) -> Self:
        """Return the stage; it takes no arguments."""
        if arguments:
            raise UsageError(
                f"`derivative {' '.join(arguments)}`: `derivative` takes no settings; join stages with `|`"
            )
        return cls()

    @property
    def symbol(self) -> tuple[str, ...]:
        """Numerator and denominator in terms of one sample time T, for a diagram."""
        return "1 − z^{−1}", "T"

    def yields(self, kind: Kind) -> Kind:
        """A speed, of a position."""
        return speed_of_position("derivative", kind)

    def first_valid(self, first: int, t: Array) -> int:
        """One sample later than the input."""
        return first + 1

    def start_response(self, t: Array) -> None:
        """Nothing decays: the stage looks back by one sample."""
        return None

    def start(self) -> None:
        """No sample before the first."""
        return None

    def step(self, state: float | None, x: float, dt: float) -> tuple[float, float]:
        """The difference to the sample before, which is the state."""
        return x, 0.0 if state is None else (x - state) / dt

    def block(self, state: float | None, x: Array, dt: Array) -> tuple[float, Array]:
        """The differences of a block of samples (N,), N at least 1."""
        from servobench.recordings.measurement.kernels import slopes

        before, known = (0.0, 1) if state is None else (state, 0)
        return float(x[-1]), slopes(x, before, dt, known)

    def __call__(self, x: Array, t: Array) -> Array:
        """All differences at once."""
        y = np.zeros(x.shape)
        y[1:] = (np.diff(x, axis=0).T / np.diff(t)).T
        return y

    def __str__(self) -> str:
        return "derivative"
