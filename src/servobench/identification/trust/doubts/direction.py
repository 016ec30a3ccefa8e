"""Two speeds under one level, one when the input came from below and one when it came from above: hysteresis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.identification.estimators.base import Fit, as_predicted
from servobench.identification.models.steady import SteadySpeed, steady_speeds
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_FEWEST = 3  # levels that were reached from both sides: one or two may differ by chance
_ALIKE = 0.02  # of the largest level: what two levels that are meant to be one may differ by
_MOVES = 0.05  # of the largest speed: below it friction may hold the shaft on the way up only
_MUCH = 0.02  # of the largest speed: a smaller mean difference is no hysteresis worth the name
_DRIFT = 0.5  # of the difference: what a steady drift may explain of it, with two of its standard deviations


@dataclass(frozen=True, kw_only=True)
class _Pair:
    """The speeds that a motor settled at under one level, without their signs, once from below and once from above.

    `of_model` is how much more the model has from above at those times: it hasn't quite settled, and of levels that are nearly
    alike one may be larger.
    """

    from_below: SteadySpeed
    from_above: SteadySpeed
    of_model: float = 0.0

    @property
    def difference(self) -> float:
        return abs(self.from_above.speed) - abs(self.from_below.speed) - self.of_model

    @property
    def later(self) -> float:
        """The time [s] from the visit from below to the one from above."""
        return self.from_above.time - self.from_below.time


def _about(fit: Fit) -> list[Finding]:
    if "gain" not in fit.model.names:
        return []
    findings: list[Finding] = []
    for record in fit.records:
        visits = steady_speeds(record.data)
        for sense in (1.0, -1.0):
            pairs = _pairs(visits, sense)
            if _of(record.data, visits, pairs):
                findings += _of(record.data, visits, _beside_model(pairs, replace(fit, records=(record,))))
    return findings


def _beside_model(pairs: Sequence[_Pair], fit: Fit) -> list[_Pair]:
    """The pairs of a fit's only record with what its model has of each difference.

    Where the model hasn't settled there is nothing to take off: it is slow in place of a play.
    """
    (predicted,) = as_predicted(fit).records
    of_model = {visit.time: visit for visit in steady_speeds(predicted.data)}
    beside = []
    for pair in pairs:
        below, above = (of_model.get(visit.time) for visit in (pair.from_below, pair.from_above))
        if below is not None and above is not None:
            pair = replace(pair, of_model=_Pair(from_below=below, from_above=above).difference)
        beside.append(pair)
    return beside


def _of(data: Dataset, visits: Sequence[SteadySpeed], pairs: Sequence[_Pair]) -> list[Finding]:
    """Whether each level of one sign has a speed of its own for either direction, beyond what a drift explains."""
    # Ascending, and some of them more than once.
    levels = np.array([abs(pair.from_below.level) for pair in pairs])
    count = np.count_nonzero(np.diff(levels, prepend=0.0) > _ALIKE * levels.max(initial=0.0))
    if count < _FEWEST:
        return []
    largest = max(abs(visit.speed) for visit in visits)
    mean = float(np.mean([pair.difference for pair in pairs]))
    if min(pair.difference for pair in pairs) <= 0.0 or mean < _MUCH * largest or _may_drift(pairs, mean):
        return []
    most = max(pairs, key=lambda pair: pair.difference)
    unit = f"{data.position_unit}/s"
    low, high = (with_unit(visit.speed, unit, 3) for visit in (most.from_below, most.from_above))
    level = with_unit(most.from_below.level, data.input_unit, 3)
    sentence = (
        f"{data.name}: at {level} the motor settles at {low} after a smaller input, but at {high} after a larger one, and so at "
        f"each of {count} levels. That is hysteresis, as of a valve or of play before the motor, which no transfer function "
        "has: identify the way up and the way down separately, and compare."
    )
    return [warning("speed-by-direction", sentence, parameters=("gain",))]


def _pairs(visits: Sequence[SteadySpeed], sense: float) -> list[_Pair]:
    """The levels of one sign, ascending, that the input reached from below and from above, and the speeds that came of it."""
    least = _MOVES * max((abs(visit.speed) for visit in visits), default=0.0)
    alike = _ALIKE * max((abs(visit.level) for visit in visits), default=0.0)
    sides: dict[float, list[SteadySpeed]] = {1.0: [], -1.0: []}
    for side, visit in _sides(visits, alike):
        if sense * visit.level > 0.0 and abs(visit.speed) > least:
            sides[sense * side].append(visit)
    pairs = []
    for below in sorted(sides[1.0], key=lambda visit: sense * visit.level):
        near = min(sides[-1.0], key=lambda visit: abs(visit.level - below.level), default=below)
        if near is not below and abs(near.level - below.level) <= alike:
            pairs.append(_Pair(from_below=below, from_above=near))
    return pairs


def _sides(visits: Sequence[SteadySpeed], alike: float) -> list[tuple[float, SteadySpeed]]:
    """The last visit to each level, and whether the input rose (1) or fell (-1) to it; levels that are `alike` are one."""
    sides: list[tuple[float, SteadySpeed]] = []
    for n, visit in enumerate(visits):
        again = n > 0 and abs(visit.level - visits[n - 1].level) <= alike
        if again and sides and abs(visit.level - visit.level_before) <= alike:
            sides[-1] = sides[-1][0], visit
            continue
        step = visit.level - visit.level_before
        if abs(step) <= alike and n > 0:  # a measured input may take a sample or two to its level
            step = visit.level - visits[n - 1].level
        if step != 0.0:
            sides.append((float(np.sign(step)), visit))
    return sides


def _may_drift(pairs: Sequence[_Pair], mean: float) -> bool:
    """Whether a motor that warms up, or a supply that sags, may explain the mean difference: it goes on within each level.

    Speeds that are still on their way, up after a rise and down after a fall, scatter the rates so much that they may, too.
    """
    visits = [visit for pair in pairs for visit in (pair.from_below, pair.from_above)]
    rates = np.array([np.sign(visit.speed) * visit.drift for visit in visits])
    rate, sd = float(np.mean(rates)), float(np.std(rates, ddof=1) / np.sqrt(len(rates)))
    later = float(np.mean([pair.later for pair in pairs]))
    return rate * later + 2.0 * sd * abs(later) > _DRIFT * mean


DOUBTS.member("direction")(Doubt(codes=("speed-by-direction",), about_fit=_about))
