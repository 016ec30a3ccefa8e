"""A multisine has the spectrum, the peak and the crest factor that it says."""

import math

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.systems.signals.multisine import Multisine


def amplitudes(signal: Multisine, points: int = 4096) -> np.ndarray:
    """Return the amplitude of each harmonic, from 0 on."""
    u = signal(np.arange(points) / points * signal.period)
    spectrum = np.abs(np.fft.rfft(u)) / points
    return np.concatenate([spectrum[:1], 2 * spectrum[1:]])


@pytest.mark.parametrize("phases", ["schroeder", "random"])
@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"frequency": 0.1, "highest": 5}, range(1, 51)),
        ({"frequency": 0.1, "highest": 5, "harmonics": "odd"}, range(1, 50, 2)),
        ({"frequency": 0.1, "lowest": 0.3, "highest": 0.7}, range(3, 8)),
        ({"frequency": 0.1, "lowest": 0.35, "highest": 0.75, "harmonics": "odd"}, range(5, 8, 2)),
        ({"frequency": 0.01, "lowest": 0.07, "highest": 0.09}, range(7, 10)),  # 0.07 / 0.01 is above 7
        ({"frequency": 0.2, "lowest": 0.01, "highest": 0.2}, range(1, 2)),
    ],
)
def test_the_harmonics_asked_for_are_there_alike_and_no_others(
    phases: str, settings: dict, expected: range
) -> None:
    found = amplitudes(Multisine(offset=0.5, phases=phases, **settings))

    present = found[list(expected)]
    absent = np.delete(found, [0, *expected])
    assert found[0] == pytest.approx(0.5, abs=1e-12)
    np.testing.assert_allclose(present, present[0], rtol=1e-10)
    assert absent.max() < 1e-12  # some eps of 4096 values of size 3


@pytest.mark.parametrize(
    "settings", [{}, {"phases": "random"}, {"harmonics": "odd"}, {"highest": 0.1}, {"highest": 20}]
)
def test_the_peak_is_the_amplitude_and_never_above_it(settings: dict) -> None:
    signal = Multisine(amplitude=2, offset=1, **settings)
    degree = round(signal.highest / signal.frequency)
    t = np.linspace(0, signal.period, 1000 * degree + 1)

    peak = np.abs(signal(t) - 1).max()

    # The grid above misses the peak by less than 1 - cos(π / 1000) = 5e-6; the bound in the signal gives up to 0.13 %.
    assert 2 * (1 - 0.0013 - 1e-5) < peak <= 2


def test_the_crest_factor_is_peak_over_root_mean_square() -> None:
    signal = Multisine(amplitude=2, offset=1)
    u = signal(np.arange(100_000) / 100_000 * signal.period) - 1

    # The grid has 2000 points for each period of the highest harmonic; the rest is the bound on the peak, 0.13 %.
    assert signal.crest_factor == pytest.approx(np.abs(u).max() / math.sqrt(np.mean(u**2)), rel=0.0014)


def test_one_harmonic_has_the_crest_factor_of_a_sine() -> None:
    assert Multisine(highest=0.1).crest_factor == pytest.approx(math.sqrt(2), rel=0.0013)


def test_schroeders_phases_keep_the_crest_factor_near_that_of_a_sweep() -> None:
    # Schroeder (1970) gives relative peak factors, crest / √2, of about 1.2 for a flat spectrum; random phases about √(ln N).
    assert Multisine(highest=10).crest_factor < 1.3 * math.sqrt(2)
    random = [Multisine(highest=10, phases="random", seed=seed).crest_factor for seed in range(20)]
    assert min(random) > 1.5 * math.sqrt(2)


def test_random_phases_come_from_the_seed_and_leave_the_global_generator_alone() -> None:
    t = np.linspace(0, 10, 100)
    state = np.random.get_state()[1].copy()  # noqa: NPY002 - it is this one that must not move

    one, again = Multisine(phases="random", seed=1)(t), Multisine(phases="random", seed=1)(t)
    other = Multisine(phases="random", seed=2)(t)

    np.testing.assert_array_equal(one, again)
    assert not np.allclose(one, other)
    np.testing.assert_array_equal(state, np.random.get_state()[1])  # noqa: NPY002


def test_random_phases_are_the_same_in_every_version() -> None:
    # The first output of PCG64 seeded with 0, over 2^64, from NumPy 2.4; NumPy promises that a bit generator's stream stays.
    u = Multisine(amplitude=1, frequency=1, highest=1, phases="random", seed=0)(np.array([0.0]))

    assert u[0] == pytest.approx(math.cos(2 * math.pi * 0.636961687) * math.cos(math.pi / 64), abs=1e-3)


@pytest.mark.parametrize(
    "settings",
    [
        {"highest": 0.05},
        {"lowest": 2, "highest": 1},
        {"frequency": 1, "lowest": 2, "highest": 2.5, "harmonics": "odd"},
        {"frequency": 1e-5},
    ],
)
def test_a_band_without_harmonics_or_with_far_too_many_is_refused(settings: dict) -> None:
    with pytest.raises(UsageError, match="frequency"):
        Multisine(**settings)
