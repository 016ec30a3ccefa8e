"""The speeds that a motor settles at under constant inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.identify import identify
from servobench.identification.models.steady import longest_time_constant, speeds_by_level, steady_speeds
from tests.datasets import dataset
from tests.rig.motor.reference import Truth

TRUTH = Truth(viscous_friction=0.0, coulomb_torque=8e-4)


@pytest.mark.parametrize("chain", ["", "derivative"])
def test_the_speed_of_each_level_is_that_of_the_equations(chain: str) -> None:
    """ω = (u - R T_c/k)/k; behind a derivative a count is 1.5 rad/s in one sample, and 50 samples average it out."""
    levels = np.array([2.0, 4.0, -3.0])
    data = dataset(seed=1, samples=1500, u=np.repeat(levels, 500), truth=TRUTH, chain=chain)
    lost = TRUTH.resistance * TRUTH.coulomb_torque / TRUTH.motor_constant

    settled = steady_speeds(data)

    assert [each.level for each in settled] == list(levels)
    expected = (levels - lost * np.sign(levels)) / TRUTH.motor_constant
    # What is left of the step in the last half second, five time constants: 7 in 1000, and a count in it.
    assert [each.speed for each in settled] == pytest.approx(list(expected), rel=0.01)


def test_a_speed_that_still_grows_has_not_settled() -> None:
    """0.1 s under each level, a time constant."""
    data = dataset(seed=1, samples=250, u=np.repeat([2.0, 4.0, 6.0, 8.0, 10.0], 50), truth=TRUTH)

    assert steady_speeds(data) == []


def test_a_speed_that_settles_bounds_the_time_constant_by_the_time_it_had() -> None:
    """A second under each level, ten time constants; records whose speed never changes say as much together."""
    data = dataset(seed=1, samples=1500, u=np.repeat([2.0, 4.0, -3.0], 500), truth=TRUTH)
    steady = [data.part(0.5 + start, 0.99 + start) for start in (0.0, 1.0)]
    steady = [replace(each, input_before=float(each.u[0])) for each in steady]

    assert 0.1 < longest_time_constant([data]) <= 1.0
    assert 0.1 < longest_time_constant(steady) <= 0.5
    assert list(speeds_by_level(steady)) == [2.0, 4.0]


@pytest.mark.parametrize("hold", [8, 50])
def test_inputs_that_leave_no_time_to_settle_bound_nothing_and_show_no_wrong_speed(hold: int) -> None:
    """A stretch may end by chance at the speed that it began with; several equal bits in a row leave time to settle."""
    both_ways = dataset(seed=1, kind="prbs", hold=hold, samples=2000, truth=TRUTH)
    one_way = dataset(seed=1, samples=2000, u=5.0 + both_ways.u, truth=TRUTH)
    gain = TRUTH.motor_constant / (TRUTH.resistance * TRUTH.viscous_friction + TRUTH.motor_constant**2)
    friction = TRUTH.resistance * TRUTH.coulomb_torque / TRUTH.motor_constant

    for data in (both_ways, one_way):
        assert longest_time_constant([data]) == np.inf
        largest = gain * float(np.abs(data.u).max())
        for level, speed in speeds_by_level([data]).items():
            # A settled speed is known to a twentieth of the largest.
            assert abs(speed - gain * (level - np.sign(level) * friction)) < 0.05 * largest


def test_a_rest_before_a_sweep_bounds_nothing() -> None:
    """The only stretch of a constant input is that before the sine begins, and the shaft rests in it."""
    t = 0.002 * np.arange(2000)
    sweep = dataset(seed=1, samples=2000, u=np.where(t < 0.1, 0.0, 3.0 * np.sin(8.0 * (t - 0.1))))

    assert longest_time_constant([sweep]) == np.inf


def test_three_records_of_one_steady_speed_each_tell_the_gain() -> None:
    """None shows how a speed changes; a motor so slow that each is as fast as it is by chance explained them, with any gain."""
    records = []
    for level in (2.0, 4.0, 6.0):
        record = dataset(seed=int(level), samples=1500, u=np.full(1500, level), truth=TRUTH).part(2.0, 3.0)
        records.append(replace(record, input_before=level))

    gain = identify(records)["gain"]

    low, high = gain.interval
    assert low < 1 / TRUTH.motor_constant < high
    assert high - low < 0.2 * gain.value


def test_a_flywheel_that_speeds_up_all_the_time_has_settled_nowhere() -> None:
    """Under a supply that rises in stairs, seven of 0.13 s, noise makes some stretches look settled: their speeds were stated."""
    t = 0.007 * np.arange(133)
    stairs = np.repeat([7.62, 8.07, 8.46, 8.81, 9.19, 9.66, 9.94], 19)
    noise = 0.12 * np.random.default_rng(1).standard_normal(len(t))
    like = dataset(seed=1, samples=len(t), sample_time=0.007, u=stairs, y=13.0 + 7.0 * t + noise)
    record = replace(like, kind="speed", output_unit="rad/s", quantum=None)

    assert steady_speeds(record)
    assert speeds_by_level([record]) == {}
