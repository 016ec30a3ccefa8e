"""A response with one more pole than a motor has: something swings, or lags behind the shaft."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.identification.trust.doubts.chain_unknown import is_unknown
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import may_be_any_shape, rings

_STRUCTURE = "rational_2_0_integrator_delay"
_SWINGS = 0.5  # of critical damping: with more a step overshoots by less than a sixth, and hardly swings
_SEEN = 0.5  # of the sample rate: nothing faster is to be seen
_PERIODS = 2  # in the longest record: what swings fewer times is anything slow


def _second_order(case: Case) -> CauseFit | None:
    """Whether the speed's second derivative makes the equation hold, and whether its poles swing."""
    if not any(rings(each.u) for each in case.motions):
        return None
    regression = case.with_columns(_bend(case))
    tau, squared = float(regression.coefficients[0]), float(regression.coefficients[5])
    if squared == 0:
        return None
    frequency = np.sqrt(abs(squared)) ** -1 / (2 * np.pi)
    if case.plain.misfit > 0 and may_be_any_shape(case.motions, regression.misfit / case.plain.misfit):
        return None
    longest = max(each.t[-1] - each.t[0] for each in case.motions)
    if squared > 0 and frequency * min(each.data.sample_time for each in case.motions) > _SEEN:
        return None
    swings = squared > 0 and tau**2 < 4 * _SWINGS**2 * squared and frequency * longest > _PERIODS
    how = f"oscillates at about {frequency:.2g} Hz" if swings else "has a second pole"
    acting = "a pendulum, a spring, a compliant shaft or a feedback controller"
    if not swings and any(is_unknown(each.data) for each in case.motions):
        acting = f"a filter of the sensor, {acting}"
    sentence = (
        f"The output {how}, which a first-order motor doesn't: {acting} acts on it. Use `structure={_STRUCTURE}`, or record the "
        "motor alone."
    )
    code = "response-oscillates" if swings else "second-pole"
    return CauseFit(
        finding=warning(code, sentence, parameters=("gain", "time_constant")),
        structural=True,
        misfit=regression.misfit,
        chosen=3,
        structure=_STRUCTURE,
    )


def _bend(case: Case) -> list[Array]:
    """Minus the speed's second derivative (R,) of each record, filtered as the equation is."""
    orders = [3 if each.data.kind == "position" else 2 for each in case.motions]
    return [-each.filter(each.y, order) for each, order in zip(case.motions, orders, strict=True)]


EXPLANATIONS.member("second_order")(_second_order)
