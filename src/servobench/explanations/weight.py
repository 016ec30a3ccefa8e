"""A torque that depends on the angle: a weight on the shaft, or a spring."""

from __future__ import annotations

import numpy as np

from servobench.explanations.base import EXPLANATIONS, Case, Explained
from servobench.finding import warning
from servobench.models.nonlinear.structure import SINE


def _weight(case: Case) -> Explained | None:
    """Whether sin θ and cos θ, the torque of a weight, make the equation hold."""
    if any(each.data.kind != "position" or each.data.position_unit != "rad" for each in case.motions):
        return None
    sine = [each.caused(np.sin(each.y + each.data.y[0])) for each in case.motions]
    cosine = [each.caused(np.cos(each.y + each.data.y[0])) for each in case.motions]
    found = case.with_columns(sine, cosine)
    size = float(np.hypot(*found.coefficients[5:7])) / abs(found.coefficients[1] or 1.0)
    unit = case.motions[0].data.input_unit
    # Of a torque beyond all that the motor had, only a small part was seen: nobody can say how large it is.
    seen = size <= max(float(np.abs(each.u).max()) for each in case.motions)
    how_large = f", as large as {size:.2g} {unit} of input" if seen else ""
    sentence = (
        f"A torque depends on the shaft's angle, once a turn{how_large}: a weight hangs on the "
        "shaft (a pendulum, an arm), which can swing. A first-order motor is the wrong structure; take one with gravity, or "
        "take the weight off."
    )
    return Explained(
        finding=warning("response-oscillates", sentence, parameters=("gain", "time_constant", SINE.name)),
        structural=True,
        misfit=found.misfit,
        chosen=2,
    )


EXPLANATIONS.member("weight")(_weight)
