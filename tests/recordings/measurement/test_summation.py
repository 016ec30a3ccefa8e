"""Counts that were differenced into a speed are found again, and what only looks like them isn't."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.summation import summations, whole_counts
from servobench.recordings.recording import Source

SAMPLES = 3000
T = 0.002 * np.arange(SAMPLES)
QUANTUM = 2.0 * np.pi / 2048
COUNTS = np.floor((40.0 * T - 4.0 * (1.0 - np.exp(-T / 0.1)) + np.sin(3.0 * T)) / QUANTUM)


def speed_of(y: NDArray[np.float64], t: NDArray[np.float64] = T, unit: str = "rad/s") -> Dataset:
    return Dataset(
        name="a speed",
        t_input=t,
        u=np.ones(len(t)),
        input_unit="V",
        input_before=0.0,
        t_output=t,
        y=y,
        output_unit=unit,
        kind="speed",
        source=Source(name="a speed"),
    )


def differenced(t: NDArray[np.float64] = T) -> NDArray[np.float64]:
    return np.concatenate([np.zeros(1), np.diff(COUNTS) * QUANTUM / np.diff(t)])


def first_counts(data: Dataset) -> NDArray[np.float64]:
    """The counts of the first position that a speed may be made of, from 0."""
    found = next(summations(data)).data
    assert found.quantum is not None
    assert found.kind == "position"
    return found.y / found.quantum - 0.5


@pytest.mark.parametrize(
    "printed",
    [
        pytest.param(lambda v: v, id="in full"),
        pytest.param(lambda v: np.float64(np.float32(v)), id="in single precision"),
        pytest.param(lambda v: np.round(v, 3), id="three decimals"),
        pytest.param(lambda v: np.deg2rad(np.round(np.rad2deg(v), 1)), id="0.1 deg/s"),
        pytest.param(lambda v: np.round(v * 30 / np.pi, 2) * np.pi / 30, id="0.01 rpm"),
    ],
)
def test_counts_are_found_again_in_their_difference(printed) -> None:  # type: ignore[no-untyped-def]
    np.testing.assert_allclose(first_counts(speed_of(printed(differenced()))), COUNTS - COUNTS[0], atol=1e-6)


def test_the_quantum_of_printed_values_is_that_of_a_whole_number_of_counts_in_a_turn() -> None:
    found = next(summations(speed_of(np.round(differenced(), 3))))

    assert found.data.quantum == QUANTUM


def test_counts_are_found_again_at_times_that_jitter() -> None:
    t = T + 0.0004 * np.random.default_rng(1).random(SAMPLES)

    assert np.array_equal(np.rint(first_counts(speed_of(differenced(t), t))), COUNTS - COUNTS[0])


def test_counts_in_a_second_are_summed_to_counts() -> None:
    found = next(summations(speed_of(np.round(differenced() / QUANTUM), unit="counts/s")))

    assert found.data.quantum == 1.0
    assert found.data.output_unit == "counts"


def test_a_record_that_begins_in_mid_motion_starts_at_any_count() -> None:
    assert np.array_equal(
        np.rint(first_counts(speed_of(differenced()[1000:], T[1000:]))), COUNTS[1000:] - COUNTS[1000]
    )


def test_a_slow_encoder_has_one_count_in_some_samples() -> None:
    counts = np.floor(COUNTS / 100)
    y = np.concatenate([np.zeros(1), np.diff(counts)]) * 0.2 / 0.002

    assert np.array_equal(np.rint(first_counts(speed_of(y))), counts - counts[0])


def test_a_central_difference_is_summed_over_every_second_sample() -> None:
    y = np.gradient(COUNTS * QUANTUM, T)
    central = list(summations(speed_of(y)))[1].data

    assert central.quantum == pytest.approx(QUANTUM, rel=1e-9)
    np.testing.assert_allclose(central.y / QUANTUM - 0.5, COUNTS - COUNTS[0], atol=1e-6)


@pytest.mark.parametrize("text", ["lowpass 50 rad/s", "lowpass 50 rad/s euler", "lowpass 50 rad/s zoh"])
def test_counts_are_found_again_behind_a_declared_low_pass(text: str) -> None:
    chain = Chain.parse(f"derivative | {text}")
    data = replace(speed_of(chain(COUNTS * QUANTUM, T)), declared=chain)
    found = first_counts(data)

    assert len(found) >= SAMPLES - 1  # forward Euler and a hold haven't seen the last one
    np.testing.assert_allclose(found, (COUNTS - COUNTS[0])[: len(found)], atol=1e-6)


@pytest.mark.parametrize("decay", [np.exp(-0.1), 1.0 / 1.1, 0.9])
def test_counts_are_found_again_behind_the_usual_line_of_a_firmware(decay: float) -> None:
    y = np.zeros(SAMPLES)
    for k, x in enumerate(differenced()[1:], start=1):
        y[k] = decay * y[k - 1] + (1.0 - decay) * x
    data = replace(speed_of(y), declared=Chain.parse("lowpass 50 rad/s"))

    np.testing.assert_allclose(first_counts(data), COUNTS - COUNTS[0], atol=1e-6)


@pytest.mark.parametrize("text", ["lowpass 40 rad/s euler", "average 0.02 s"])
def test_a_filter_that_was_another_one_is_not_undone(text: str) -> None:
    y = Chain.parse("lowpass 50 rad/s euler")(differenced(), T)

    assert not list(summations(replace(speed_of(y), declared=Chain.parse(text))))


def test_what_lies_on_no_lattice_is_not_summed() -> None:
    smooth = np.gradient(np.sin(3.0 * T) + 40.0 * T, T)
    noisy = differenced() + np.random.default_rng(2).normal(scale=0.3 * QUANTUM / 0.002, size=SAMPLES)

    for y in (smooth, noisy, np.zeros(SAMPLES)):
        assert not list(summations(speed_of(y)))


def test_a_speed_that_was_counted_over_a_time_is_not_summed() -> None:
    edges = 1.0 + np.arange(SAMPLES) % 97
    assert not list(summations(speed_of(QUANTUM / (edges * 1e-4))))


def test_a_record_in_which_rows_are_missing_is_not_summed() -> None:
    kept = np.delete(np.arange(SAMPLES), slice(1000, 1003))

    assert not list(summations(speed_of(differenced()[kept], T[kept])))


def test_a_speed_that_was_differenced_here_is_left_as_it_was_asked_for() -> None:
    data = replace(speed_of(differenced()), applied=Chain.parse("derivative"))

    assert not list(summations(data))


def test_a_quantum_that_printed_digits_leave_open_is_none() -> None:
    """Counts of 0.0307 rad/s that are printed to 0.001 are known to a twentieth of 0.001 over their largest number, 60."""
    steps = np.round(0.0307123 * (np.arange(3000) % 60), 3)

    assert whole_counts(steps, "m") is None
    assert whole_counts(0.0307123 * (np.arange(3000) % 60), "m") is not None


def printed_in_rpm(speed: NDArray[np.float64], digits: int, t: NDArray[np.float64] = T) -> Dataset:
    """A speed [rad/s] as it comes from a column of rpm with so many decimals."""
    rpm = np.round(speed * 30.0 / np.pi, digits)
    return replace(speed_of(rpm * np.pi / 30.0, t), recorded_unit="rpm")


def averaged(speed: NDArray[np.float64], weight: float) -> NDArray[np.float64]:
    """The line `y += weight * (x - y)` of a sketch."""
    y = np.zeros(len(speed))
    for k in range(1, len(speed)):
        y[k] = y[k - 1] + weight * (speed[k] - y[k - 1])
    return y


@pytest.mark.parametrize("weight", [0.1, 0.19, 0.35, 0.5])
def test_counts_are_found_again_behind_an_average_that_nobody_named(weight: float) -> None:
    (found,) = summations(printed_in_rpm(averaged(differenced(), weight), 2))

    assert found.by_counts
    assert f"weighs the newest sample by {weight:.2g} " in found.how
    assert found.data.quantum == QUANTUM
    np.testing.assert_allclose(
        found.data.y / QUANTUM - 0.5, COUNTS - COUNTS[0], atol=1e-6, err_msg="from the first row on"
    )


def test_an_average_that_somebody_says_there_is_none_of_is_not_looked_for() -> None:
    data = printed_in_rpm(averaged(differenced(), 0.2), 2)

    assert list(summations(data))
    assert not list(summations(replace(data, chain_known=True)))


@pytest.mark.parametrize("digits", [None, 1, 2])
def test_differences_that_are_not_averaged_are_no_average(digits: int | None) -> None:
    """What an average of one half would have been of is 2 y[k] - y[k-1], a whole number of counts as well."""
    data = speed_of(differenced()) if digits is None else printed_in_rpm(differenced(), digits)

    assert not any(each.by_counts for each in summations(data))


@pytest.mark.parametrize("weight", [0.2, 0.3])
@pytest.mark.parametrize("counts", [360, 1024])
@pytest.mark.parametrize("digits", [None, 2])
def test_an_average_is_found_with_all_digits_and_with_few(
    weight: float, counts: int, digits: int | None
) -> None:
    t, quantum = 0.01 * np.arange(SAMPLES), 2.0 * np.pi / counts
    turned = np.floor((40.0 * t + 25.0 * np.sin(1.3 * t) + 9.0 * np.sin(4.1 * t)) / quantum)
    smooth = averaged(np.append(0.0, np.diff(turned)) * quantum / 0.01, weight)
    (found,) = summations(speed_of(smooth, t) if digits is None else printed_in_rpm(smooth, digits, t))

    np.testing.assert_allclose(
        found.data.y / (found.data.quantum or 1.0) - 0.5, turned - turned[0], atol=1e-3
    )


@pytest.mark.parametrize("seed", range(8))
def test_noise_behind_an_average_has_no_counts(seed: int) -> None:
    """A tachometer of 10 bits with two steps of noise, smoothed and printed with two decimals."""
    steps = np.rint(
        40.0 + 20.0 * np.sin(3.0 * T) + 2.0 * np.random.default_rng(seed).standard_normal(SAMPLES)
    )
    noisy = 0.1 * (steps + 0.3 * np.random.default_rng(seed + 100).standard_normal(SAMPLES))

    assert not list(summations(printed_in_rpm(averaged(noisy, 0.2), 2)))


@pytest.mark.parametrize("counts", [403.2, 1496.88, 2803.2])
@pytest.mark.parametrize("digits", [0, 1])
def test_a_geared_encoder_is_not_rounded_to_a_round_number(counts: float, digits: int) -> None:
    """A print that leaves several counts in a turn open has no encoder of 400, 1500 or 2800 in it: a gear makes others."""
    t, quantum = 0.01 * np.arange(SAMPLES), 2.0 * np.pi / counts
    turned = np.floor((5.0 * t + 2.0 * np.sin(1.3 * t)) / quantum)
    speed = np.append(0.0, np.diff(turned)) * quantum / 0.01

    for found in summations(printed_in_rpm(speed, digits, t)):
        assert found.data.quantum == pytest.approx(quantum, rel=1e-4)


def test_few_counts_whose_print_repeats_are_those_of_the_encoder() -> None:
    """A count of 29.297 rpm is 29.3 in print, twice as many 58.6, and so on up to a dozen: all are multiples of 29.3."""
    t = 0.001 * np.arange(SAMPLES)
    counts = np.floor(np.cumsum(6.0 + 5.5 * np.sin(7.0 * t)))
    speed = np.append(0.0, np.diff(counts)) * QUANTUM / 0.001
    found = next(summations(printed_in_rpm(speed, 1, t)))

    assert found.data.quantum == QUANTUM


@pytest.mark.parametrize("digits", [0, 1])
def test_the_last_digit_of_a_print_is_no_count(digits: int) -> None:
    """At 50 ms a count of 4096 is 0.29 rpm: tenths of a rpm are a grid, of 12,000 in a turn, and so are whole ones."""
    t = 0.05 * np.arange(SAMPLES)
    speed = (
        np.append(0.0, np.diff(np.floor((8.0 * t + np.sin(0.3 * t)) / (0.5 * QUANTUM))))
        * 0.5
        * QUANTUM
        / 0.05
    )

    assert not list(summations(printed_in_rpm(speed, digits, t)))


def test_an_average_of_a_motor_that_changes_its_speed_shows_that_a_row_is_missing() -> None:
    kept = np.delete(np.arange(SAMPLES), 1500)
    data = printed_in_rpm(averaged(differenced(), 0.2)[kept], 2, T[kept])

    assert not list(summations(data))
