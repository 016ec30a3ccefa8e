"""Two speeds under one level, by where the input came from: hysteresis, and what only looks like it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.finding import Finding
from servobench.identification.estimators.base import Fit
from servobench.identification.trust.doubts.base import about_fit
from servobench.identification.trust.explanations.hysteresis import play
from tests.contracts.finding_examples.base import fitted
from tests.datasets import dataset

STEP = 0.01  # s
HOLD = 200  # samples
UP_AND_DOWN = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 4.0, 3.0, 2.0, 1.0, 0.0])  # V
LARGE_STEPS = np.array([0.0, 2.0, 4.0, 6.0, 8.0, 6.0, 4.0, 2.0, 0.0])  # V
DOWN_AND_UP = np.array([0.0, 5.0, 4.0, 3.0, 2.0, 1.0, 2.0, 3.0, 4.0, 5.0])  # V


def at_levels(levels: NDArray[np.float64], width: float = 0.0, tau: float = 0.1, grows: float = 0.0) -> Fit:
    """A fit of a speed [rad/s] of 10 rad/s a volt above 0.5 V of friction; `grows` is the gain's growth in a second."""
    u = np.repeat(levels, HOLD)
    acts = play(u, width)
    drive = (
        np.sign(acts) * np.maximum(np.abs(acts) - 0.5, 0.0) * 10.0 * (1.0 + grows * STEP * np.arange(len(u)))
    )
    y, decay = np.zeros(len(u)), np.exp(-STEP / tau)
    for k in range(1, len(u)):
        y[k] = drive[k - 1] + decay * (y[k - 1] - drive[k - 1])
    y += 0.05 * np.random.default_rng(1).standard_normal(len(u))
    data = dataset(seed=1, samples=len(u), sample_time=STEP, u=u, y=y, chain="derivative")
    return fitted(data, "first_order_one_way_rest")


def sentences(findings: Sequence[Finding]) -> list[str]:
    return [each.sentence for each in findings if each.code == "speed-by-direction"]


@pytest.mark.parametrize(
    "levels", [UP_AND_DOWN, -UP_AND_DOWN, DOWN_AND_UP], ids=["up", "the other way", "down"]
)
def test_play_before_the_motor_is_seen_whichever_way_the_levels_are_taken(
    levels: NDArray[np.float64],
) -> None:
    """0.15 V on either side: 0.3 V between both ways, which is 3 rad/s."""
    (sentence,) = sentences(about_fit(at_levels(levels, width=0.15)))

    assert "after a smaller input" in sentence


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({}, id="nothing"),
        # The slowest that counts as settled has 6 % of a step left, in the mean of the second half of 2 s.
        pytest.param({"tau": 0.5}, id="a slow motor"),
        pytest.param({"grows": 0.01}, id="a motor that warms up"),
        pytest.param({"grows": -0.01}, id="a supply that sags"),
    ],
)
@pytest.mark.parametrize("levels", [UP_AND_DOWN, LARGE_STEPS, DOWN_AND_UP], ids=["up", "large", "down"])
def test_neither_a_lag_nor_a_drift_is_hysteresis(
    levels: NDArray[np.float64], changes: dict[str, float]
) -> None:
    assert not sentences(about_fit(at_levels(levels, **changes)))


def test_two_levels_that_come_again_are_two() -> None:
    """Each is reached from both sides, three times."""
    to_and_fro = np.array([0.0, 2.0, 4.0, 5.0, 4.0, 2.0])
    levels = np.concatenate([to_and_fro, to_and_fro, to_and_fro, [0.0]])

    assert not sentences(about_fit(at_levels(levels, width=0.15)))


def test_levels_that_are_left_before_the_motor_has_settled_show_no_hysteresis() -> None:
    """70 ms at a time constant of 30 ms, and 142 levels of which some are nearly alike: what is left comes from either side."""
    levels, tau, quantum = np.random.default_rng(4).uniform(6.0, 24.0, 142), 0.03, 2 * np.pi / 341
    u, step = np.repeat(levels, 14), 0.005
    y, speed, angle = np.zeros(len(u)), 0.0, 0.0
    for k, volts in enumerate(u):
        y[k] = (np.floor(angle / quantum) + 0.5) * quantum
        end = 6.5 * (volts - 2.8)
        angle += end * step + (speed - end) * tau * -np.expm1(-step / tau)
        speed = end + (speed - end) * np.exp(-step / tau)
    data = replace(dataset(seed=1, samples=len(u), sample_time=step, u=u, y=y), quantum=quantum)

    assert not sentences(about_fit(fitted(data, "first_order_one_way")))
