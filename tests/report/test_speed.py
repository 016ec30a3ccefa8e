from dataclasses import replace

import numpy as np

from servobench.report.speed import eye_speed, eye_window
from tests.report.makers import QUANTUM, dataset


def test_the_speed_of_a_steady_motion_is_exact_at_uneven_times() -> None:
    t = np.cumsum(np.random.default_rng(1).uniform(0.001, 0.003, 200))

    times, speed = eye_speed(t, 5.0 * t + 2.0, 10)

    assert len(times) == len(speed) == 190
    np.testing.assert_allclose(
        speed, 5.0, rtol=1e-10
    )  # differences of numbers near 4, over 0.02 s: 1e-16 · 4 / 0.02
    assert np.isin(times, t).all()


def test_the_encoder_s_step_is_a_fiftieth_of_the_speed_or_less() -> None:
    data = dataset()

    _, speed = eye_speed(data.t_output, data.y, eye_window(data))

    step = QUANTUM / (eye_window(data) * data.sample_time)
    assert (
        step <= np.mean(np.abs(speed)) / 50 * 1.1
    )  # the mean over the record's middle is not quite that over all of it


def test_values_that_a_logger_repeats_are_looked_through() -> None:
    data = dataset()
    stale = replace(data, y=np.repeat(data.y[::10], 10))

    assert eye_window(stale) >= 60
    assert eye_window(data) < 60


def test_a_record_too_short_for_a_window_has_no_speed_and_breaks_nothing() -> None:
    still = replace(dataset(samples=3), y=np.zeros(3))

    assert eye_window(still) == 2
    assert len(eye_speed(still.t_output[:2], still.y[:2], 2)[0]) == 0
