"""The effect of the encoder's steps on a differentiated speed: formula and published figures against brute force."""

import numpy as np
import pytest

from servobench.recordings.measurement.base import Chain

STEP = 2.0 * np.pi / 2048  # rad
SAMPLES = 200_000


def speed_error(speed: float, sample_time: float, chain: str, settled: float = 1.0) -> float:
    """The rms error [rad/s] of a constant speed [rad/s] read from an ideal encoder, after a chain."""
    t = sample_time * np.arange(SAMPLES)
    position = STEP * np.floor((speed * t + 0.3 * STEP) / STEP)
    error = Chain.parse(chain)(position, t) - speed
    return float(np.sqrt(np.mean(error[t > settled] ** 2)))


@pytest.mark.parametrize("sample_time", [0.002, 0.001])
@pytest.mark.parametrize("speed", [47.55, 47.60, 47.65])
def test_the_derivatives_noise_is_that_of_the_fraction_of_a_count(speed: float, sample_time: float) -> None:
    """A step is n or n + 1 counts, n + 1 in a share f of them: rms = (Δ/T) √(f (1 - f)), f the fraction of ω T/Δ."""
    f = np.modf(speed * sample_time / STEP)[0]

    expected = STEP / sample_time * np.sqrt(f * (1 - f))

    # In N samples the share is within 1/N of f: a relative error of 1/(2 N f (1 - f)), 0.2 % for the smallest f, 0.0025.
    assert speed_error(speed, sample_time, "derivative") == pytest.approx(expected, rel=0.003)


@pytest.mark.parametrize(
    ("speed", "sample_time", "published"),
    [(47.60, 0.002, 0.263), (47.60, 0.001, 1.533), (47.55, 0.002, 0.072), (47.65, 0.002, 0.373)],
)
def test_the_derivatives_noise_has_its_published_value(
    speed: float, sample_time: float, published: float
) -> None:
    assert speed_error(speed, sample_time, "derivative") == pytest.approx(published, abs=0.0006)


def test_sampling_twice_as_fast_makes_the_noise_more_than_five_times_larger_at_this_speed() -> None:
    assert speed_error(47.6, 0.001, "derivative") > 5 * speed_error(47.6, 0.002, "derivative")


# Cut-off [rad/s], then rms [rad/s] by forward Euler, ZOH, Tustin, at 500 Hz; the last row at 1 kHz.
PUBLISHED = [
    (10, 0.002, 0.0089, 0.0088, 0.0084),
    (20, 0.002, 0.0178, 0.0175, 0.0167),
    (50, 0.002, 0.0428, 0.0409, 0.0388),
    (100, 0.002, 0.0760, 0.0705, 0.0659),
    (200, 0.002, 0.1253, 0.1093, 0.0987),
    (50, 0.001, 0.0451, 0.0440, 0.0217),
]


@pytest.mark.parametrize(("cutoff", "sample_time", "euler", "zoh", "tustin"), PUBLISHED)
def test_the_filtered_noise_has_its_published_values(
    cutoff: int, sample_time: float, euler: float, zoh: float, tustin: float
) -> None:
    found = [
        speed_error(47.6, sample_time, f"derivative | lowpass {cutoff} rad/s {how}", settled=3.0)
        for how in ("euler", "zoh", "tustin")
    ]

    # Half of the last printed digit, and a tenth more for the finite record (its end cuts a period of the error's beat).
    assert found == pytest.approx([euler, zoh, tustin], abs=0.55e-4)
