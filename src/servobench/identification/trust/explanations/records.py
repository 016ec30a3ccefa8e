"""Records, or parts of one, in which the motor isn't the same."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import warning
from servobench.core.rounding import plain
from servobench.identification.models.level import single_level
from servobench.identification.models.motion import directions
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit
from servobench.identification.trust.explanations.equation import sweep_count, with_extra
from servobench.recordings.measurement.dataset import Dataset

_SWEPT = 3.0  # times through its range: fewer changes can't tell a motor that changes from one that lags
_BY_FRICTION = 1.5  # a record of one level can't tell its gain from its friction, which takes a third of the level at the most
_BENT = 3.0  # times: a gain that differs by more between two levels is no bend
_LARGER = 1.2  # times as large are inputs that lie elsewhere on the characteristic
_APART = 0.02  # of the gain: records of one motor differ by less


def _records(case: Case) -> CauseFit | None:
    """Whether the records hold to the equation with a gain each, and not with a common one."""
    if len(case.motions) < 2:
        return None
    level = single_level([each.data for each in case.motions])
    of_one = [single_level([each.data]) is not None for each in case.motions]
    if all(of_one) and not level:  # a gain for each leaves nothing that tells the friction
        return None
    columns = [
        [each.base[0][:, make] * (1.0 if n == k else 0.0) for n, each in enumerate(case.motions)]
        for k in range(1, len(case.motions))
        for make in (1, 2)
    ]
    regression = case.with_columns(*columns)
    first = regression.coefficients[1]
    if level:  # gain and friction can't be told apart; what counts is what is left of the level
        first -= regression.coefficients[3] / abs(level)
    gains = np.array([first, *(first + regression.coefficients[5::2])])
    middle = float(np.median(gains))
    if middle == 0 or float(np.abs(gains / middle - 1).max()) < _APART:
        return None
    far = int(np.argmax(np.abs(gains - middle))) if len(gains) > 2 else int(np.argmin(np.abs(gains)))
    odd, times = case.motions[far].data, float(gains[far] / np.median(np.delete(gains, far)))
    if any(of_one) and not level and not (times > 0 and abs(math.log(times)) > math.log(_BY_FRICTION)):
        return None
    bends = (
        f"The inputs of {odd.name} are the {'larger' if times < 1 else 'smaller'} ones, so the characteristic may bend. "
        "Otherwise the records"
        if _bends_instead(case, odd, times)
        else "They"
    )
    sentence = (
        f"The records disagree: {odd.name} moves as if its input were {times:.2g} times the "
        f"recorded one, compared with the others. {bends} come from different motors or gears, or one "
        "has another supply, unit or label. Fit them one by one."
    )
    return CauseFit(
        finding=warning("records-disagree", sentence, parameters=("gain",)),
        misfit=regression.misfit,
        chosen=1,
        remedy=lambda data: (
            replace(data, u=times * data.u, input_before=times * data.input_before, reference=None)
            if data is odd
            else data
        ),
    )


def _bends_instead(case: Case, odd: Dataset, times: float) -> bool:
    """Whether the odd record has inputs that are larger than all others' and act less, or smaller ones that act more."""
    if not 1.0 / _BENT < times < _BENT:
        return False
    own = max(float(np.abs(each.u).max()) for each in case.motions if each.data is odd)
    others = [float(np.abs(each.u).max()) for each in case.motions if each.data is not odd]
    return own > _LARGER * max(others) if times < 1 else _LARGER * own < min(others)


def _changes(case: Case) -> CauseFit | None:
    """Whether the gain or the friction changes steadily through the record."""
    if max(sweep_count(each.u) for each in case.motions) < _SWEPT:
        return None
    gone = [2 * (each.t - each.t[0]) / (each.t[-1] - each.t[0]) - 1 for each in case.motions]
    by_gain = [each.filter_through_chain(each.u * g) for each, g in zip(case.motions, gone, strict=True)]
    by_friction = [
        each.filter_through_chain(each.sense * g) for each, g in zip(case.motions, gone, strict=True)
    ]
    regression = case.with_columns(by_gain, by_friction)
    shares = regression.coefficients[5:7] / (regression.coefficients[1] or 1.0)
    added = (
        np.column_stack([np.concatenate(by_gain), np.concatenate(by_friction)]) @ regression.coefficients[5:]
    )
    share = 2 * np.sqrt(3 * np.sum(added**2) / case.plain.total)  # from end to end, what changes evenly
    sentence = (
        "The motor seems to respond differently at the end of the record than at the beginning, by about "
        f"{plain(100 * share, 2)} % of its speed: the supply may have sagged, the motor may have warmed up, or its friction "
        "may have changed. The parameters are a mean over the record."
    )
    return CauseFit(
        finding=warning("motor-changes", sentence, parameters=("gain", "time_constant")),
        misfit=regression.misfit,
        chosen=2,
        structural=True,
        remedy=lambda data: _undo_change(data, *shares),
    )


def _undo_change(data: Dataset, of_gain: float, of_friction: float) -> Dataset:
    """A record whose input has what the motor's change makes of it, by parts of the gain and of the input's unit at the end."""
    sense = directions(data)

    def change(t: Array, u: Array) -> Array:
        gone = 2 * (t - data.t_output[0]) / max(data.duration, 1e-300) - 1
        nearest = np.minimum(np.searchsorted(data.t_output, t), len(sense) - 1)
        return np.asarray(np.clip(gone, -1, 1) * (of_gain * u + of_friction * sense[nearest]))

    return with_extra(data, change)


EXPLANATIONS.member("records")(_records)
EXPLANATIONS.member("changes")(_changes)
