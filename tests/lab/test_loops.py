"""Loops as they are written on paper: each law against its transfer function, put together by python-control."""

from __future__ import annotations

import control
import numpy as np
import pytest

from servobench.identification.models.base import Output
from servobench.lab.loops import motor_system, on_paper
from servobench.systems.control.lead import Lead
from servobench.systems.control.pid import Pid
from servobench.systems.control.state_feedback import StateFeedback
from servobench.systems.tuning.base import Tunable

K, TAU = 23.8, 0.0998
S = control.tf("s")
SPEED = K / (TAU * S + 1)
OMEGA = np.array([0.3, 4.0, 30.0, 700.0])


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (Pid(kp=2.0), 2 * SPEED / S),
        (Pid(kp=2.0, kd=0.3), (2 + 0.3 * S) * SPEED / S),
        (Pid(kp=2.0, ki=7.0, kd=0.3), (2 + 7 / S + 0.3 * S) * SPEED / S),
        (Pid(kp=0.2, ki=7.0, output="speed"), (0.2 + 7 / S) * SPEED),
        (Lead(gain=3.0, zero=12.0, pole=90.0), 3 * (1 + S / 12) / (1 + S / 90) * SPEED / S),
        (Lead(gain=3.0, zero=12.0, pole=90.0, output="speed"), 3 * (1 + S / 12) / (1 + S / 90) * SPEED),
        (StateFeedback(position_gain=2.0, speed_gain=0.3), (2 + 0.3 * S) * SPEED / S),
        (
            StateFeedback(position_gain=2.0, speed_gain=0.3, integral_gain=7.0),
            (2 + 7 / S + 0.3 * S) * SPEED / S,
        ),
        (
            StateFeedback(position_gain=0.0, speed_gain=0.3, integral_gain=7.0, output="speed"),
            (0.3 + 7 / S) * SPEED,
        ),
    ],
)
def test_the_loop_on_paper_is_the_laws_formula_before_the_motors(law: Tunable, expected: object) -> None:
    found = on_paper(law, K, TAU)(1j * OMEGA)
    # Some ten products and sums of 1e-16 each on either side.
    np.testing.assert_allclose(found, expected(1j * OMEGA), rtol=1e-13)  # type: ignore[operator]


@pytest.mark.parametrize(("output", "expected"), [("speed", SPEED), ("position", SPEED / S)])
def test_the_motor_is_a_lag_to_the_speed_and_an_integrator_more_to_the_position(
    output: Output, expected: object
) -> None:
    found = motor_system(K, TAU, output)(1j * OMEGA)
    np.testing.assert_allclose(found, expected(1j * OMEGA), rtol=1e-13)  # type: ignore[operator]
