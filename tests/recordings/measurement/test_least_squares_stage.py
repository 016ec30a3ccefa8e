"""The stage `least_squares`, against NumPy's fit of a straight line to each window."""

import numpy as np
import pytest

from servobench.recordings.measurement.base import Chain

REGULAR = 0.002 * np.arange(300)
IRREGULAR = np.cumsum(np.random.default_rng(4).uniform(0.001, 0.004, 300))


@pytest.mark.parametrize("t", [REGULAR, IRREGULAR], ids=["regular", "irregular"])
@pytest.mark.parametrize("window", [0.0005, 0.02, 0.0333])
def test_it_is_the_slope_of_the_line_nearest_to_the_samples_of_the_window(
    t: np.ndarray, window: float
) -> None:
    x = np.cumsum(np.random.default_rng(6).normal(size=len(t)))

    found = Chain.parse(f"least_squares {window} s")(x, t)

    for k in range(1, len(t)):
        here = (t >= t[k] - window - 1e-9) & (t <= t[k])
        here[k - 1] = True  # two samples at least
        assert found[k] == pytest.approx(np.polyfit(t[here] - t[k], x[here], 1)[0], rel=1e-8, abs=1e-8)
    assert found[0] == 0


def test_its_noise_is_lower_than_that_of_the_first_and_last_sample_by_the_root_of_n_over_six() -> None:
    """Of independent errors s: 2 s²/W² by two samples, 12 s²/(W² n) by n of them (for large n)."""
    t, n = 0.002 * np.arange(200_000), 51
    x = np.random.default_rng(8).normal(size=len(t))

    ratio = np.std(Chain.parse("tachometer 0.1 s")(x, t)[n:]) / np.std(
        Chain.parse("least_squares 0.1 s")(x, t)[n:]
    )

    exact = np.sqrt(2 / 12 * n * (n + 1) / (n - 1))  # Σ (k - k̄)² = n (n² - 1)/12, W = (n - 1) T
    # 200,000 samples, of which some 4000 are independent: a standard error of 1/√8000 for each of the two.
    assert ratio == pytest.approx(exact, rel=0.05)


def test_a_steady_speed_comes_out_exactly() -> None:
    assert Chain.parse("least_squares 20 ms")(47.6 * REGULAR + 3, REGULAR)[1:] == pytest.approx(
        47.6, rel=1e-10
    )
