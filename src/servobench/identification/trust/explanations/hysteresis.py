"""An input that only acts after it has reversed by some width: play in a valve or a gear before the motor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import sweep_count

_SWEPT = 3.0  # times through its range: a play shows where the input turns round, more than once
_WIDTHS = (0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4)


def _hysteresis(case: Case) -> CauseFit | None:
    """The best half width of a play that the input goes through."""
    if max(sweep_count(each.u) for each in case.motions) < _SWEPT:
        return None
    largest = max(float(np.abs(each.u).max()) for each in case.motions)
    # A play that the input passes once only is a constant with another value: nothing is seen of it.
    widths = [
        width
        for width in (part * largest for part in _WIDTHS)
        if max(sweep_count(play(each.u, width)) for each in case.motions) >= _SWEPT - 1
    ]
    tried = [
        (case.with_input(lambda m, width=width: play(m.u, width)), width)  # type: ignore[misc]
        for width in widths
    ]
    if not tried:
        return None
    best_regression, width = min(tried, key=lambda each: each[0].misfit)
    unit = case.motions[0].data.input_unit
    sentence = (
        f"The effective input lags by about {width:.2g} {unit} whenever the input reverses "
        "(hysteresis, as in a valve or play before the motor): the same input has two effects, "
        "depending on its direction. A linear model is the wrong structure."
    )
    return CauseFit(
        finding=warning("hysteresis", sentence, parameters=("gain", "time_constant")),
        misfit=best_regression.misfit,
        chosen=1,
        remedy=lambda data: replace(data, u=play(data.u, width), reference=None),
    )


def play(u: Array, width: float) -> Array:
    """Return u (N,) behind a play of `width` on either side, in the unit of u, from its first value on."""
    from servobench.identification.models.play import behind_play

    return behind_play(u, width, u[0])


EXPLANATIONS.member("hysteresis")(_hysteresis)
