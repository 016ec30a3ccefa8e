"""A torque that depends on the angle: a weight on the shaft, or a spring."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import warning
from servobench.identification.models.motion import turns_between_rows, turns_both_ways
from servobench.identification.models.nonlinear.structure import SINE
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import with_extra
from servobench.recordings.measurement.dataset import Dataset

_LEAST = 0.02  # of the largest input: a smaller torque is cogging, or a belt that runs out of true
_TURNED = 0.2  # rad: over a smaller angle a weight pulls evenly, as an offset does
_HALF_TURN = np.pi  # rad: on a shorter way in one direction whatever changes steadily looks like a weight


def _weight(case: Case) -> CauseFit | None:
    """Whether sin θ and cos θ, the torque of a weight, make the equation hold."""
    if any(each.data.kind != "position" or each.data.position_unit != "rad" for each in case.motions):
        return None
    if turns_between_rows([each.data for each in case.motions]):
        return None
    sine = [each.filter_through_chain(np.sin(each.y + each.data.y[0])) for each in case.motions]
    cosine = [each.filter_through_chain(np.cos(each.y + each.data.y[0])) for each in case.motions]
    regression = case.with_columns(sine, cosine)
    travel = max(float(np.ptp(each.y)) for each in case.motions)
    if travel < _HALF_TURN and not turns_both_ways([each.data for each in case.motions]):
        return None
    size = float(np.hypot(*regression.coefficients[5:7])) / abs(regression.coefficients[1] or 1.0)
    unit = case.motions[0].data.input_unit
    largest = max(float(np.abs(each.u).max()) for each in case.motions)
    if size < _LEAST * largest or travel < _TURNED:
        return None
    # Of a torque beyond all that the motor had, only a small part was seen, so its size is unknown.
    size_is_known = size <= largest
    how_large = f", as large as {size:.2g} {unit} of input" if size_is_known else ""
    sentence = (
        f"A torque varies with the shaft's angle, once per turn{how_large}: a weight hangs on the "
        "shaft (a pendulum, an arm). A first-order motor is the wrong structure; use one with "
        "gravity, or remove the weight."
    )
    return CauseFit(
        finding=warning("response-oscillates", sentence, parameters=("gain", "time_constant", SINE.name)),
        structural=True,
        misfit=regression.misfit,
        chosen=2,
        remedy=lambda data: _unload(data, *(regression.coefficients[5:7] / regression.coefficients[1])),
    )


def _unload(data: Dataset, sine: float, cosine: float) -> Dataset:
    """A record whose input has what the weight adds."""
    pull = sine * np.sin(data.y) + cosine * np.cos(data.y)
    return with_extra(data, lambda t, u: np.interp(t, data.t_output, pull))


EXPLANATIONS.member("weight")(_weight)
