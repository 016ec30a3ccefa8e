"""What an unknown chain costs, against what `identify` makes of data that went through one that it isn't told of."""

from __future__ import annotations

import numpy as np
import pytest

from servobench.identification.identify import identify
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.cost import TYPICAL, bias_of, chain_cost, lag_of
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source

TAU, STEP, HALF = 0.1, 0.002, 1.0  # s; a half period of ten time constants is a step that is over


def speed(t: np.ndarray, tau: float) -> np.ndarray:
    """The speed of 1/(τs + 1) for a square wave of ±1 that begins with a step up at time zero, in closed form."""
    edges = np.arange(0.0, float(t[-1]) + HALF, HALF)
    sizes = 2.0 * (-1.0) ** np.arange(len(edges))
    since = np.maximum(t[:, None] - edges, 0.0)
    return -1.0 + (-np.expm1(-since / tau)) @ sizes


def through_lowpass(t: np.ndarray, tau: float, lag: float) -> np.ndarray:
    """The same behind 1/(lag s + 1), by partial fractions: the chain's own code takes no part."""
    return (tau * speed(t, tau) - lag * speed(t, lag)) / (tau - lag)


def through_average(t: np.ndarray, tau: float, window: float) -> np.ndarray:
    """The same as a mean over a time, summed on a fine grid."""
    behind = np.linspace(0.0, window, 401)
    return np.trapezoid([speed(t - b, tau) for b in behind], behind, axis=0) / window


def fitted(seen: np.ndarray, t: np.ndarray) -> float:
    u = np.where(np.floor((t + 1e-9) / HALF) % 2 == 0, 1.0, -1.0)
    noise = 0.002 * np.random.default_rng(4).standard_normal(len(t))
    data = Dataset(
        name="speed",
        t_input=t,
        u=u,
        input_unit="V",
        input_before=-1.0,
        t_output=t,
        y=seen + noise,
        output_unit="rad/s",
        kind="speed",
        source=Source(name="test"),
    )
    fit = identify([data], structure="first_order", estimator="output_error").fit
    assert fit is not None
    return fit["time_constant"].value


@pytest.mark.parametrize(
    ("text", "seen"),
    [("lowpass 50 rad/s", (through_lowpass, 0.02)), ("average 100 ms", (through_average, 0.1))],
)
def test_the_bias_is_that_of_a_fit_which_is_not_told_of_the_chain(text: str, seen: tuple) -> None:
    t = STEP * np.arange(5000)
    shape, size = seen

    bias = fitted(shape(t, TAU, size), t) / TAU - 1.0

    # Steps and samples of 2 ms in place of one step and a fine grid: a tenth of the bias.
    assert bias_of(Chain.parse(text), TAU) == pytest.approx(bias, rel=0.1)


@pytest.mark.parametrize("tau", [0.02, 0.1, 0.5])
def test_least_squares_lie_between_the_moments_and_the_whole_lag(tau: float) -> None:
    """By algebra the moments give √(τ² + V), with V = 1/ω² for the filter; a fit without a delay takes τ + 1/ω."""
    chain = Chain.parse("lowpass 50 rad/s")

    assert np.sqrt(1 + (0.02 / tau) ** 2) - 1 < bias_of(chain, tau) < 0.02 / tau
    assert lag_of(chain, tau) == pytest.approx(0.02, rel=0.02)


def test_nothing_in_between_costs_nothing() -> None:
    assert bias_of(Chain(), 0.1) == pytest.approx(0.0, abs=1e-9)


def test_the_costs_are_named_and_grow_with_the_lag() -> None:
    costs = chain_cost(0.1, 0.01)

    assert [name for name, _ in costs] == ["differenced counts", *(name for name, _ in TYPICAL)]
    assert all(bias > 0 for _, bias in costs)
    assert dict(chain_cost(0.02, 0.01))["an average over 100 ms"] > dict(costs)["an average over 100 ms"]
