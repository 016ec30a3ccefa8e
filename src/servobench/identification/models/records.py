"""The common part of all structures with the state (θ, ω): a record's start state, its chain, and a start near rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.identification.models.base import Parameter, Prediction
from servobench.recordings.measurement.dataset import Dataset

START_POSITION = Parameter(name="start_position", meaning="position at the first sample", unit="{position}")
START_SPEED = Parameter(name="start_speed", meaning="speed at the first sample", unit="{position}/s")
AT_REST = replace(START_SPEED, lower=0.0, upper=0.0)

_RELEASED = 0.1  # of the speed that friction takes: a start speed beside the kink at rest, for a guess


def is_plain(data: Dataset) -> bool:
    """Return whether the data are the shaft's position or speed itself, with no chain behind it."""
    return not (data.declared or data.applied)


def start_parameters(data: Dataset) -> tuple[Parameter, ...]:
    """Return the nuisance parameters of a record: where and how fast it starts, and the unknown states of its filters."""
    speed = AT_REST if data.starts_at_rest else START_SPEED
    own = (START_POSITION, speed) if data.kind == "position" else (speed,)
    return own if is_plain(data) else own + filter_parameters(data)


def filter_parameters(data: Dataset) -> tuple[Parameter, ...]:
    """Return the nuisance parameters that a record's chain brings along: the unknown states of its filters."""
    units = {"position": "{position}", "speed": "{position}/s"}
    return tuple(
        Parameter(
            name=f"start_state_{n}",
            meaning=f"state of '{state.stage}' at the first sample",
            unit=units[state.kind],
        )
        for n, state in enumerate(data.start_states, start=1)
    )


def through_chain(y: Array, jacobian: Array, filters: Array, data: Dataset) -> Prediction:
    """Return the prediction for a shaft y (M,) with its derivatives (M, C); `filters` (S,) are the start states of filters."""
    if is_plain(data):
        return Prediction(y=y, jacobian=jacobian, valid=np.ones(len(y), dtype=bool))
    # Far from any motor sensitivities may grow beyond all numbers: a search takes such a place for infinitely bad.
    with np.errstate(over="ignore", invalid="ignore"):
        passed = data.chain.linear(np.column_stack([y, jacobian]), data.t_output)
    responses = data.start_responses
    return Prediction(
        y=passed[:, 0] + responses @ filters,
        jacobian=np.hstack([passed[:, 1:], responses]),
        valid=data.valid,
    )


def beside_rest(moving: Array, still: NDArray[np.int64], lost_speed: float) -> list[Array]:
    """Return a guess (P + ΣQ,), the same with the start speeds at `still` (K,) at rest, and with them moving the other way.

    A shaft that sticks at first has a start speed near zero, where the sum of squares has a kink: a search from
    beside it could end at the kink's wrong side. So one begins on each side, and one at rest.
    """
    if not len(still):
        return [moving]
    resting, other_way = moving.copy(), moving.copy()
    resting[still] = 0.0
    other_way[still] = -np.copysign(_RELEASED * lost_speed, moving[still])
    return [moving, resting, other_way]


def with_input(data: Dataset, times: Array, values: Array) -> Dataset:
    """Return a record whose input is something else that the motor did, `values` (N,) at `times` (N,) [s], without any delay."""
    return replace(
        data,
        t_input=times,
        u=values,
        input_before=float(values[0]),
        delay=0.0,
        reference=None,
    )
