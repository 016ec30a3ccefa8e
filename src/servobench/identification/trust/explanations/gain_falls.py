"""Large inputs that act less than they should: an amplifier, a supply or a controller's limit clips what was commanded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.core.rounding import plain
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit

_KNEES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95)
_BELOW = (0.05, 0.95)  # of a limit: inputs there act in full and show by how much less those beyond it act
_SEEN = 0.01  # of the samples, at least, have such an input


def _gain_falls(case: Case) -> CauseFit | None:
    """The best limit at which the input is clipped; None where no limit would show."""
    largest = max(float(np.abs(each.u).max()) for each in case.motions)
    tried = [
        (case.with_input(lambda m, limit=limit: np.clip(m.u, -limit, limit)), limit)  # type: ignore[misc]
        for limit in (part * largest for part in _KNEES)
        if any(_shows_a_limit(each.u, limit) for each in case.motions)
    ]
    if not tried:
        return None
    best_regression, limit = min(tried, key=lambda each: each[0].misfit)
    unit = case.motions[0].data.input_unit
    sentence = (
        f"Inputs beyond about {plain(limit, 2)} {unit} have no further effect: the amplifier, the supply "
        "or the controller limits the voltage. Record the voltage that was applied, or stay below "
        "that level."
    )
    return CauseFit(
        finding=warning("gain-falls", sentence, parameters=("gain",)),
        misfit=best_regression.misfit,
        chosen=1,
        remedy=lambda data: replace(data, u=np.clip(data.u, -limit, limit), reference=None),
    )


def _shows_a_limit(u: Array, limit: float) -> bool:
    """Whether an input u (N,) is below a limit often enough: one level and its noise, clipped, is one level without noise."""
    low, high = (part * limit for part in _BELOW)
    return bool(np.mean((np.abs(u) > low) & (np.abs(u) < high)) >= _SEEN)


EXPLANATIONS.member("gain_falls")(_gain_falls)
