"""Do the intervals cover? Against a motor marched in steps of 5 µs, which shares no line with the twin or the models.

The truth is that of the linear motor: gain k/(R b + k²), time constant of its slow eigenvalue, the fast one's as delay.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Literal

import numpy as np
import pytest

from servobench.core.estimate import Estimate
from servobench.identification.identify import identify
from tests import coverage
from tests.datasets import dataset
from tests.rig.motor.reference import Truth


def drawn(seed: int) -> Truth:
    """The default motor with inertia and motor constant drawn within ±5 %."""
    j, k = 1 + 0.05 * (2 * np.random.default_rng([seed, 1]).random(2) - 1)
    return Truth(inertia=Truth().inertia * j, motor_constant=Truth().motor_constant * k)


def answers(truth: Truth) -> dict[str, float]:
    """The true values, from the roots of the characteristic polynomial."""
    r, l, k, j, b, tc = truth
    slow, fast = sorted(-1 / np.roots([j * l, j * r + l * b, r * b + k * k]).real, reverse=True)
    return {"gain": k / (r * b + k * k), "time_constant": slow, "delay": fast, "coulomb_voltage": tc * r / k}


@pytest.mark.parametrize("kind", ["square", "prbs"])
def test_the_default_motor_is_hit_within_3_3_standard_deviations(kind: Literal["square", "prbs"]) -> None:
    fit = identify(dataset(seed=1, kind=kind)).fit
    assert fit is not None
    for name, truth in answers(Truth()).items():
        assert abs(fit[name].value - truth) < 3.3 * fit[name].sd, name


@cache
def estimates(seed: int, kind: Literal["square", "prbs"], hold: int = 50) -> Mapping[str, Estimate]:
    """What is found of the motor that was drawn with that seed."""
    fit = identify(dataset(seed=seed, kind=kind, truth=drawn(seed), hold=hold)).fit
    assert fit is not None
    return fit.estimates


@pytest.mark.parametrize("runs", coverage.RUNS)
@pytest.mark.parametrize("kind", ["square", "prbs"])
def test_95_percent_intervals_cover(kind: Literal["square", "prbs"], runs: int) -> None:
    """The winding isn't quite a delay: with a PRBS the time constant is 0.4 standard deviations long in the mean of 120 runs.

    Coverage allows for that, so no bias is looked for.
    """
    offs: dict[str, list[float]] = {"gain": [], "time_constant": []}
    covers: dict[str, list[bool]] = {"gain": [], "time_constant": []}
    for seed in range(runs):
        truth, found = answers(drawn(seed)), estimates(seed, kind)
        for name in covers:
            low, high = found[name].interval
            covers[name].append(low <= truth[name] <= high)
            offs[name].append(coverage.off((low, high), truth[name]))
    for name, each in covers.items():
        coverage.check_counts(name, each)
        coverage.check_spread(name, offs[name])


def test_the_papers_filter_in_the_chain_does_not_bias_the_time_constant() -> None:
    """The differentiated, low-passed speed: fitted through its chain it hits; as if it were the speed itself, τ is 28 % high."""
    known = identify(dataset(seed=3, chain="derivative | lowpass 50 rad/s")).fit
    assert known is not None
    tau = answers(Truth())["time_constant"]
    assert abs(known["time_constant"].value - tau) < 4 * known["time_constant"].sd
    assert known["time_constant"].value == pytest.approx(tau, rel=0.01)


def test_two_records_are_fitted_jointly_and_better_than_each_alone() -> None:
    """Two records of the same length halve the variance that each has on the average: 0.71 of its root, here below 0.8.

    One alone may be as good as both: how well its rounding averages out is a matter of where its path lies among the counts.
    """
    records = [dataset(seed=seed, kind="prbs", samples=2500) for seed in (1, 2)]
    joint = identify(records).fit
    assert joint is not None
    alone = [identify(record).fit for record in records]
    for name in ("gain", "time_constant"):
        each = [fit[name].sd for fit in alone if fit]
        assert joint[name].sd < 0.8 * np.sqrt(np.mean(np.square(each)))
        assert abs(joint[name].value - answers(Truth())[name]) < 3.3 * joint[name].sd


def test_an_irregularly_sampled_record_is_hit_too() -> None:
    """Every third sample left out, at random: the times are what they are, nothing is resampled."""
    from dataclasses import replace

    data = dataset(seed=5, kind="prbs")
    keep = np.random.default_rng(5).random(len(data.y)) > 1 / 3
    fit = identify(replace(data, t_output=data.t_output[keep], y=data.y[keep])).fit
    assert fit is not None
    for name, truth in answers(Truth()).items():
        assert abs(fit[name].value - truth) < 3.3 * fit[name].sd, name


@pytest.mark.parametrize("runs", [20, pytest.param(100, marks=pytest.mark.long)])
def test_reversals_right_after_a_switch_are_allowed_for(runs: int) -> None:
    """With a bit of 40 ms, 4 out of 5 runs have a reversal within the winding's transient, which the model can't resolve.

    Without the allowance for it the intervals cover 85 % and miss by up to 15 standard deviations. The allowance bounds an
    error, so the intervals may cover more than 95 %, but none may be far off.
    """
    covered, worst = 0, 0.0
    for seed in range(runs):
        truth, found = answers(drawn(seed))["gain"], estimates(seed, "prbs", hold=20)["gain"]
        covered += found.interval[0] <= truth <= found.interval[1]
        worst = max(worst, abs(found.value - truth) / found.sd)
    assert covered >= 0.91 * runs
    assert worst < 4.5  # 1 run in 150,000 of a normal distribution
