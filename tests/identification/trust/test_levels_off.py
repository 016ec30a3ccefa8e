"""The finding that the speed grows by less than the input: what friction, a dead zone or a fan makes of speeds isn't that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.finding import Finding, Verdict
from servobench.identification.identify import identify
from servobench.identification.trust.doubts.base import about_fit
from servobench.identification.trust.doubts.levels_off import _in_one_sense
from servobench.recordings.measurement.dataset import Dataset
from tests.contracts.finding_examples.base import fitted
from tests.datasets import dataset
from tests.rig.motor.reference import Truth, march

LEVELS = np.arange(1.0, 9.0)  # V
STEP, TAU = 0.01, 0.08  # s


def speeds(levels: NDArray[np.float64], settled: NDArray[np.float64], name: str = "run") -> Dataset:
    """A speed [rad/s] that goes as a first order to what is settled at each level of the input [V], a second each."""
    u, ends = np.repeat(levels, 100), np.repeat(settled, 100)
    y, decay = np.zeros(len(u)), np.exp(-STEP / TAU)
    for k in range(1, len(u)):
        y[k] = ends[k - 1] + decay * (y[k - 1] - ends[k - 1])
    noise = 0.05 * np.random.default_rng(1).standard_normal(len(u))
    data = dataset(seed=1, samples=len(u), sample_time=STEP, u=u, y=y + noise, chain="derivative")
    return replace(data, name=name)


def sentences(findings: Sequence[Finding]) -> list[str]:
    return [each.sentence for each in findings if each.code == "speed-levels-off"]


def test_a_bend_between_a_dead_zone_and_the_highest_level_names_the_level_where_it_is() -> None:
    """Up to 2 V it stands, up to 4 V it gains 10 rad/(s·V), beyond 2: the line through the ends shows no drive at 0 V."""
    settled = np.interp(LEVELS, [0.0, 1.9, 3.9, 8.0], [0.0, 0.0, 20.0, 28.2])

    (sentence,) = sentences(about_fit(fitted(speeds(LEVELS, settled), "first_order_one_way_rest")))

    assert "at 4\u00a0V" in sentence
    assert "at 8\u00a0V" in sentence


@pytest.mark.parametrize(
    "settled",
    [
        pytest.param(5.0 * np.maximum(LEVELS - 1.5, 0.0), id="friction"),
        # u = a ω + b ω², with as much of the one as of the other at 8 V
        pytest.param(20.0 * (np.sqrt(1.0 + LEVELS) - 1.0), id="a fan"),
    ],
)
def test_neither_friction_nor_a_fan_is_that(settled: NDArray[np.float64]) -> None:
    assert not sentences(about_fit(fitted(speeds(LEVELS, settled), "first_order_one_way")))


def ramp(settled: NDArray[np.float64]) -> Dataset:
    """A ramp from -8 to 8 V in rows a second apart, each at the speed that the motor settles at."""
    u = np.linspace(-8.0, 8.0, 103)
    y = np.sign(u) * np.interp(np.abs(u), [0.0, *LEVELS], [0.0, *settled])
    noise = 0.2 * np.random.default_rng(1).standard_normal(len(u))
    return dataset(seed=1, samples=len(u), sample_time=1.0, u=u, y=y + noise, chain="derivative")


def test_a_ramp_through_a_bend_shows_it_too() -> None:
    settled = np.interp(LEVELS, [0.0, 1.9, 3.9, 8.0], [0.0, 0.0, 20.0, 24.0])

    assert sentences(about_fit(fitted(ramp(settled), "first_order")))


@pytest.mark.parametrize("lost", [0.0, 2.0])
def test_a_ramp_of_a_motor_with_friction_is_straight_where_it_turns(lost: float) -> None:
    assert not sentences(about_fit(fitted(ramp(5.0 * np.maximum(LEVELS - lost, 0.0)), "first_order")))


def test_steps_from_rest_that_a_single_gain_can_t_have_are_doubtful_and_not_refused() -> None:
    """From rest, friction can't be negative: a model that keeps to that explains less than half."""
    levels = np.array([3.0, 5.0, 7.0, 9.0])
    steps = [
        speeds(np.array([level]), np.array([40.0 + 4.0 * level]), name=f"{level:g} V") for level in levels
    ]

    result = identify(steps, starts_at_rest=True)

    assert result.verdict is Verdict.DOUBTFUL
    assert sentences(result.findings)
    assert "offset-negative" not in {each.code for each in result.findings}
    assert result.fit is not None
    assert result.fit.fit_percent > 80.0


def test_a_motor_that_warms_up_on_a_short_staircase_has_no_bend() -> None:
    """From 8 to 10.6 V a gain that falls by 13 % makes a line that begins far above zero; nothing depends on the input."""
    levels = np.array([8.0, 9.3, 10.6])
    settled = 20.0 * (levels - 0.2) * np.array([1.0, 0.935, 0.87])

    assert not sentences(about_fit(fitted(speeds(levels, settled), "first_order_one_way")))


def test_a_position_shows_a_bend_as_its_speed_does() -> None:
    """A model that explains nearly all of a position may explain far less of the speeds."""
    data = speeds(LEVELS, np.interp(LEVELS, [0.0, 1.0, 4.0, 8.0], [0.0, 6.0, 18.0, 21.0]))
    position = np.cumsum(data.y) * STEP
    travel = dataset(seed=1, samples=len(position), sample_time=STEP, u=data.u, y=position)

    fit = fitted(travel, "first_order_one_way")

    assert fit.fit_percent > 95.0
    assert sentences(about_fit(fit))


def test_a_speed_against_the_others_is_none_that_settled() -> None:
    """Five rows under each input, and a motor that hasn't turned round by then."""
    assert not _in_one_sense({-2.0: 1.9, -0.4: 0.8, 2.0: 20.0, 4.0: 41.0}, -1.0, 41.0)
    assert _in_one_sense({-2.0: -19.0, -0.4: -0.8, 2.0: 20.0}, -1.0, 20.0) == [(2.0, 19.0)]


def test_a_shaft_that_a_loop_brings_to_rest_has_settled_nowhere() -> None:
    """It creeps, slower under more of an input that falls: its largest speed was that of the slew before."""
    assert not _in_one_sense({-0.235: -0.153, -0.329: -0.123, 5.0: 12.0}, -1.0, 12.0)


def test_the_steps_of_a_coarse_encoder_bend_no_ramp() -> None:
    """24 steps to a turn, on a ramp from rest through friction: the position is explained, its differences are not."""
    u = np.linspace(0.0, 6.0, 3000)
    angle = march(Truth(coulomb_torque=8e-3), u, 0.002)[:, 2]
    step = 2 * np.pi / 24
    data = replace(dataset(seed=1, samples=len(u), u=u, y=np.floor(angle / step) * step), quantum=step)

    assert not sentences(about_fit(fitted(data, "first_order_one_way_rest")))
