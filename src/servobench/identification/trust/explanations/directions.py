"""A gain of its own in each direction: an amplifier whose halves differ, or a motor whose brushes stand to one side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.core.rounding import plain
from servobench.identification.models.motion import directions
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import with_extra
from servobench.recordings.measurement.dataset import Dataset

_LARGEST = 0.5  # of the gain: by more no two directions of one motor differ, and something else is wrong

_OF_INPUTS = ("for negative inputs", "for positive ones")
_OF_MOTION = ("backward", "forward")


def _directions(case: Case) -> CauseFit | None:
    """Whether K (1 + ε s) u makes the equation hold, s the sign of the input or of the motion, whichever explains more.

    An amplifier goes by the sign of what it is told, a motor by the way in which it turns; the two differ while it brakes.
    """
    by_input = case.with_columns([each.filter_through_chain(np.abs(each.u)) for each in case.motions])
    by_motion = case.with_columns([each.filter_through_chain(each.sense * each.u) for each in case.motions])
    differing, remedy = min(
        ((by_input, _of_amplifier), (by_motion, _of_motor)), key=lambda each: each[0].misfit
    )
    share = float(differing.coefficients[-1] / (differing.coefficients[1] or 1.0))
    if not 0.0 < abs(share) < _LARGEST:
        return None
    less = 2.0 * abs(share) / (1.0 + abs(share))
    ways = _OF_INPUTS if differing is by_input else _OF_MOTION
    smaller, larger = ways if share > 0.0 else ways[::-1]
    sentence = (
        f"The gain is {plain(100 * less, 2)} % smaller {smaller} than {larger}: the amplifier's halves differ, or the motor "
        "isn't symmetric. One gain for both is their mean; identify each direction by itself."
    )
    return CauseFit(
        finding=warning("directions-differ", sentence, parameters=("gain",)),
        misfit=differing.misfit,
        chosen=1,
        structural=True,
        change=abs(share),
        remedy=lambda data: remedy(data, share),
    )


def _of_amplifier(data: Dataset, share: float) -> Dataset:
    """The record with the voltage of an amplifier that gives 1 + share of a positive input, and 1 - share of a negative one."""
    return replace(data, u=data.u + share * np.abs(data.u), reference=None)


def _of_motor(data: Dataset, share: float) -> Dataset:
    """The record of a motor that is alike in both directions, with an input that is greater by that share forward."""
    sense = directions(data)
    return with_extra(data, lambda t, u: share * u * _sense_at(t, data.t_output, sense))


def _sense_at(t: Array, at: Array, sense: Array) -> Array:
    """The sense of motion at times t (N,) [s], from those at the times `at` (M,) [s]."""
    return np.asarray(sense[np.minimum(np.searchsorted(at, t), len(at) - 1)], dtype=np.float64)


EXPLANATIONS.member("directions")(_directions)
