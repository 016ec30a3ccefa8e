from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from servobench.recordings.formats.base import load
from servobench.recordings.formats.describe import describe, quantum
from servobench.recordings.formats.mapping import Mapping
from tests.recordings.formats.tables import codes, loaded
from tests.recordings.native.samples import small

TABLE = "time [ms],u,theta [deg]\n" + "".join(f"{2 * k},{k % 3},{0.5 * (k // 2)}\n" for k in range(60))


def test_a_channel_is_described_by_its_range_its_steps_and_its_repeats(tmp_path: Path) -> None:
    described = describe(loaded(tmp_path, TABLE.replace("\n8,1,1.0\n", "\n8,,1.0\n")))

    _, u, theta = described.channels
    assert (u.name, u.unit, u.samples, u.non_finite, u.minimum, u.maximum, u.levels) == (
        "u",
        None,
        60,
        1,
        0.0,
        2.0,
        3,
    )
    assert (theta.unit, theta.quantum, theta.levels) == ("deg", 0.5, 30)
    assert theta.repeated == pytest.approx(30 / 59)
    assert [channel.times for channel in described.channels] == [0, 0, 0]
    assert len(described.time_bases) == 1
    assert described.time_bases[0].median_step == pytest.approx(0.002)


def test_what_is_recognised_and_what_would_be_asked_are_reported(tmp_path: Path) -> None:
    described = describe(loaded(tmp_path, TABLE))

    assert described.mapping == Mapping(time="time:ms", input="u:V", output="theta:deg")
    assert described.missing == ()
    assert {"time-stated", "input-recognised", "output-recognised"} <= set(codes(described.findings))


def test_what_a_mapping_says_is_enough_to_assign(tmp_path: Path) -> None:
    recording = loaded(tmp_path, TABLE)

    assert describe(describe(recording).mapping.assign_to(recording)).missing == ()


def test_what_is_missing_is_asked_for(tmp_path: Path) -> None:
    described = describe(loaded(tmp_path, "1.5,2\n3.5,4\n4.5,4\n"))

    assert len(described.missing) == 3
    assert described.mapping == Mapping()
    assert described.time_bases == ()


def test_what_stands_in_the_way_is_reported(tmp_path: Path) -> None:
    rows = "".join(f"{k % 30},1,{k}\n" for k in range(60))

    (sentence,) = describe(loaded(tmp_path, "t,u,y [rad]\n" + rows)).missing

    assert "the time goes back" in sentence


def test_channels_without_times_or_samples_are_described_too() -> None:
    described = describe(small(samples=0))

    assert [channel.times for channel in described.channels] == [0, 0, None]
    assert described.channels[0].minimum is described.channels[0].repeated is None
    assert described.channels[2].non_finite == 1
    assert described.mapping.input == "applied:V"


@pytest.mark.parametrize("step", [2 * np.pi / 2048, 6.428571, 1.0, 5e-8])
def test_the_quantum_of_values_on_a_grid_is_found_whatever_the_rounding(step: float) -> None:
    random = np.random.default_rng(1)
    counts = random.integers(-400, 400, 3000)

    # Single precision keeps seven digits of a value, and so four or more of a step that is a 400th of it.
    assert quantum((step * counts).astype(np.float32).astype(float)) == pytest.approx(step, rel=1e-4)


def test_a_quantum_that_no_two_values_differ_by_is_found() -> None:
    assert quantum(np.array([0.0, 2.0, 5.0, 9.0, 11.0, 14.0])) == 1.0


@pytest.mark.parametrize(
    "values",
    [
        np.random.default_rng(1).normal(size=3000),
        np.zeros(5),
        np.array([1.0, 2.0]),
        np.array([]),
        np.full(3, np.nan),
    ],
)
def test_values_on_no_grid_or_too_few_have_no_quantum(values: np.ndarray) -> None:
    assert quantum(values) is None


RealData = Callable[[str], Path]


@pytest.mark.parametrize(
    ("name", "channel", "step"),
    [
        ("undcmotor/und_DCmotor_prbs_open_exp.csv", "y", 360 / 2800 / 0.02),  # one count in 20 ms, in deg/s
        ("qube1_koopman_closedloop/qube_20230828T150615_434_696_394.csv", "theta", 2 * np.pi / 2048),
        ("emps/DATA_EMPS.mat", "qm", 5e-8),
        ("gkeiel_pot_servo/gk_pid.csv", "Channel 2", 450 / 128),
    ],
)
def test_the_quantum_of_real_sensors_is_found(
    name: str, channel: str, step: float, real_data: RealData
) -> None:
    (recording,) = load(real_data(name))

    (described,) = [each for each in describe(recording).channels if each.name == channel]

    # The potentiometer was written with two decimals, which is 0.3 % of its step; the others with more.
    assert described.quantum == pytest.approx(step, rel=3e-3)
