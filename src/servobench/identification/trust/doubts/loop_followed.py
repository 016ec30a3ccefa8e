"""A control loop that doesn't work: it swings between the voltage limits, or runs away from its reference.

The identification may still be right, because the applied voltage is known; but the user of the loop wants to know. Three
things are checked: how much of the time the voltage is at its limit, how often it changes to the opposite limit compared with
the reversals of the reference, and whether the shaft is ever nearer to the reference than it would have been at rest.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_AT_LIMIT = 0.99  # of the largest voltage
_MUCH = 0.5  # of the time
# Changes from limit to limit for each turn of the reference, the start among them: the quickest loop of all needs two, one to set
# off and one to brake.
_PER_TURN = 2


def _about_data(records: Sequence[Dataset]) -> list[Finding]:
    return [
        finding
        for data in records
        if data.closed_loop and len(data.y) >= 20 and data.reference is not None
        for finding in (*_swings(data, data.reference), *_runs_away(data, data.reference))
    ]


def _swings(data: Dataset, reference: Array) -> list[Finding]:
    """Whether the voltage goes from one limit to the other far more often than the reference asks for."""
    most = float(np.abs(data.u).max())
    at_limit = np.abs(data.u) >= _AT_LIMIT * most
    share = float(at_limit.mean())
    changes = int(np.count_nonzero(np.diff(np.sign(data.u[at_limit]))))
    if most == 0 or share < _MUCH or changes <= _PER_TURN * (_turns(reference) + 1):
        return []
    sentence = (
        f"{data.name}: the loop oscillates: its voltage is at its limit of ±{most:.3g} "
        f"{data.input_unit} for {100 * share:.0f} % of the time and changes sign {changes} times. "
        "The loop is unstable or its gains are far too high: choose smaller ones (servobench tune "
        "does). The model uses the applied voltage, so it may still be right."
    )
    return [info("loop-swings", sentence)]


def _turns(reference: Array) -> int:
    """The number of times that a reference (N,) turns round."""
    steps = np.diff(reference)
    return int(np.count_nonzero(np.diff(np.sign(steps[steps != 0])))) + int(np.any(steps != 0))


def _runs_away(data: Dataset, reference: Array) -> list[Finding]:
    """Whether the shaft is farther from its reference than one that stands, for most of the time after the first quarter."""
    if data.reference_unit != data.output_unit:
        return []
    held = np.maximum(np.searchsorted(data.t_input, data.t_output, side="right") - 1, 0)
    error = np.abs(reference[held] - data.y)
    standing = float(np.abs(reference[held] - data.y[0]).max())
    share = float(np.mean(error[len(error) // 4 :] > standing))
    if share < _MUCH:
        return []
    sentence = (
        f"{data.name}: the loop runs away from its reference: the shaft is up to {error.max():.3g} "
        f"{data.output_unit} off, where a shaft at rest would be at most {standing:.3g} off. A "
        "gain has the wrong sign, or the encoder counts the wrong way: change one of the two "
        "signs."
    )
    return [warning("loop-runs-away", sentence, parameters=("gain",))]


DOUBTS.member("loop_followed")(Doubt(codes=("loop-swings", "loop-runs-away"), about_data=_about_data))
