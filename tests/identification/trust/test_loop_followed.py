"""A loop that swings between its limits or runs away is told, one that follows isn't; on the twin, in virtual time."""

from __future__ import annotations

import pytest

from servobench.identification.trust.doubts.loop_followed import _about_data
from servobench.recordings.measurement.measure import measure
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import Experiment
from servobench.rig.loop.run import run
from servobench.systems.control.pid import Pid
from servobench.systems.signals.square import Square


def told(kp: float, kd: float = 0.0, cutoff: float = 250.0) -> dict[str, str]:
    """The findings on a loop that follows steps from -7 to 7 rad, by code."""
    asked = Experiment(
        signal=Square(low=-7.0, high=7.0, frequency=1 / 3),
        controller=Pid(output="position", kp=kp, kd=kd, cutoff=cutoff),
        duration=3.0,
        sample_time=0.002,
    )
    with Twin() as device:
        return {finding.code: finding.sentence for finding in _about_data([measure(run(asked, device))])}


@pytest.mark.parametrize(("kp", "kd"), [(0.2, 0.0), (1.0, 0.0), (5.0, 0.0), (20.0, 0.5)])
def test_a_loop_that_follows_is_not_reported(kp: float, kd: float) -> None:
    assert told(kp, kd) == {}


def test_a_gain_far_too_high_swings() -> None:
    found = told(500.0, 0.0, 1e9)

    assert set(found) == {"loop-swings"}
    assert "±10 V" in found["loop-swings"]


@pytest.mark.parametrize(("kp", "kd"), [(-5.0, 0.0), (1.0, -1.0)])
def test_a_gain_of_the_wrong_sign_runs_away(kp: float, kd: float) -> None:
    found = told(kp, kd)

    assert set(found) == {"loop-runs-away"}
    assert "wrong sign" in found["loop-runs-away"]
