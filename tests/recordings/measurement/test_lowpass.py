"""The low-pass filter against closed forms and SciPy's discretisation."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from servobench.core.errors import UsageError
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.lowpass import Lowpass

T = 0.002
t = T * np.arange(2000)


@pytest.mark.parametrize(
    ("discretisation", "scipys_name"), [("euler", "euler"), ("zoh", "zoh"), ("tustin", "bilinear")]
)
@pytest.mark.parametrize("cutoff", [1.0, 50.0, 400.0])
def test_regular_samples_are_filtered_as_scipy_discretises_it(
    discretisation: str, scipys_name: str, cutoff: float
) -> None:
    x = np.random.default_rng(1).normal(size=len(t))
    x[0] = 0.0  # where a filter at rest that starts before the record agrees with one that starts with it

    b, a, _ = cont2discrete(([cutoff], [1.0, cutoff]), T, method=scipys_name)

    expected = lfilter(np.atleast_1d(b.squeeze()), a, x)
    filtered = Lowpass(cutoff=cutoff, discretisation=discretisation)(x, t)  # type: ignore[arg-type]
    # Rounding of t makes single steps wrong by 4e-16 s, 2e-13 of a step.
    np.testing.assert_allclose(filtered, expected, rtol=0, atol=1e-11)


def test_zoh_is_exact_for_held_input_at_irregular_times() -> None:
    """Held input from sample to sample: y -> x + (y - x) e^(-ω Δt), the solution of y' = ω (x - y)."""
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.uniform(0.001, 0.03, 200))
    x = rng.normal(size=200)

    filtered = Lowpass(cutoff=50.0, discretisation="zoh")(x, times)

    y, expected = 0.0, [0.0]
    for k in range(199):
        for _ in range(7):  # the same in seven parts: the exact solution doesn't mind
            y = x[k] + (y - x[k]) * np.exp(-50.0 * (times[k + 1] - times[k]) / 7)
        expected.append(y)
    np.testing.assert_allclose(filtered, expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("discretisation", "delay"), [("tustin", 0.02), ("euler", 0.02), ("zoh", 0.02 + T / 2)]
)
def test_a_ramp_comes_late_by_the_filters_delay(discretisation: str, delay: float) -> None:
    filtered = Lowpass(cutoff=50.0, discretisation=discretisation)(t, t)  # type: ignore[arg-type]

    # zoh: T a/(1 - a) + T with a = e^-0.1, 1/ω + T/2 + ω T²/12 = 0.021017 s; the others exactly 1/ω.
    assert t[-1] - filtered[-1] == pytest.approx(delay, abs=2e-5 if discretisation == "zoh" else 1e-12)


def test_tustin_is_the_nearest_to_the_continuous_filter_when_the_log_is_slow() -> None:
    """A sine of 2 rad/s through 50/(s + 50), logged every 50 ms: amplitude and phase of the continuous filter."""
    slow = 0.05 * np.arange(400)
    response = 1.0 / (1.0 + 2.0j / 50.0)
    exact = np.imag(response * np.exp(2.0j * slow))

    def error(discretisation: str) -> float:
        return float(
            np.abs(Lowpass(cutoff=50.0, discretisation=discretisation)(np.sin(2.0 * slow), slow) - exact)[
                50:
            ].max()
        )  # type: ignore[arg-type]

    assert error("tustin") < 0.001 < error("zoh")
    with pytest.raises(UsageError, match="diverges"):
        error("euler")


@pytest.mark.parametrize("step", [0.04, 0.05])
def test_forward_euler_that_would_diverge_says_so_and_what_to_do(step: float) -> None:
    times = step * np.arange(10)
    stage = Chain.parse("lowpass 50 rad/s euler")

    with pytest.raises(UsageError, match=r"diverges.*lowpass 50 rad/s tustin"):
        stage(np.ones(10), times)
    with pytest.raises(UsageError, match="diverges"):
        stage.step(stage.start(), 1.0, step)
    assert np.all(np.isfinite(Chain.parse("lowpass 50 rad/s tustin")(np.ones(10), times)))


def test_forward_euler_just_below_its_limit_rings_and_settles() -> None:
    y = Chain.parse("lowpass 50 rad/s euler")(np.ones(2000), 0.0398 * np.arange(2000))

    assert y.max() > 1.9
    assert y[-1] == pytest.approx(1.0, abs=1e-8)


def test_a_cut_off_in_hertz_is_a_turn_per_second() -> None:
    assert Lowpass.parse(("8", "Hz", "zoh")) == Lowpass(cutoff=16 * np.pi, discretisation="zoh")
    assert Lowpass.parse(("8Hz",)) == Lowpass(cutoff=16 * np.pi, discretisation="tustin")


@pytest.mark.parametrize(
    "words", [(), ("50",), ("50.",), ("euler",), ("50", "euler"), ("50", "rad/s", "bilinear"), ("50", "ms")]
)
def test_a_cut_off_without_its_unit_is_asked_for(words: tuple[str, ...]) -> None:
    with pytest.raises(UsageError, match="lowpass 50 rad/s"):
        Lowpass.parse(words)


@pytest.mark.parametrize("cutoff", [0.0, -50.0, np.inf, np.nan])
def test_a_cut_off_that_is_no_frequency_is_refused(cutoff: float) -> None:
    with pytest.raises(UsageError, match="cut-off"):
        Lowpass(cutoff=cutoff)


def test_an_unknown_way_to_compute_it_is_refused() -> None:
    with pytest.raises(UsageError, match="known: euler, zoh, tustin"):
        Lowpass(cutoff=50.0, discretisation="matched")  # type: ignore[arg-type]


def test_a_long_record_with_a_decayed_start_state_has_no_nan() -> None:
    response = Lowpass(cutoff=200.0).start_response(0.002 * np.arange(100_000))

    assert np.all(np.isfinite(response))
    assert response[-1] < 1e-300
