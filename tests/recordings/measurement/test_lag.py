"""The lag of a chain against its closed form."""

from __future__ import annotations

import pytest

from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.lag import lag_of


@pytest.mark.parametrize("tau", [0.02, 0.1, 0.5])
@pytest.mark.parametrize(("text", "lag"), [("lowpass 50 rad/s", 0.02), ("average 40 ms", 0.02)])
def test_a_filter_delays_by_its_time_constant_and_an_average_by_half_of_its_time(
    text: str, lag: float, tau: float
) -> None:
    # The trapezoid rule over eight time constants and lags leaves e^-8 and the corners.
    assert lag_of(Chain.parse(text), tau) == pytest.approx(lag, rel=0.02)


@pytest.mark.parametrize(
    ("text", "lag"), [("average 2 s", 1.0), ("lowpass 2 rad/s", 0.5), ("delay 1 s", 1.0)]
)
def test_a_chain_that_takes_far_longer_than_the_motor_is_followed_to_its_end(text: str, lag: float) -> None:
    assert lag_of(Chain.parse(text), 0.02) == pytest.approx(lag, rel=0.02)


def test_nothing_in_between_delays_by_nothing() -> None:
    assert lag_of(Chain(), 0.1) == pytest.approx(0.0, abs=1e-4)
