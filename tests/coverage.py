"""Limits for coverage and error over a number of runs: as tight as a few runs allow.

A few runs show little by counting: of 12 intervals 11 cover, give or take 2, whether they are right or far too wide. The mean
square of what estimates are off, in their own standard deviations, tells that: it is 1. Their mean is 0, unless there is a bias.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy import stats

FEW = 12
SOME = 40
RUNS = [FEW, pytest.param(200, marks=pytest.mark.long)]
"""As a parameter `runs` of a test: a few, and in `make test-long` many, of which the first SOME are checked by themselves too.

Where one process runs both, as in `make test-all`, the few are the first ones of the many: what comes of a seed is kept
(`functools.cache`), and not worked out twice.
"""


def fewest_and_most(runs: int) -> tuple[float, float]:
    """The counts 2.6 standard deviations of a binomial below and above 95 %, beyond which lies 1 case in 100."""
    off = 2.6 * np.sqrt(0.95 * 0.05 * runs)
    return 0.95 * runs - off, 0.95 * runs + off


def mean_square_bounds(runs: int) -> tuple[float, float]:
    """Between which the mean square of so many standard normal numbers is, in 99 cases of 100 (χ²)."""
    low, high = stats.chi2.ppf([0.005, 0.995], runs) / runs
    return float(low), float(high)


def check_counts(name: str, covers: Sequence[bool]) -> None:
    """Fail where too few or too many intervals cover, of all runs and of the first SOME."""
    for each in (covers[:SOME], covers):
        fewest, most = fewest_and_most(len(each))
        assert fewest <= sum(each) <= most, (name, len(each), sum(each))


def off(interval: tuple[float, float], truth: float) -> float:
    """The distance of the middle of an interval of 95 % from the truth, in the standard deviations that it states."""
    low, high = interval
    return ((low + high) / 2 - truth) / ((high - low) / (2 * 1.96))


def check_spread(name: str, offs: Sequence[float]) -> None:
    """Fail where estimates of a few runs, or of the first SOME of many, scatter more or less than their intervals say."""
    offs = offs[:SOME]
    low, high = mean_square_bounds(len(offs))
    assert low <= np.mean(np.square(offs)) <= high, (name, np.mean(np.square(offs)))


def check_bias(name: str, offs: Sequence[float]) -> None:
    """Fail where those estimates lie to one side of the truth, by 2.6 standard deviations of their mean."""
    offs = offs[:SOME]
    assert abs(np.mean(offs)) <= 2.6 / np.sqrt(len(offs)), (name, np.mean(offs))
