"""Both chirps against SciPy's, and their frequency against its law."""

import math

import numpy as np
import pytest
import scipy.signal

from servobench.systems.signals.chirp import Chirp
from servobench.systems.signals.logarithmic_chirp import LogarithmicChirp
from servobench.systems.signals.sine import Sine

T = np.arange(5000) * 0.002  # one sweep of 10 s


@pytest.mark.parametrize(("first", "last"), [(0.1, 10.0), (10.0, 0.1), (0.5, 20.0)])
@pytest.mark.parametrize(("kind", "method"), [(Chirp, "linear"), (LogarithmicChirp, "logarithmic")])
def test_a_sweep_is_that_of_scipy(kind: type, method: str, first: float, last: float) -> None:
    signal = kind(amplitude=1, initial_frequency=first, final_frequency=last, sweep_time=10)

    expected = scipy.signal.chirp(T, first, 10.0, last, method, phi=-90)

    # SciPy's phase reaches 2π · 200 and is rounded at several places.
    np.testing.assert_allclose(signal(T), expected, rtol=0, atol=1e-10)


def test_a_linear_chirp_may_start_from_standing_still() -> None:
    signal = Chirp(amplitude=1, initial_frequency=0, final_frequency=10, sweep_time=10)

    np.testing.assert_allclose(signal(T), np.sin(2 * math.pi * T**2 / 2), rtol=0, atol=1e-10)


@pytest.mark.parametrize("kind", [Chirp, LogarithmicChirp])
def test_a_chirp_between_equal_frequencies_is_a_sine(kind: type) -> None:
    signal = kind(amplitude=1, initial_frequency=2, final_frequency=2, sweep_time=10)

    np.testing.assert_allclose(signal(T), Sine(frequency=2)(T), rtol=0, atol=1e-10)


def test_a_logarithmic_chirp_takes_as_long_for_each_octave() -> None:
    signal = LogarithmicChirp(amplitude=1, initial_frequency=1, final_frequency=16, sweep_time=8)
    t = np.linspace(0, 8, 800_001)

    upward = t[1:][np.diff(np.signbit(signal(t)).astype(int)) == -1]
    # Crossing n of the phase 2π n: n = f0 T (2^(t/2) - 1) / ln 16, as the frequency doubles every 2 s.
    n = np.arange(len(upward) + 1)[1:]
    np.testing.assert_allclose(
        upward, 2 * np.log2(1 + n * math.log(16) / 8), rtol=0, atol=2e-5
    )  # two steps of t


@pytest.mark.parametrize("kind", [Chirp, LogarithmicChirp])
def test_the_shortest_change_belongs_to_the_higher_frequency(kind: type) -> None:
    assert kind(initial_frequency=25, final_frequency=1).shortest_change == 0.02
