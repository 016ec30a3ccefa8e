"""The noise of an encoder's speed: exact formulas against counts made by floor, filtered by SciPy."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import lfilter

from servobench.core.errors import UsageError
from servobench.recordings.measurement.base import Chain
from servobench.systems.filters.quantisation import (
    count_fraction,
    derivative_noise,
    mean_noise,
    noise,
)

STEP = 2 * np.pi / 2048
SAMPLES = 200_000


def coefficients(cutoff: float, sample_time: float, how: str) -> tuple[list[float], list[float]]:
    """Of `cutoff`/(s + cutoff), from the three substitutions for s."""
    h = cutoff * sample_time
    if how == "euler":  # s = (z - 1)/T
        return [0.0, h], [1.0, h - 1.0]
    if how == "tustin":  # s = (2/T)(z - 1)/(z + 1)
        return [h / (2 + h), h / (2 + h)], [1.0, (h - 2) / (h + 2)]
    return [0.0, 1.0 - np.exp(-h)], [1.0, -np.exp(-h)]


def error(
    speed: float,
    sample_time: float,
    phase: float = 0.3,
    filtered: tuple[list[float], list[float]] | None = None,
) -> np.ndarray:
    """The error of differenced counts at a constant speed, after the filter has settled."""
    k = np.arange(SAMPLES)
    shown = STEP / sample_time * np.diff(np.floor(speed * sample_time / STEP * k + phase))
    if filtered is not None:
        shown = lfilter(*filtered, shown)
    return shown[SAMPLES // 4 :] - speed


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2)))


@pytest.mark.parametrize("speed", [3.3, 19.905, 47.55, 47.6, 47.65, 67.3])
@pytest.mark.parametrize("sample_time", [0.002, 0.001])
def test_the_differences_noise_is_that_of_counts_made_by_floor(speed: float, sample_time: float) -> None:
    # In N samples the share of the rarer difference is within 1/N of f, which moves the rms by a part 1/(2 N f (1 - f)).
    f = (speed * sample_time / STEP) % 1
    tolerance = 1 / (2 * 0.75 * SAMPLES * f * (1 - f)) + 1e-6

    assert rms(error(speed, sample_time)) == pytest.approx(
        derivative_noise(speed, sample_time, STEP), rel=tolerance
    )
    assert noise(Chain.parse("derivative"), speed, sample_time, STEP) == pytest.approx(
        derivative_noise(speed, sample_time, STEP), rel=1e-9
    )


@pytest.mark.parametrize("how", ["euler", "zoh", "tustin"])
@pytest.mark.parametrize("cutoff", [10, 50, 200])
@pytest.mark.parametrize("speed", [19.905, 47.6, 67.3])
def test_the_noise_behind_a_filter_is_that_of_the_run(how: str, cutoff: float, speed: float) -> None:
    chain = Chain.parse(f"derivative | lowpass {cutoff} rad/s {how}")

    # The strong lines are 0.002 cycles a sample and more from zero: 300 periods and more, of which the record cuts a part of one.
    found = rms(error(speed, 0.002, filtered=coefficients(cutoff, 0.002, how)))
    assert noise(chain, speed, 0.002, STEP) == pytest.approx(found, rel=1e-3)


@pytest.mark.parametrize("phase", [0.0, 0.1, 0.24, 0.9])
@pytest.mark.parametrize(("numerator", "denominator"), [(1, 2), (1, 4), (3, 8), (5, 16)])
def test_a_fraction_of_small_numbers_has_the_same_noise_wherever_the_shaft_started(
    numerator: int, denominator: int, phase: float
) -> None:
    """A step and a time of one: the counts of a sample are exact in binary."""
    speed = 31 + numerator / denominator
    k = np.arange(16 * 4000)
    shown = lfilter(*coefficients(0.1, 1.0, "tustin"), np.diff(np.floor(speed * k + phase)))
    whole = shown[-16 * 1000 :] - speed  # whole periods, after the filter forgot its start to e^-200

    assert noise(Chain.parse("derivative | lowpass 0.1 rad/s"), speed, 1.0, 1.0) == pytest.approx(
        rms(whole), rel=1e-6
    )


def test_half_a_count_is_taken_away_by_tustin_and_halved_by_nobody_else() -> None:
    """At f = 1/2 the differences alternate by Δ/T about the mean: a sine at half the sample rate, with z = -1."""
    h, alternating = 0.1, 0.5
    by = {
        how: noise(Chain.parse(f"derivative | lowpass 0.1 rad/s {how}"), 31.5, 1.0, 1.0)
        for how in ("euler", "tustin")
    }

    assert by["tustin"] == pytest.approx(0, abs=1e-7)  # the root of a variance that rounds to 1e-15
    assert by["euler"] == pytest.approx(alternating * h / (2 - h), rel=1e-9)


def test_whole_counts_make_no_noise() -> None:
    assert derivative_noise(31.0, 1.0, 1.0) == 0
    assert noise(Chain.parse("derivative | lowpass 0.1 rad/s"), 31.0, 1.0, 1.0) == 0


@pytest.mark.parametrize(
    "text", ["derivative", "derivative | lowpass 50 rad/s euler", "tachometer 40 ms", "least_squares 20 ms"]
)
def test_the_noise_over_all_speeds_is_the_mean_of_the_noise_at_each(text: str) -> None:
    chain, arch = Chain.parse(text), STEP / 0.002
    speeds = arch * (40 + (np.arange(2003) + 0.5) / 2003)  # a prime: no window's period falls in step with it

    each = np.array([noise(chain, speed, 0.002, STEP) for speed in speeds])

    # The mean over a period of a function that has kinks, by 2003 points: their square spacing times some hundred kinks.
    assert rms(each) == pytest.approx(mean_noise(chain, 0.002, STEP), rel=1e-3)


def test_the_difference_over_all_speeds_has_a_sixth_of_the_step_squared() -> None:
    """∫ f (1 - f) over a period is 1/6."""
    assert mean_noise(Chain.parse("derivative"), 0.002, STEP) == pytest.approx(
        STEP / 0.002 / np.sqrt(6), rel=1e-9
    )
    assert quad(lambda f: f * (1 - f), 0, 1)[0] == pytest.approx(1 / 6)


def test_the_fraction_of_a_count_is_between_zero_and_one_whichever_way_the_shaft_turns() -> None:
    assert count_fraction(31.25, 1.0, 1.0) == 0.25
    assert count_fraction(-31.25, 1.0, 1.0) == 0.75
    assert derivative_noise(-31.25, 1.0, 1.0) == derivative_noise(31.25, 1.0, 1.0)


@pytest.mark.parametrize(
    ("sample_time", "quantum"), [(0, STEP), (-1, STEP), (float("nan"), STEP), (0.002, 0), (0.002, -1)]
)
def test_times_and_steps_that_are_none_are_refused(sample_time: float, quantum: float) -> None:
    with pytest.raises(UsageError, match="expected a positive finite number"):
        derivative_noise(47.6, sample_time, quantum)
