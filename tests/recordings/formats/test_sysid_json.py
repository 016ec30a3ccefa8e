"""Files of WPILib's SysId, made by hand from its documented layout, and two real ones."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servobench.core.errors import FormatError, UsageError
from servobench.core.finding import Severity
from servobench.recordings.formats.base import load, save
from servobench.recordings.formats.mapping import assign
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording
from tests.recordings.formats.tables import codes, columns, finding, units
from tests.recordings.native.samples import small

ROWS = [[0.005 * k, 0.01 * k, 0.1 * k**2, 0.2 * k] for k in range(1, 41)]
HEAD = {"sysid": True, "test": "Simple", "units": "Rotations", "unitsPerRotation": 1.0}


def sysid(folder: Path, content: Any) -> tuple[Recording, ...]:
    path = folder / "sysid.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return load(path)


def one(folder: Path, rows: list[Any], **head: Any) -> Recording:
    (recording,) = sysid(folder, {**HEAD, **head, "slow-forward": rows})
    return recording


def test_each_test_is_a_recording_in_the_order_of_sysid(tmp_path: Path) -> None:
    content = {"fast-backward": ROWS, "fast-forward": [], "slow-backward": ROWS, "slow-forward": ROWS, **HEAD}

    recordings = sysid(tmp_path, content)

    assert [each.name for each in recordings] == ["slow-forward", "slow-backward", "fast-backward"]
    assert all(each.source.format == "sysid_json" for each in recordings)


def test_a_mechanism_has_a_voltage_a_position_and_a_velocity(tmp_path: Path) -> None:
    recording = one(tmp_path, ROWS)

    assert units(recording) == {"time": "s", "voltage": "V", "position": "rev", "velocity": "rev/s"}
    assert list(columns(recording).values()) == np.array(ROWS).T.tolist()
    assert all(
        np.array_equal(recording[name].t, np.array(ROWS)[:, 0]) for name in ("time", "position", "velocity")
    )


def test_a_voltage_acts_from_the_row_before_on_as_the_logger_sets_it_after_its_row(tmp_path: Path) -> None:
    times = np.array(ROWS)[:, 0]

    t = one(tmp_path, ROWS)["voltage"].t
    after_a_strange_row = one(tmp_path, [[0.001, -7.0, 0.0, 0.0], *ROWS])["voltage"].t

    assert t is not None
    assert after_a_strange_row is not None
    assert np.array_equal(t[1:], times[:-1])
    assert t[0] == pytest.approx(0.0, abs=1e-12)  # a usual step before the first row
    assert np.array_equal(after_a_strange_row, [0.001, *times[:-1]])


def test_neither_column_of_a_mechanism_need_be_named(tmp_path: Path) -> None:
    assigned = assign(one(tmp_path, ROWS))

    assert (assigned.input, assigned.output) == ("voltage", "position")
    assert assigned.series == one(tmp_path, ROWS).series


@pytest.mark.parametrize(("first", "at_rest"), [(0.0, True), (0.05, True), (0.5, False)])
def test_a_test_begins_at_rest_unless_its_first_speed_says_otherwise(
    first: float, at_rest: bool, tmp_path: Path
) -> None:
    rows = [[*row[:3], first if k == 0 else row[3]] for k, row in enumerate(ROWS)]  # up to 8 rev/s

    recording = one(tmp_path, rows)

    assert recording.starts_at_rest is at_rest
    assert measure(recording).starts_at_rest is at_rest
    assert ("starts-at-rest" in codes(recording.findings)) is at_rest


@pytest.mark.parametrize(
    ("units", "factor", "expected"),
    [
        ("Rotations", 1.0, ("rev", 1 / (2 * np.pi))),
        ("Meters", 0.3, ("m", 0.3 / (2 * np.pi))),
        ("Feet", 1.5, ("ft", 1.5 / (2 * np.pi))),
        ("Inches", 18.0, ("inch", 18.0 / (2 * np.pi))),
        ("Furlongs", 2.0, ("rev", 1 / (2 * np.pi))),  # what nobody knows leaves the rows' own unit
        ("Meters", -1.0, ("rev", 1 / (2 * np.pi))),
    ],
)
def test_the_unit_of_the_file_is_kept_for_whoever_writes_robot_code(
    units: str, factor: float, expected: tuple[str, float], tmp_path: Path
) -> None:
    found = measure(one(tmp_path, ROWS, units=units, unitsPerRotation=factor)).user_unit

    assert found is not None
    assert (found[0], found[1]) == (expected[0], pytest.approx(expected[1], rel=1e-12))


def test_a_drivetrain_has_two_sides_and_a_gyro(tmp_path: Path) -> None:
    rows = [[row[0], *np.arange(1.0, 9.0)] for row in ROWS]

    recording = one(tmp_path, rows, test="Drivetrain")

    assert {name: values[0] for name, values in columns(recording).items()} == {
        "time": 0.005, "left_voltage": 1.0, "right_voltage": 2.0, "left_position": 3.0, "right_position": 4.0,
        "left_velocity": 5.0, "right_velocity": 6.0, "heading": 7.0, "gyro_rate": 8.0,
    }  # fmt: skip


def test_values_stay_in_rotations_whatever_unit_the_file_names_beside_them(tmp_path: Path) -> None:
    # SysId stores rotations and multiplies by the factor when it analyses; see the source in the module.
    recording = one(tmp_path, ROWS, units="Meters", unitsPerRotation=0.3)

    assert units(recording)["position"] == "rev"
    assert columns(recording)["position"][0] == 0.1
    assert "0.3 Meters" in finding(recording.findings, "units-per-rotation").sentence


def test_a_first_row_with_the_voltage_of_the_test_before_is_left_out(tmp_path: Path) -> None:
    recording = one(tmp_path, [[0.0, -7.0, 0.0, 0.0], *ROWS])

    assert columns(recording)["voltage"] == [row[1] for row in ROWS]
    assert finding(recording.findings, "first-row-other-test").rows == (1, 1)
    assert "-7 V" in finding(recording.findings, "first-row-other-test").sentence


@pytest.mark.parametrize(
    "voltages",
    [
        [0.0, 7.0, 7.0, 7.0, 7.0],  # a step from rest: the motor was at 0 V before
        [7.0, 7.0, 7.0, 7.0, 7.0],
        [0.25, 0.26, 0.27, 0.28, 0.29],
        [1.0, 1.0, 1.2, 1.2, 1.4],  # a ramp that is refreshed now and then
    ],
)
def test_a_first_row_that_belongs_to_its_test_stays(voltages: list[float], tmp_path: Path) -> None:
    recording = one(tmp_path, [[0.005 * k, voltage, 0.1 * k, 1.0] for k, voltage in enumerate(voltages)])

    assert columns(recording)["voltage"] == voltages


def test_velocities_that_nobody_has_set_and_positions_that_are_old_stay_and_are_reported(
    tmp_path: Path,
) -> None:
    rows = [
        [0.005 * k, 7.0, 0.02 * (k // 8) ** 1.5, 3.9e-312 if k < 30 else 1.0 + (k // 8) ** 0.5]
        for k in range(400)
    ]

    recording = one(tmp_path, rows)

    assert len(recording["position"].values) == 400
    assert finding(recording.findings, "velocity-unset").rows == (1, 30)
    assert "about every 8 rows (40 ms)" in finding(recording.findings, "position-stale").sentence


def test_uneven_and_doubled_times_are_reported(tmp_path: Path) -> None:
    times = [0.005, 0.010, 0.010, 0.021, 0.024, 0.022, 0.030, 0.060, 0.065]

    recording = one(tmp_path, [[t, 1.0, 2 * t, 2.0] for t in times])

    assert finding(recording.findings, "time-duplicate").rows == (3, 3)
    assert finding(recording.findings, "time-not-increasing").rows == (6, 6)
    assert {"time-gap", "time-uneven"} <= set(codes(recording.findings))
    assert columns(recording)["time"] == times


def test_rows_that_are_not_as_many_numbers_are_left_out_and_reported(tmp_path: Path) -> None:
    bad: list[Any] = [
        [0.3, 1.0],
        [0.31, "1", 2, 3],
        [0.32, None, 2, 3],
        7,
        [True, 1, 2, 3],
        [10**400, 1, 2, 3],
    ]

    recording = one(tmp_path, [*ROWS, *bad])

    assert len(recording["time"].values) == len(ROWS)
    assert finding(recording.findings, "row-not-numbers").rows == (41, 46)
    assert finding(recording.findings, "row-not-numbers").severity is Severity.WARNING


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("{", "isn't JSON"),
        ("[" * 100_000, "isn't JSON"),
        ([1, 2], "a list of 2"),
        ({}, "has nothing"),
        ({"mass": 1, "entries": []}, "it has `mass`, `entries`. Expected .* a file of SysId"),
        ({"slow-forward": ROWS}, "frc-characterization"),
        (HEAD, "no test with rows; expected one of slow-forward"),
        ({**HEAD, "slow-forward": [[1, 2, 3]] * 3}, "rows of 3 numbers; expected 9 for a drivetrain and 4"),
        ({**HEAD, "slow-forward": {"t": 1}}, "expected a list of rows"),
        ({**HEAD, "slow-forward": ["x"]}, "rows of 0 numbers"),
        ({**HEAD, "slow-forward": [[None] * 4]}, "no row that can be used"),
        ({**HEAD, "units": 3, "slow-forward": ROWS}, "expected a text and a number"),
    ],
)
def test_another_file_is_an_error_that_says_what_is_wrong(content: Any, why: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=why):
        sysid(tmp_path, content)


def test_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"can't be written; write \.mcap"):
        save(small(), tmp_path / "a.json")


RealData = Callable[[str], Path]
FILES = {
    "romi_sysid_data20221106-174834.json": ([4196, 4202, 1348, 890], [None, 7.0, -7.0, None]),
    "romi_sysid_data20221106-172256.json": ([3562, 2995, 834, 724], [None, -2.69857, -3.73605, 7.0]),
}


@pytest.mark.parametrize("name", FILES)
def test_a_real_robot_is_read_with_what_is_wrong_with_it(name: str, real_data: RealData) -> None:
    path = real_data(f"romi_sysid/{name}")
    raw = json.loads(path.read_text())

    recordings = load(path)

    lengths, before = FILES[name]
    assert [each.name for each in recordings] == [
        "slow-forward",
        "slow-backward",
        "fast-forward",
        "fast-backward",
    ]
    assert [len(each["time"].values) for each in recordings] == lengths
    for recording, voltage in zip(recordings, before, strict=True):
        rows = np.array(raw[recording.name])[0 if voltage is None else 1 :]
        assert np.array_equal([series.values for series in recording.series], rows.T)
        first = [each for each in recording.findings if each.code == "first-row-other-test"]
        assert [f"{voltage:g} V" in each.sentence for each in first] == ([] if voltage is None else [True])
        # Counted by hand from the file: nine of ten positions are repeated, about eleven rows or 55 ms long.
        stale = [each.sentence for each in recording.findings if each.code == "position-stale"]
        assert len(stale) == 2
        assert all("every 10 rows" in each or "every 11 rows" in each for each in stale)
        assert "velocity-unset" in codes(recording.findings)


def test_a_side_is_enough_to_name_input_and_output(real_data: RealData) -> None:
    for recording in load(real_data("romi_sysid/romi_sysid_data20221106-174834.json")):
        assigned = assign(recording, input="left", output="left")

        assert (assigned.input, assigned.output) == ("left_voltage", "left_position")
        assert assigned["left_position"].channel.unit == "rev"
        assert finding(measure(assigned).findings, "output-stale").severity is Severity.INFO
