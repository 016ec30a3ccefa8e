"""A speed that grows by less than the input does: friction makes the opposite of that."""

from __future__ import annotations

from collections.abc import Sequence

from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit
from servobench.identification.models.steady import SteadySpeed, steady_speeds
from servobench.identification.trust.doubts.base import DOUBTS, Doubt

_APART = 1.3  # times a level has to be the lowest one, to say how the speed grows
_MUCH = 0.25  # of the highest level: a straight line through the speeds that drives without any input by more isn't friction
_ONE_WAY = ("first_order_one_way", "first_order_one_way_rest")  # whose Coulomb voltage says so itself


def _about(fit: Fit) -> list[Finding]:
    names = fit.model.names
    if "gain" not in names or fit.structure in _ONE_WAY:
        return []
    settled = [each for record in fit.records for each in steady_speeds(record.data)]
    offset = float(fit.model["offset_voltage"]) if "offset_voltage" in names else 0.0
    for sense in (1.0, -1.0):
        levels = [each for each in settled if each.level * sense > 0.0]
        if len(levels) > 1 and _drives_without_input(levels, sense * offset):
            return [_finding(fit, levels)]
    return []


def _drives_without_input(levels: Sequence[SteadySpeed], offset: float) -> bool:
    """Whether the line through the speeds at the lowest and the highest level lies far above zero where the input is zero.

    `offset` is what of the input is lost in this sense and regained in the other, in the unit of the input.
    """
    low, high = _ends(levels)
    if abs(high.level) < _APART * abs(low.level) or high.speed == low.speed:
        return False
    lost = abs(low.level) - low.speed / (high.speed - low.speed) * (abs(high.level) - abs(low.level))
    return lost - offset < -_MUCH * abs(high.level) and high.speed * low.speed > 0.0


def _ends(levels: Sequence[SteadySpeed]) -> tuple[SteadySpeed, SteadySpeed]:
    return min(levels, key=lambda each: abs(each.level)), max(levels, key=lambda each: abs(each.level))


def _finding(fit: Fit, levels: Sequence[SteadySpeed]) -> Finding:
    data = fit.records[0].data
    slow, fast = (
        f"{with_unit(each.speed, f'{data.position_unit}/s', 3)} at {with_unit(each.level, data.input_unit, 3)}"
        for each in _ends(levels)
    )
    sentence = (
        f"The speed grows by less than the input: the motor settles at {slow} and at {fast}. Friction would do the opposite. "
        "The driver or the load bends the characteristic, and a single gain is a mean over these levels: record the voltage at "
        "the motor, or identify each range of the input by itself."
    )
    return warning("speed-levels-off", sentence, parameters=("gain",))


DOUBTS.member("levels_off")(Doubt(codes=("speed-levels-off",), about_fit=_about))
