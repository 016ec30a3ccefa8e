"""A controller that answers to the speed of its own row; what is no controller, or none that anything is known of."""

from dataclasses import replace

import numpy as np

from servobench.identification.trust.doubts.feedback import answers_to_output
from tests.datasets import dataset

T = 0.01 * np.arange(200)
NOISE = np.random.default_rng(2).normal(0.0, 1.0, 200)


def answers(u: np.ndarray, y: np.ndarray) -> bool:
    speed = replace(dataset(seed=1, samples=200, u=u, y=y), kind="speed", output_unit="rad/s", quantum=None)
    return answers_to_output(speed)


def test_only_an_input_that_goes_against_the_speed_of_its_row_is_a_controller_s() -> None:
    speed = 50.0 + NOISE

    assert answers(3.0 - 0.2 * NOISE, speed)
    assert answers(-3.0 - 0.2 * NOISE, speed - 100.0)
    assert not answers(3.0 + 0.2 * NOISE, speed)
    assert not answers(3.0 - 0.2 * np.roll(NOISE, 2), speed)


def test_a_ramp_and_a_motor_that_stands_are_no_controller_s() -> None:
    assert not answers(T, 20.0 * T + NOISE)
    assert not answers(3.0 - 0.2 * NOISE, np.zeros(200))
