"""One level of the input that acts like another one: a wrong label, a supply that couldn't keep up, or a bent characteristic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from servobench.core.finding import warning
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.cause import CauseFit

_MOST_LEVELS = 16
_FEWEST = 4  # with fewer levels, one that is off is only another gain or offset
_SAME = 0.2  # of a level: as near as one with the wrong sign comes to its size
_LEAST = 0.02  # of a level: motors differ by that from day to day, and no label is wrong by so little
_STANDS = 0.02  # of the top speed
_SHARE = 0.02  # of the samples at a level that counts


def _level(case: Case) -> CauseFit | None:
    """The level that, let free, makes the equation hold best, and what it really seems to be."""
    inputs = np.concatenate([each.u for each in case.motions])
    levels, counts = np.unique(inputs, return_counts=True)
    if not _FEWEST <= len(levels) <= _MOST_LEVELS:
        return None
    tried = []
    speeds = [np.abs(np.interp(each.t, each.data.t_output, smooth_speed(each.data))) for each in case.motions]
    speed = np.concatenate(speeds)
    least = _STANDS * float(np.percentile(speed, 99))
    for level in levels[(counts > _SHARE * len(inputs)) & (levels != 0)]:
        if float(np.median(speed[inputs == level])) < least:
            continue  # friction holds the shaft, as at none
        extra = [each.filter_through_chain(np.where(each.u == level, 1.0, 0.0)) for each in case.motions]
        tried.append((case.with_columns(extra), float(level)))
    if not tried:
        return None
    best_regression, level = min(tried, key=lambda each: each[0].misfit)
    really = level + best_regression.coefficients[-1] / (best_regression.coefficients[1] or 1.0)
    if really * level < 0.0 and abs(really + level) > _SAME * abs(level):
        return None  # no supply turns a level round, and of a wrong sign the size is right
    if abs(really - level) < _LEAST * abs(level):
        return None
    unit = case.motions[0].data.input_unit
    alike = np.abs(levels[levels * level > 0.0])
    at_an_end = abs(level) == alike.min() or (abs(level) == alike.max() and abs(really) < abs(level))
    may_bend = len(alike) < _FEWEST or at_an_end
    why = (
        "its label is wrong, the supply couldn't hold it, or the motor's characteristic bends there. Correct it, or identify "
        "each range of the input by itself."
        if may_bend
        else "its label is wrong, or the supply couldn't hold it. Correct it, or leave it out."
    )
    sentence = f"The level recorded as {level:g} {unit} acts like {really:.3g} {unit}, compared with the other levels: {why}"
    return CauseFit(
        finding=warning("level-disagrees", sentence, parameters=("gain",)),
        misfit=best_regression.misfit,
        chosen=2,
        remedy=lambda data: replace(data, u=np.where(data.u == level, really, data.u), reference=None),
    )


EXPLANATIONS.member("level")(_level)
