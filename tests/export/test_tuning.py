"""The margins that are left of tuned loops, against loops that are worked out one by one."""

import numpy as np
import pytest

from servobench.export import tuning
from servobench.export.first_order import first_order_motor
from servobench.export.summary import ResultSummary
from servobench.systems.sampled_loop import sampled_loop, sampled_margins
from servobench.systems.transfer_function import TransferFunction


@pytest.mark.parametrize("measurement_delay", [0.0, 0.013])
@pytest.mark.parametrize("filtered", [False, True])
def test_margins_are_those_of_each_loop_alone(
    answer: ResultSummary, monkeypatch: pytest.MonkeyPatch, filtered: bool, measurement_delay: float
) -> None:
    h, draws = 0.005, 30
    monkeypatch.setattr(tuning, "_DRAWS", draws)
    motor = first_order_motor(answer, "tune", "rad")

    gains = tuning.tune_loops(motor, h, filtered=filtered, measurement_delay=measurement_delay)

    share = tuning.smoothing(h, gains.filter)
    law = tuning._speed_law(gains.speed_gain, gains.speed_integral, h, share, 0)
    centre = (motor.gain.value, motor.time_constant.value, motor.delay)
    alone = []
    for gain, tau, delay in (centre, *motor.draws(draws).tolist()):
        late = delay + measurement_delay
        angle = TransferFunction(numerator=(gain,), denominator=(tau, 1.0, 0.0), delay=late)
        margins = sampled_margins(sampled_loop(law, angle, h, "speed"))
        alone.append((margins.phase_margin, margins.delay_margin))
    low, high = np.quantile(alone[1:], (0.025, 0.975), axis=0, method="nearest")
    # Rounding: a root of a polynomial of order five, some tens of units in the last place.
    for k, value in enumerate((gains.phase_margin, gains.delay_margin)):
        assert value == pytest.approx((alone[0][k], low[k], high[k]), rel=1e-12)
