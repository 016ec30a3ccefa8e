"""A chain applied to successive blocks of samples, as they arrive while a motor turns."""

from __future__ import annotations

from functools import cache
from typing import Protocol, TypeGuard, runtime_checkable

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.measurement.base import Chain, Stage, State


@runtime_checkable
class Blockwise(Protocol):
    """A stage that can go on with a whole block at once."""

    def block(self, state: State, x: Array, dt: Array) -> tuple[State, Array]:
        """Return the state after samples x (N,), dt (N,) [s] apart, and the outputs (N,): what N steps give, to rounding."""
        ...


def process_block(chain: Chain, state: State, x: Array, dt: Array) -> tuple[State, Array]:
    """Return the state after samples x (N,) and the outputs (N,), going on from a state of the chain.

    dt (N,) is the time since the sample before (0 for the first of all) [s]. Blocks one after the other give what the fold of
    `step` gives. Raises what the stages raise.
    """
    after = []
    for stage, before in zip(chain.stages, state, strict=True):
        if len(x) == 0:
            after.append(before)
        elif _is_blockwise(stage):
            now, x = stage.block(before, x, dt)
            after.append(now)
        else:
            now, x = _step_by_step(stage, before, x, dt)
            after.append(now)
    return tuple(after), x


def _is_blockwise(stage: Stage) -> TypeGuard[Blockwise]:
    return _has_block(type(stage))


@cache
def _has_block(kind: type[Stage]) -> bool:
    """Asked thirty times a second, and to look through a protocol takes as long as the filter itself."""
    return issubclass(kind, Blockwise)


def _step_by_step(stage: Stage, state: State, x: Array, dt: Array) -> tuple[State, Array]:
    out = np.empty(len(x))
    for k in range(len(x)):
        state, out[k] = stage.step(state, float(x[k]), float(dt[k]))
    return state, out
