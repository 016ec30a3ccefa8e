"""An input without any effect on the output."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import refusal
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import regression
from servobench.identification.trust.explanations.resonance import resonance_columns

_SHARE = 0.9  # of what the equation leaves over without any input is still left over with it
_SIMULATED = 90.0  # percent: an output that follows from the input so far has to do with it


def _explain_unrelated(case: Case) -> CauseFit | None:
    """Whether the equation holds nearly as well without the input; then no other cause need be examined."""
    if case.simulated > _SIMULATED or _swings_with_it(case):
        return None
    columns, speed = case.base
    without = regression(columns[:, [0, 3, 4]], speed)
    if without.misfit == 0:  # a shaft that stands still follows anything
        return None
    if case.plain.misfit < _SHARE * without.misfit or case.plain.misfit < 0.02 * case.plain.total:
        return None
    name = case.motions[0].data.name
    sentence = (
        f"{name}: the output doesn't follow this input, which explains "
        f"{100 * (1 - np.sqrt(case.plain.misfit / without.misfit)):.0f} % of its motion. The "
        "column may be the wrong one, or belong to another motor or recording. Name the voltage "
        "of this motor with `input=COL:UNIT`; if the file has none, the input wasn't recorded."
    )
    return CauseFit(finding=refusal("input-unrelated", sentence), misfit=0.25 * case.plain.misfit, chosen=1)


def _swings_with_it(case: Case) -> bool:
    """Whether the input tells much of an output that may swing, by the equation of two masses.

    Of a shaft that swings, the swing is nearly all that the first-order equation leaves over, and hides the input.
    """
    columns, speed = (
        np.concatenate(each) for each in zip(*map(resonance_columns, case.motions), strict=True)
    )
    without = regression(columns[:, [0, 3, 4, 5, 6]], speed)
    return regression(columns, speed).misfit < _SHARE * without.misfit


EXPLANATIONS.member("unrelated")(_explain_unrelated)
