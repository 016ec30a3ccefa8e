"""An input that is logged without its sign, as position loops on small boards do with a duty and a pin for the direction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.identification.models.motion import directions
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import Motion
from servobench.recordings.measurement.dataset import Dataset

_BOTH = 0.1  # of the samples in which the shaft turns: so many go either way


def _missing_sign(case: Case) -> CauseFit | None:
    """Whether |u| times the direction of motion makes the equation hold where u never changes its sign, and the motion does."""
    inputs = np.concatenate([each.u for each in case.motions])
    if inputs.min() < 0 < inputs.max() or not np.ptp(inputs) > 0:
        return None
    senses = np.concatenate([each.sense for each in case.motions])
    if min(np.count_nonzero(senses > 0), np.count_nonzero(senses < 0)) <= _BOTH * np.count_nonzero(senses):
        return None
    return CauseFit(
        finding=warning(
            "input-unsigned",
            "The shaft turns both ways, but the input never changes its sign, and a motor explains the data if it gets the "
            "sign of the motion: the input was recorded without its direction (a pin, another column, the sign of the error). "
            "Name the column that has it as `input=COL*SIGN:UNIT`, or record the input with its sign.",
            parameters=("gain",),
        ),
        misfit=case.with_input(_with_sign).misfit,
        chosen=1,
        remedy=_with_direction,
    )


def _with_sign(motion: Motion) -> Array:
    return np.abs(motion.u) * motion.sense


def _with_direction(data: Dataset) -> Dataset:
    """A record whose input acts in the direction of the motion."""
    at = np.minimum(np.searchsorted(data.t_output, data.t_input), len(data.y) - 1)
    return replace(data, u=np.abs(data.u) * directions(data)[at], reference=None)


EXPLANATIONS.member("unsigned")(_missing_sign)
