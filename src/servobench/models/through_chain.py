"""From the shaft's own response to a prediction: through the data's chain, with the unknown states of its filters."""

from __future__ import annotations

import numpy as np

from servobench.channels import Array
from servobench.measurement.dataset import Dataset
from servobench.models.base import Parameter, Prediction


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
    """Return the prediction for a shaft's response y (M,), its derivatives (M, C), and the states of the filters (S,).

    Without a chain they are the prediction themselves.
    """
    if not (data.declared or data.applied):
        return Prediction(y=y, jacobian=jacobian, valid=np.ones(len(y), dtype=bool))
    passed = data.chain.linear(np.column_stack([y, jacobian]), data.t_output)
    responses = data.start_responses
    return Prediction(
        y=passed[:, 0] + responses @ filters,
        jacobian=np.hstack([passed[:, 1:], responses]),
        valid=data.valid,
    )
