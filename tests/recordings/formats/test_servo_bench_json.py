"""JSON of servo benches: the shape of Rhoban's files, and the files themselves where they are at hand."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servobench.core.errors import FormatError, MissingInformation, UsageError
from servobench.recordings.formats.base import load, save
from servobench.recordings.formats.mapping import assign
from servobench.recordings.recording import Recording
from tests.recordings.formats.makers import bench
from tests.recordings.formats.tables import codes, finding
from tests.recordings.native.samples import small


def loaded(folder: Path, content: object) -> Recording:
    path = folder / "a.json"
    path.write_text(json.dumps(content))
    (recording,) = load(path)
    return recording


def test_channels_have_their_units_and_the_settings_are_kept(tmp_path: Path) -> None:
    recording = loaded(tmp_path, bench())

    units = {each.channel.name: each.channel.unit for each in recording.series}
    assert units == {
        "timestamp": "s", "position": "rad", "speed": "rad/s", "load": None, "supply_voltage": "V", "temp": None,
        "goal_position": "rad", "torque_enable": None,
    }  # fmt: skip
    assert recording.source.format == "servo_bench_json"
    assert recording.info is not None
    assert recording.info.name == "xl330"
    assert dict(recording.info.settings)["mass"] == "0.49 kg"
    assert "format-by-content" not in codes(recording.findings)
    # 0.49 kg · 9.81 m/s² · 0.1 m
    assert "0.481 N·m" in finding(recording.findings, "bench-pendulum").sentence
    assert "not the voltage that drives the motor" in finding(recording.findings, "supply-voltage").sentence


def test_a_load_written_as_an_unsigned_number_gets_its_sign_back(tmp_path: Path) -> None:
    recording = loaded(tmp_path, bench(load=[0, 1, 65535, 65000, 32767, 32768]))

    assert recording["load"].values.tolist() == [0, 1, -1, -536, 32767, -32768]
    assert finding(recording.findings, "load-unwrapped").rows == (3, 6)


def test_a_load_that_is_never_reported_is_a_warning(tmp_path: Path) -> None:
    recording = loaded(tmp_path, bench(load=[0] * 6))

    assert "load-zero" in codes(recording.findings)
    assert "load-raw" not in codes(recording.findings)


def test_torque_off_in_the_middle_is_reported_with_its_rows(tmp_path: Path) -> None:
    recording = loaded(tmp_path, bench(torque=[True, True, False, False, True, True]))

    assert finding(recording.findings, "torque-off").rows == (3, 4)
    assert "torque-off" not in codes(loaded(tmp_path, bench()).findings)


def test_which_channel_is_input_or_output_is_asked_for(tmp_path: Path) -> None:
    recording = loaded(tmp_path, bench())

    with pytest.raises(MissingInformation) as caught:
        assign(recording)

    assert any("`input=" in sentence for sentence in caught.value.missing)
    assert not any("`input=supply_voltage" in sentence for sentence in caught.value.missing)
    assert any("`output=" in sentence for sentence in caught.value.missing)
    assigned = assign(recording, input="goal_position", output="position")
    assert (assigned.input, assigned.output) == ("goal_position", "position")


@pytest.mark.parametrize("broken", [None, 7, {"position": 1.0}, {"timestamp": "soon"}])
def test_a_reading_without_its_numbers_is_left_out(broken: Any, tmp_path: Path) -> None:
    content = bench()
    content["entries"][2] = broken

    recording = loaded(tmp_path, content)

    assert len(recording["position"].values) == 5
    assert finding(recording.findings, "row-not-numbers").rows == (3, 3)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ('{"entries": 3, "goal_position": 1}', "list of readings called"),
        ('{"entries": [], "goal_position": 1}', "list of readings called"),
        ('{"entries": [{"goal_position": 1}]}', "no `timestamp`"),
        ('{"entries": [{"goal_position": 1}', "isn't JSON"),
    ],
)
def test_what_cannot_be_read_says_why(content: str, why: str, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(content)

    with pytest.raises(FormatError, match=why):
        load(path)


def test_it_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="can't be written"):
        save(small(), tmp_path / "a.json")


@pytest.mark.parametrize(
    ("name", "rows", "codes_there"),
    [
        ("feetech_2024-10-26_12h23m27", 286, {"load-zero"}),
        ("feetech_2024-10-26_12h23m42", 354, {"load-zero", "torque-off"}),
        ("xl330_2026-01-15_10h28m10", 1124, {"load-raw", "load-unwrapped"}),
        ("xl330_2026-01-15_10h28m17", 1510, {"load-raw", "load-unwrapped", "torque-off"}),
        ("xl330_2026-01-15_10h28m24", 1116, {"load-raw"}),
    ],
)
def test_a_real_bench_is_read_with_what_is_to_be_known_of_it(
    name: str, rows: int, codes_there: set[str], real_data: Callable[[str], Path]
) -> None:
    (recording,) = load(real_data(f"bam_servos/{name}.json"))

    assert len(recording["position"].values) == rows
    asked = {"load-zero", "load-raw", "load-unwrapped", "torque-off"}
    assert set(codes(recording.findings)) & asked == codes_there
    # A servo can't put out more than all of its supply: the register counts to 885.
    assert np.abs(recording["load"].values).max() <= 885
    assert np.ptp(recording["supply_voltage"].values) > 0.5
