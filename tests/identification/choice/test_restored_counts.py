"""A speed that was differenced from counts is fitted as the counts, and nothing else is.

Two routes: the same counts given directly, and as their difference.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.finding import Verdict
from servobench.identification.choice.restored_counts import with_counts_restored
from servobench.identification.identify import identify
from servobench.identification.result import Result
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset
from tests.rig.motor.reference import Truth, march

RESTORED = "counts-restored"


def as_speed(data: Dataset, y: NDArray[np.float64], chain: str = "") -> Dataset:
    stages = Chain.parse(chain)
    y = stages(y, data.t_output)
    return replace(data, y=y, kind="speed", output_unit="rad/s", quantum=None, declared=stages)


def differenced(data: Dataset) -> NDArray[np.float64]:
    return np.concatenate([np.zeros(1), np.diff(data.y) / np.diff(data.t_output)])


def codes(result: Result) -> set[str]:
    return {finding.code for finding in result.findings}


def assert_same(one: Result, other: Result) -> None:
    """The parameters and their intervals agree to a millionth of the value, or of the interval where it is the larger."""
    assert one.fit is not None
    assert other.fit is not None
    assert one.fit.model.names == other.fit.model.names
    for name, value in one.fit.estimates.items():
        scale = 1e-6 * max(abs(value.value), value.interval[1] - value.interval[0])
        assert other.fit[name].value == pytest.approx(value.value, abs=scale)
        assert other.fit[name].interval == pytest.approx(value.interval, abs=scale)


@pytest.mark.parametrize("kind", ["square", "prbs"])
def test_differenced_counts_give_what_the_counts_give(kind) -> None:  # type: ignore[no-untyped-def]
    counts = dataset(seed=3, kind=kind)
    given = identify(counts)
    found = identify(as_speed(counts, differenced(counts)))

    assert given.verdict is found.verdict is Verdict.TRUSTED
    assert RESTORED in codes(found)
    assert_same(given, found)


def test_a_central_difference_gives_what_the_counts_give() -> None:
    counts = dataset(seed=3)
    found = identify(as_speed(counts, np.gradient(counts.y, counts.t_output)))

    assert RESTORED in codes(found)
    assert_same(identify(counts), found)


def test_differenced_counts_behind_a_declared_filter_give_what_the_counts_give() -> None:
    counts = dataset(seed=3)
    found = identify(as_speed(counts, differenced(counts), "lowpass 50 rad/s"))

    assert RESTORED in codes(found)
    assert_same(identify(counts), found)


def test_differenced_counts_under_a_random_torque_give_what_the_counts_give() -> None:
    counts = dataset(seed=3, kind="prbs", torque_noise=2e-5)
    # From the count at which the sum begins: prediction error's search ends elsewhere in its tolerance from another one.
    same = replace(counts, y=counts.y - counts.y[0] + 0.5 * (counts.quantum or 0.0))
    found = identify(as_speed(counts, differenced(counts)))

    assert RESTORED in codes(found)
    assert_same(identify(same), found)


def test_an_estimator_that_was_asked_for_gets_the_speed() -> None:
    counts = dataset(seed=3)
    records, findings = with_counts_restored([as_speed(counts, differenced(counts))], "srivc")

    assert records[0].kind == "speed"
    assert not findings


def test_records_are_summed_together_or_not_at_all() -> None:
    counts = dataset(seed=3)
    speed = as_speed(counts, differenced(counts))
    noisy = replace(speed, y=speed.y + np.random.default_rng(1).normal(scale=0.5, size=len(speed.y)))

    assert [record.kind for record in with_counts_restored([speed, speed])[0]] == ["position", "position"]
    assert [record.kind for record in with_counts_restored([speed, noisy])[0]] == ["speed", "speed"]


def test_a_record_to_validate_on_is_summed_as_those_that_the_model_is_fitted_to() -> None:
    """Differences of counts this coarse are half rounding, which no model simulates."""
    counts, other = dataset(seed=3), replace(dataset(seed=4), name="another run")
    as_counts = identify(counts, validate_on=[other])
    result = identify(
        as_speed(counts, differenced(counts)), validate_on=[as_speed(other, differenced(other))]
    )

    assert result.verdict is Verdict.TRUSTED
    assert [finding.code for finding in result.findings].count(RESTORED) == 2
    assert as_counts.validation is not None
    assert result.validation is not None
    assert result.validation.fit_percent == pytest.approx(as_counts.validation.fit_percent, abs=1e-4)


@pytest.mark.parametrize("torque_noise", [0.0, 2e-4])
@pytest.mark.parametrize("noise", [0.2, 0.9, 2.7])
def test_counts_of_noisy_readings_are_found_too(noise: float, torque_noise: float) -> None:
    """Noise of 0.2 to 2.7 counts in each reading, which isn't rounding but stays where it is when it is summed."""
    counts = dataset(seed=3)
    kicks = {"torque_noise": torque_noise, "step": 5e-5, "seed": 3} if torque_noise else {}
    angle = march(Truth(), counts.u, 0.002, **kicks)[:, 2]  # type: ignore[arg-type]
    random = np.random.default_rng(5).normal(size=len(angle))
    noisy = replace(counts, y=QUANTUM * np.floor(angle / QUANTUM + noise * random))

    assert with_counts_restored([as_speed(noisy, differenced(noisy))])[0][0].kind == "position"


