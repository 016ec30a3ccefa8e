"""Speeds at which a motor turns evenly contradict causes that deny its input an effect there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.identification.trust.explanations import dead_zone
from servobench.identification.trust.explanations.base import EXPLANATIONS, Case
from servobench.identification.trust.explanations.dead_zone import _turns_evenly
from servobench.identification.trust.explanations.equation import motion
from servobench.identification.trust.explanations.steady_windows import steady_windows
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import dataset

STEP, TAU, GAIN = 0.01, 0.03, 13.0  # s, s, rad/(s·V)


def driven(u: NDArray[np.float64], acting: NDArray[np.float64]) -> Dataset:
    """The speed of a motor under an input that `acting` is what becomes of."""
    speed, speeds = 0.0, []
    for voltage in acting:
        speeds.append(speed)
        speed += (1.0 - np.exp(-STEP / TAU)) * (GAIN * voltage - speed)
    plain = dataset(seed=1, samples=len(u), sample_time=STEP, u=u, y=np.array(speeds))
    return replace(plain, kind="speed", output_unit="rad/s", quantum=None)


def test_windows_are_those_of_an_even_speed_under_inputs_of_one_sign() -> None:
    u = np.repeat([0.0, 4.0, 8.0, -4.0], 100)
    (found,) = [motion(driven(u, u))]
    assert found is not None
    speeds, least, largest = steady_windows([found], TAU).T

    even = (least == largest) & (least > 0.0)
    np.testing.assert_allclose(speeds[even], GAIN * largest[even], rtol=0.04)
    assert {4.0, 8.0} == set(largest[even].tolist())
    assert not len(steady_windows([found], np.nan))


@pytest.mark.parametrize(("width", "goes_on"), [(3.0, False), (6.0, True), (10.0, True)])
def test_inputs_under_which_the_motor_goes_on_turning_are_in_no_dead_zone(
    width: float, goes_on: bool
) -> None:
    """A noisy loop that holds about 4.4 V and 19 V by turns: at 4.4 V the motor would stop in 0.1 s if that didn't act."""
    u = np.repeat([4.4, 19.0, 4.4, 19.0], 60) + np.random.default_rng(2).normal(scale=0.4, size=240)
    (found,) = [motion(driven(u, u))]
    assert found is not None

    assert _turns_evenly([found], width, TAU) is goes_on


def test_a_motor_that_coasts_through_a_dead_zone_doesnt_go_on() -> None:
    u = np.repeat([4.4, 19.0, 4.4, 19.0], 60)
    (found,) = [motion(driven(u, np.where(u > 8.0, u, 0.0)))]
    assert found is not None

    assert not _turns_evenly([found], 8.6, TAU)


def test_a_zone_is_not_reported_where_the_motor_goes_on_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    u = np.repeat(np.random.default_rng(1).choice([-6.0, -2.0, 1.0, 3.0, 6.0], 40), 12)
    case = Case(tuple(filter(None, [motion(driven(u, u - np.clip(u, -1.5, 1.5)))])))

    assert EXPLANATIONS["dead_zone"](case) is not None
    monkeypatch.setattr(dead_zone, "_turns_evenly", lambda *_: True)
    assert EXPLANATIONS["dead_zone"](case) is None
