"""What friction leaves of a deviation of the speed where a shaft stops or turns back.

Where the speed passes through zero, friction changes its sense: the shaft slows down at a rate a before, and speeds up at a - Δ
after. A shaft that is faster by δ turns back later by δ/a, and is then behind by δ (a - Δ)/a: of the deviation a part
ρ = (a - Δ)/a is left (the saltation of a flow with an edge: Aizerman and Gantmakher 1958). A shaft that stops keeps nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Sliding:
    """What is `left` (M,) of a deviation of the speed since the sample before, beside its decay, and the times [s] that it went.

    1 where the shaft slides, 0 where it rests, ρ where it has turned back; `turns` (M,) are when it stopped or turned back.
    """

    left: Array
    turns: Array

    @classmethod
    def all_through(cls, t: Array) -> Sliding:
        """Return that of a shaft that never rests and on which friction doesn't change, at times t (M,) [s]."""
        return cls(left=np.ones(len(t)), turns=t)

    @classmethod
    def of_speed(cls, speed: Array, t: Array, change: float) -> Sliding:
        """Return that of a shaft with a `speed` (M,) at times t (M,) [s] whose acceleration changes by `change` in turning back.

        The rate a before it follows from the speeds A before and B after it: A/a + B/(a - Δ) is the time between the samples,
        which is short compared with τ. A shaft that stops does so half-way.
        """
        change = max(change, 0.0)
        left, turns = np.asarray(speed != 0, dtype=np.float64), t.astype(np.float64)
        turns[1:] -= 0.5 * np.diff(t)
        with np.errstate(invalid="ignore", over="ignore"):  # a trial may run away, and its cost refuses it
            turned = np.flatnonzero(speed[1:] * speed[:-1] < 0) + 1
            before, after, h = np.abs(speed[turned - 1]), np.abs(speed[turned]), t[turned] - t[turned - 1]
            middle = 0.5 * (before + after + h * change)
            rate = (middle + np.sqrt(np.maximum(middle**2 - h * change * before, 0.0))) / h
            left[turned] = np.maximum(1.0 - change / rate, 0.0)
            turns[turned] = t[turned - 1] + np.minimum(before / rate, h)
        return cls(left=left, turns=turns)