@pytest.mark.parametrize("torque_noise", [0.0, 2e-5])
@pytest.mark.parametrize("step", [np.pi / 30, 0.0817, 1.534])
@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_a_tachometer_behind_a_converter_is_not_taken_for_counts(
    step: float, noise: float, torque_noise: float
) -> None:
    """Steps of 1 rpm as a display prints them, and two of converters, with noise in parts of a step."""
    counts = dataset(seed=3)
    kicks = {"torque_noise": torque_noise, "step": 5e-5, "seed": 3} if torque_noise else {}
    true = march(Truth(), counts.u, 0.002, **kicks)[:, 1]  # type: ignore[arg-type]
    random = np.random.default_rng(5).normal(size=len(true))
    speed = as_speed(counts, step * np.rint(true / step + noise * random))

    assert with_counts_restored([speed])[0][0].kind == "speed"


@pytest.mark.parametrize("seed", range(16))
def test_a_hundred_speeds_with_errors_of_their_own_are_not_summed(seed: int) -> None:
    """So are those of a log that keeps every n-th difference; where they are differences from row to row, they are summed."""
    every = slice(None, None, 20)
    counts = dataset(seed=seed, kind="prbs", hold=40, samples=20 * 105)
    t, y = counts.t_output[every], counts.y[every]
    speed = np.concatenate([np.zeros(1), np.diff(y) / np.diff(t)])
    step = QUANTUM / (t[1] - t[0])
    noise = np.rint(np.random.default_rng(seed).normal(size=len(t)))

    def record(values: NDArray[np.float64]) -> Dataset:
        sparse = replace(counts, t_input=t, u=counts.u[every], t_output=t, y=values, quantum=None, rows=None)
        return replace(sparse, kind="speed", output_unit="rad/s")

    assert with_counts_restored([record(speed)])[0][0].kind == "position"
    assert with_counts_restored([record(speed + step * noise)])[0][0].kind == "speed"


@pytest.mark.parametrize("printed", [2, None])
def test_counts_behind_an_average_that_nobody_named_give_what_the_counts_give(printed: int | None) -> None:
    """Taken for the motor's, the average's lag of 4 sample times would make a time constant of 0.107 s out of 0.0998 s."""
    counts = dataset(seed=3)
    smooth, speed = np.zeros(len(counts.y)), differenced(counts)
    for k in range(1, len(speed)):
        smooth[k] = smooth[k - 1] + 0.2 * (speed[k] - smooth[k - 1])
    if printed is not None:
        smooth = np.round(smooth * 30 / np.pi, printed) * np.pi / 30
    data = replace(as_speed(counts, smooth), recorded_unit="rpm", chain_known=False)
    found = identify(data)

    (restored,) = [each for each in found.findings if each.code == RESTORED]
    assert "weighs the newest sample by 0.2 " in restored.sentence
    assert found.verdict is Verdict.TRUSTED
    assert_same(identify(counts), found)


@pytest.mark.parametrize("digits", [4, 5, None])
@pytest.mark.parametrize("step", [1.0, 0.5, 0.1, 1 / 3])
def test_an_exact_simulation_is_no_average_of_its_input(step: float, digits: int | None) -> None:
    """y[k] = a y[k-1] + (1 - a) K u[k-1] is an average, too: of levels, which are whole numbers of one step, and no counts."""
    u = np.repeat(step * np.rint(np.random.default_rng(1).uniform(-6.0, 6.0, 75) / step), 20)
    y, left = np.zeros(len(u)), np.exp(-0.01 / 0.1)
    for k in range(1, len(u)):
        y[k] = left * y[k - 1] + (1.0 - left) * 20.0 * u[k - 1]
    if digits is not None:
        y = np.round(y, digits)
    data = replace(
        dataset(seed=1, samples=len(u), sample_time=0.01, u=u, y=y),
        kind="speed",
        output_unit="rad/s",
        quantum=None,
    )

    result = identify(replace(data, recorded_unit="rad/s", chain_known=False))

    assert RESTORED not in codes(result)
    assert result["time_constant"].value == pytest.approx(0.1, rel=1e-3)
