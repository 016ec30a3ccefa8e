"""A speed that stops rising before the input does."""

from dataclasses import replace

import numpy as np
import pytest

from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.trust.doubts.output_limited import DOUBTS, _limit
from tests.contracts.finding_examples.base import sound_fit

N = 4000


def simulated() -> np.ndarray:
    """The output that a model expects: levels between -60 and 60 rad/s, each approached over 0.1 s."""
    levels = np.repeat(np.random.default_rng(3).uniform(-60.0, 60.0, N // 100), 100)
    lag, speed = np.exp(-0.002 / 0.1), np.zeros(N)
    for n in range(1, N):
        speed[n] = levels[n] + (speed[n - 1] - levels[n]) * lag
    return speed


def fit_of(measured: np.ndarray) -> Fit:
    (record,) = sound_fit().records
    data = replace(
        record.data,
        kind="speed",
        output_unit="rad/s",
        quantum=None,
        t_output=np.arange(N) * 0.002,
        y=measured,
    )
    seen: FittedRecord = replace(
        record,
        data=data,
        prediction=simulated(),
        residual=measured - simulated(),
        innovations=measured - simulated(),
        valid=np.ones(N, dtype=bool),
    )
    return replace(sound_fit(), records=(seen,))


def codes(measured: np.ndarray) -> list[str]:
    return [each.code for each in DOUBTS["output_limited"].about_fit(fit_of(measured))]


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("noise", [0.0, 1.0, 5.0])
def test_a_range_that_ends_is_seen_behind_noise_and_in_one_direction(sign: int, noise: float) -> None:
    ended = sign * np.minimum(sign * simulated(), 35.0)

    assert codes(ended + np.random.default_rng(0).normal(0.0, noise, N)) == ["output-limited"]


@pytest.mark.parametrize("noise", [0.0, 5.0, 20.0])
def test_noise_alone_is_no_limit(noise: float) -> None:
    for seed in range(10):
        assert codes(simulated() + np.random.default_rng(seed).normal(0.0, noise, N)) == []


def test_a_gain_that_falls_by_a_third_has_a_size_and_is_no_limit() -> None:
    bent = np.sign(simulated()) * np.minimum(np.abs(simulated()), 30.0 + 0.67 * (np.abs(simulated()) - 30.0))

    assert codes(bent) == []


def test_a_shaft_that_stands_where_the_model_turns_is_no_limit() -> None:
    """Friction holds it under the larger inputs at the beginning, and no longer once it is warm."""
    held = np.where(simulated() > 0.7 * simulated().max(), 0.0, simulated())

    assert codes(held) == []


@pytest.mark.parametrize(("errors", "is_limited"), [(1.9, False), (2.1, True)])
def test_a_flat_end_counts_where_its_slope_is_lower_by_two_standard_errors(
    errors: float, is_limited: bool
) -> None:
    """Slopes of 1 below and 0.2 above, of which 0.4 would do: so many errors of the slope are what is between.

    Each speed is there four times, with +a, -a, -a and +a beside the line: that has no slope, nor are neighbours alike.
    """
    below, above = np.linspace(10.0, 60.0, 100), np.repeat(np.linspace(71.0, 100.0, 50), 4)
    spread = float(np.sum((above - above.mean()) ** 2))
    size = 0.2 / errors * np.sqrt(spread * (len(above) - 2) / len(above))
    flat = 50.0 + 0.2 * (above - 71.0) + size * np.tile([1.0, -1.0, -1.0, 1.0], 50)

    assert (_limit(np.concatenate([below, above]), np.concatenate([below, flat])) is not None) == is_limited
