"""Row 12: behind a saturated amplifier the loop recovers with no more overshoot than the same loop that was never saturated."""

import math
from typing import Any

import numpy as np
import pytest

import servobench as sb
from servobench.core.channels import Array
from servobench.rig.experiment import Experiment, Limits
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.signals.square import Square

COUNT = 2 * math.pi / 2048
STEP = 20.0  # rad
SAMPLE_TIME = 0.002  # s, the default
LAWS: dict[str, Any] = {
    "pid": Pid(kp=3, ki=6, kd=0.12, cutoff=300),
    "state feedback": StateFeedback(position_gain=3, speed_gain=0.12, integral_gain=6, cutoff=300),
}


def course(law: Any, limit: float) -> tuple[Array, Array]:
    """Return the angle [rad] of the twin after a step of the reference, and the voltage [V] that was put out."""
    asked = Experiment(
        signal=Square(low=0, high=STEP, frequency=0.05, start=0.01),
        duration=6,
        controller=law,
        limits=Limits(voltage=limit),
    )
    with sb.connect("twin", amplifier_limit=100.0) as motor:
        recording = sb.run(asked, motor)
    series = {each.channel.name: each.values for each in recording.series}
    return series["counts"] * COUNT, series["applied"]


@pytest.mark.promise("S5")
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_overshoot_behind_a_saturation_is_no_larger_than_without_it(law: Any) -> None:
    free, _ = course(law, 100.0)  # the reference case: 60 V are never too much
    held, applied = course(law, 2.0)

    assert (
        np.mean(np.abs(applied) == 2.0) > 0.075
    )  # it is deep in the limit: 20 rad at 2 V take 0.45 s at the least
    assert held.max() <= free.max() + COUNT
    # It is not sluggish either: what the limit leaves is 0.45 s, and then the loop needs as long as from the start.
    reached = [SAMPLE_TIME * np.flatnonzero(np.abs(each - STEP) > 0.05 * STEP)[-1] for each in (free, held)]
    assert reached[1] <= 0.45 + reached[0]


@pytest.mark.promise("S5")
@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_without_anti_windup_the_same_loop_overshoots_by_much_more(law: Any) -> None:
    free, _ = course(law, 100.0)
    wound_up, _ = course(law.model_copy(update={"tracking_time": 1e6}), 2.0)

    assert wound_up.max() - STEP > 2 * (free.max() - STEP)
