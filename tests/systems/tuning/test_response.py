"""The compiled step response against the law itself, stepped in Python, around a motor that is advanced there, too."""

import math
from collections import deque
from typing import Any

import numpy as np
import pytest

from servobench.core.channels import Array, Channel, DeviceInfo, Sample
from servobench.systems.control.lead import Lead
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.tuning.response import unit_step
from tests.export.conftest import DELAY, GAIN, TAU

H, TICKS, COUNT = 0.002, 300, 1e-9
INFO = DeviceInfo(
    name="motor", channels=(Channel(name="counts", unit="counts", counts_per_rev=2 * math.pi / COUNT),)
)


def course_of(controller: Any, delay: float) -> Array:
    """The output and the voltage that is wanted at each tick."""
    whole, part = divmod(delay, H)
    on_its_way = deque([0.0] * (int(whole) + 2), maxlen=int(whole) + 2)
    state, angle, speed, rows = controller.start(H, INFO), 0.0, 0.0, []
    for k in range(TICKS):
        sample = Sample(index=k, time=k * H, counts=math.floor(angle / COUNT))
        state, voltage = controller.step(state, 1.0 if k else 0.0, sample)
        rows.append((speed if controller.output == "speed" else angle, voltage))
        on_its_way.appendleft(voltage)
        for held, length in ((on_its_way[-1], part), (on_its_way[-2], H - part)):
            end, left = GAIN * held, math.exp(-length / TAU)
            angle += TAU * (1 - left) * (speed - end) + length * end
            speed = left * speed + (1 - left) * end
    return np.array(rows[1:])


@pytest.mark.parametrize("delay", [0.0, DELAY, 2 * H, 3.3 * H, 2 * TICKS * H])
@pytest.mark.parametrize(
    "controller",
    [
        Pid(kp=4.0, ki=10.0, kd=0.2, cutoff=300.0),
        Pid(kp=0.05, ki=1.0, kd=0.0005, b=0.7, c=0.5, output="speed"),
        Lead(gain=3.0, zero=10.0, pole=300.0),
        StateFeedback(position_gain=4.0, speed_gain=0.1, integral_gain=3.0),
        StateFeedback(output="speed", position_gain=0.0, speed_gain=0.1, integral_gain=3.0),
    ],
    ids=str,
)
def test_a_step_is_that_of_the_law_tick_by_tick(controller: Any, delay: float) -> None:
    response = unit_step(controller, GAIN, TAU, delay, H, TICKS)

    # The same operations, but for the last bit of an exponential. A count's rounding may then fall the other way: 1e-9 rad and
    # 5e-7 rad/s, by gains of up to 90 V/rad and 0.2 V·s/rad 1e-7 V, and less of the output. Ten of these.
    assert (
        np.abs(np.column_stack([response.output, response.voltage]) - course_of(controller, delay)).max()
        <= 1e-6
    )


def test_a_loop_that_runs_away_has_a_response_of_numbers() -> None:
    """The angle is soon beyond what 64 bits count."""
    response = unit_step(Pid(kp=1000.0, kd=10.0), GAIN, TAU, 0.1, H, 3000)

    assert np.isfinite(response.output).all()
    assert response.overshoot > 1e6
