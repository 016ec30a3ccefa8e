"""WPILib data logs: bytes by the specification's own examples, and what robots' logs are like."""

import struct
from pathlib import Path

import numpy as np
import pytest

from servobench.core.errors import FormatError, UsageError
from servobench.recordings.formats import datalog
from servobench.recordings.formats.base import load, save
from servobench.recordings.formats.mapping import assign
from servobench.recordings.recording import Recording
from tests.recordings.formats.tables import codes, finding
from tests.recordings.formats.wpilogs import (
    HEADER,
    STATES,
    about,
    double,
    doubles,
    finish,
    record,
    robot,
    start,
    sysid,
    text,
)
from tests.recordings.native.samples import small


def loaded(folder: Path, data: bytes) -> tuple[Recording, ...]:
    path = folder / "a.wpilog"
    path.write_bytes(data)
    return load(path)


def one(folder: Path, data: bytes) -> Recording:
    (recording,) = loaded(folder, data)
    return recording


def test_the_examples_of_the_specification_are_read(tmp_path: Path) -> None:
    starting = bytes.fromhex(
        "20 00 1a 40 42 0f 00 01 00 00 00 04 00 00 00 74 65 73 74 05 00 00 00 69 6e 74 36 34 00 00 00 00"
    )  # the specification prints 66 64 for the last letters of `int64`, which are 36 34
    value = bytes.fromhex("20 01 08 40 42 0f 03 00 00 00 00 00 00 00")
    change = bytes.fromhex(
        "20 00 18 40 42 0f 02 01 00 00 00 0f 00 00 00 7b 22 73 6f 75 72 63 65 22 3a 22 4e 54 22 7d"
    )
    end = bytes.fromhex("20 00 05 40 42 0f 01 01 00 00 00")

    recording = one(tmp_path, HEADER + starting + value + change + end)

    assert recording["test"].values.tolist() == [3.0]
    assert recording["test"].t.tolist() == [1.0]
    assert recording.findings == ()


@pytest.mark.parametrize(
    "widths", [(e, s, t) for e in (1, 2, 3, 4) for s in (1, 2, 3, 4) for t in range(1, 9)]
)
def test_a_record_may_have_numbers_of_any_length(widths: tuple[int, int, int], tmp_path: Path) -> None:
    entry, size, stamp = widths
    bits = (entry - 1) | (size - 1) << 2 | (stamp - 1) << 4
    head = (
        bytes([bits])
        + (1).to_bytes(entry, "little")
        + (8).to_bytes(size, "little")
        + (77).to_bytes(stamp, "little")
    )

    recording = one(tmp_path, HEADER + start(1, "u") + head + struct.pack("<d", 2.5) + double(1, 99, 3.5))

    assert recording["u"].values.tolist() == [2.5, 3.5]
    assert recording["u"].t.tolist() == [77e-6, 99e-6]


def test_each_type_of_number_keeps_its_values_and_each_entry_its_own_times(tmp_path: Path) -> None:
    recording = one(tmp_path, robot())

    names = ["NT:/arm/voltage", "NT:/arm/position_rad", "count", "on", "pose_1", "pose_2", "pose_3", "f"]
    assert [each.channel.name for each in recording.series] == names
    assert recording["count"].values.tolist() == list(range(60))
    assert recording["on"].values.tolist() == [0.0, 1.0] * 30
    assert recording["pose_3"].values.tolist() == [3.0 * k for k in range(60)]
    assert recording["f"].values.tolist() == [k / 4 for k in range(60)]
    shift = recording["NT:/arm/position_rad"].t - recording["NT:/arm/voltage"].t
    assert np.allclose(shift, 40e-6, rtol=0, atol=1e-12)
    assert recording["NT:/arm/position_rad"].channel.unit == "rad"
    skipped = finding(recording.findings, "entry-skipped").sentence
    assert "`messages (string)`" in skipped
    assert "`schema (structschema)`" in skipped


def test_names_with_slashes_and_colons_are_recognised_and_can_be_said(tmp_path: Path) -> None:
    recording = one(tmp_path, robot())

    recognised = assign(recording)
    said = assign(recording, input="NT:/arm/voltage:V", output="NT:/arm/position_rad:deg")

    assert (recognised.input, recognised.output) == ("NT:/arm/voltage", "NT:/arm/position_rad")
    assert said["NT:/arm/position_rad"].channel.unit == "deg"


def test_stamps_out_of_order_are_sorted_stably_and_negative_ones_kept(tmp_path: Path) -> None:
    stamps, values = [-3, 5, 2, 5, -3], [0.0, 1.0, 2.0, 3.0, 4.0]

    recording = one(tmp_path, HEADER + start(1, "u") + doubles(1, stamps, values))

    assert recording["u"].t.tolist() == [-3e-6, -3e-6, 2e-6, 5e-6, 5e-6]
    assert recording["u"].values.tolist() == [0.0, 4.0, 2.0, 1.0, 3.0]
    assert codes(recording.findings) == ["time-sorted", "time-negative"]
    assert "`u (2)`" in finding(recording.findings, "time-sorted").sentence


def test_an_entry_with_the_number_of_a_finished_one_is_another(tmp_path: Path) -> None:
    log = HEADER + start(1, "u") + double(1, 1, 1.0) + finish(1) + start(1, "y") + double(1, 2, 2.0)

    recording = one(tmp_path, log)

    assert {each.channel.name: each.values.tolist() for each in recording.series} == {"u": [1.0], "y": [2.0]}


def test_an_entry_whose_number_is_given_away_ends_there(tmp_path: Path) -> None:
    """As where a program is restarted into the same file."""
    log = HEADER + start(1, "u") + double(1, 1, 1.0) + start(1, "y") + double(1, 2, 2.0)

    recording = one(tmp_path, log)

    assert {each.channel.name: each.values.tolist() for each in recording.series} == {"u": [1.0], "y": [2.0]}


def test_an_entry_that_goes_on_after_it_was_finished_is_one_channel(tmp_path: Path) -> None:
    log = HEADER + start(1, "u") + double(1, 1, 1.0) + finish(1) + start(4, "u") + double(4, 2, 2.0)

    recording = one(tmp_path, log)

    assert recording["u"].values.tolist() == [1.0, 2.0]
    assert codes(recording.findings) == ["entry-continued"]


def test_two_open_entries_of_the_same_name_stay_two_channels(tmp_path: Path) -> None:
    log = HEADER + start(1, "u") + start(2, "u") + double(1, 1, 1.0) + double(2, 2, 2.0)

    recording = one(tmp_path, log)

    assert {each.channel.name: each.values.tolist() for each in recording.series} == {
        "u": [1.0],
        "u_2": [2.0],
    }
    assert codes(recording.findings) == ["name-duplicate"]


@pytest.mark.parametrize(
    ("metadata", "unit"),
    [
        ("Volt", "Volt"), ("V", "V"), ("Rotation per Second", "rotation/second"), ("turns_per_second", "turns/second"),
        ("radian", "radian"), ('{"unit": "rad/s"}', "rad/s"), ('{"source":"NT"}', None), ("{broken", None), ("apples", None),
    ],
)  # fmt: skip
def test_the_text_about_an_entry_may_say_its_unit(metadata: str, unit: str | None, tmp_path: Path) -> None:
    log = HEADER + start(1, "x") + double(1, 1, 1.0) + about(1, metadata) + double(1, 2, 2.0)

    assert one(tmp_path, log)["x"].channel.unit == unit


def test_a_text_about_an_entry_that_is_cut_short_says_nothing(tmp_path: Path) -> None:
    cut = record(0, 0, struct.pack("<BII", 2, 1, len("radian")) + b"rad")
    log = HEADER + start(1, "x", metadata="degree") + cut + double(1, 1, 1.0)

    assert one(tmp_path, log)["x"].channel.unit == "degree"


def test_a_value_of_another_size_than_its_type_is_left_out(tmp_path: Path) -> None:
    log = HEADER + start(1, "u") + double(1, 1, 1.0) + record(1, 2, b"123") + double(1, 3, 3.0)

    recording = one(tmp_path, log)

    assert recording["u"].values.tolist() == [1.0, 3.0]
    assert codes(recording.findings) == ["payload-odd"]


def test_a_log_that_notes_changes_says_that_its_gaps_are_no_lack_of_data(tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    stamps = np.cumsum(np.where(np.arange(40) % 10 == 5, 3_000_000, 20_000)).tolist()
    even = (20_000 * np.arange(40)).tolist()
    noise = random.normal(size=40).tolist()

    recording = one(
        tmp_path, HEADER + start(1, "u") + start(2, "y") + doubles(1, stamps, noise) + doubles(2, even, noise)
    )

    assert "`u`" in (sentence := finding(recording.findings, "values-on-change").sentence)
    assert "`y`" not in sentence


def test_pauses_between_tests_are_not_taken_for_values_noted_on_change(tmp_path: Path) -> None:
    assert all("values-on-change" not in codes(each.findings) for each in loaded(tmp_path, sysid()))


def test_a_cut_log_is_read_up_to_the_cut(tmp_path: Path) -> None:
    log = HEADER + start(1, "u") + doubles(1, [1, 2, 3], [1.0, 2.0, 3.0])

    recording = one(tmp_path, log[:-2])

    assert recording["u"].values.tolist() == [1.0, 2.0]
    assert "the middle of a record" in finding(recording.findings, "recording-cut-short").sentence


def test_records_of_entries_that_were_never_started_are_counted(tmp_path: Path) -> None:
    recording = one(
        tmp_path, HEADER + double(9, 0, 5.0) + start(1, "u") + double(1, 1, 1.0) + double(9, 2, 6.0)
    )

    assert recording["u"].values.tolist() == [1.0]
    assert "2 records" in finding(recording.findings, "record-unknown").sentence


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (HEADER, "without an entry of numbers"),
        (HEADER + start(1, "m", "string") + text(1, 2, "hello"), "it has `m .string.`"),
        (b"WPILOG\x00\x02" + HEADER[8:], "version 2.0"),
        (HEADER[:9], "cut short"),
        (HEADER[:8] + b"\xff\xff\xff\xff", "cut short in its header"),
    ],
)
def test_what_cannot_be_read_says_why(data: bytes, why: str, tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=why):
        loaded(tmp_path, data)


def test_a_log_larger_than_is_read_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(datalog, "MOST_BYTES", 100)

    with pytest.raises(FormatError, match="more than 100"):
        loaded(tmp_path, robot())


def test_a_log_of_sysid_is_a_recording_for_each_of_its_tests(tmp_path: Path) -> None:
    recordings = loaded(tmp_path, sysid())

    assert [each.name for each in recordings] == list(STATES)
    for recording in recordings:
        names = ["voltage-motor-arm", "position-motor-arm", "velocity-motor-arm"]
        assert [each.channel.name for each in recording.series] == names
        assert [each.channel.unit for each in recording.series] == ["Volt", "rotation", "rotation/second"]
        assert "split by `sysid-test-state-arm`" in finding(recording.findings, "log-split").sentence
    # The state is noted after the measurements of the same loop, so that those of the first loop come just before it.
    assert recordings[0]["voltage-motor-arm"].values.tolist() == [0.02 * k for k in range(40)]
    assert set(recordings[3]["voltage-motor-arm"].values) == {-7.0}
    assigned = assign(recordings[2], input="voltage", output="position")
    assert (assigned.input, assigned.output) == ("voltage-motor-arm", "position-motor-arm")


def test_a_log_of_one_mechanism_needs_no_columns_and_its_tests_begin_at_rest(tmp_path: Path) -> None:
    for recording in loaded(tmp_path, sysid()):
        assert (recording.input, recording.output) == ("voltage-motor-arm", "position-motor-arm")
        assert recording.starts_at_rest
        assert "starts-at-rest" in codes(recording.findings)


def test_what_was_noted_in_the_test_before_never_begins_the_next(tmp_path: Path) -> None:
    """The older JSON of SysId has just this fault, a first row with the voltage of the test before."""
    recordings = loaded(tmp_path, sysid())

    assert all("value-held" not in codes(each.findings) for each in recordings)
    assert recordings[3]["voltage-motor-arm"].values.max() < 0


def test_a_value_noted_between_the_tests_holds_at_the_start_of_the_next(tmp_path: Path) -> None:
    log = HEADER + start(1, "sysid-test-state-arm", "string") + start(2, "u") + start(3, "y")
    log += doubles(3, range(0, 9_000_000, 20_000), np.arange(450.0))
    log += double(2, 500_000, 0.0) + text(1, 1_000_000, "dynamic-forward") + double(2, 1_010_000, 7.0)
    log += text(1, 3_000_000, "none") + double(2, 3_005_000, 0.5) + text(1, 6_000_000, "dynamic-reverse")
    log += double(2, 6_004_000, -7.0) + text(1, 8_000_000, "none")

    forward, reverse = loaded(tmp_path, log)

    assert forward["u"].values.tolist() == [0.0, 7.0]
    assert forward["u"].t.tolist() == [1.0, 1.01]
    assert reverse["u"].values.tolist() == [0.5, -7.0]
    assert "`u`" in finding(reverse.findings, "value-held").sentence
    assert forward["y"].t.tolist() == [k / 50 for k in range(50, 150)]


def test_a_test_that_was_run_twice_is_two_and_mechanisms_are_told_apart(tmp_path: Path) -> None:
    log = (
        HEADER
        + start(1, "sysid-test-state-arm", "string")
        + start(2, "NT:/sysid-test-state-hood", "string")
        + start(3, "u")
    )
    log += doubles(3, range(0, 900, 10), np.arange(90.0))
    states = [
        (1, 100, "dynamic-forward"),
        (1, 200, "none"),
        (1, 300, "dynamic-forward"),
        (1, 400, "dynamic-reverse"),
    ]
    log += b"".join(
        text(*each) for each in [*states, (1, 500, "none"), (2, 600, "dynamic-forward"), (2, 700, "none")]
    )

    names = [each.name for each in loaded(tmp_path, log)]

    assert names == [
        "arm dynamic-forward",
        "arm dynamic-forward 2",
        "arm dynamic-reverse",
        "hood dynamic-forward",
    ]


def test_a_text_that_says_anything_else_splits_nothing(tmp_path: Path) -> None:
    log = HEADER + start(1, "state", "string") + start(3, "u") + doubles(3, [1, 2], [1.0, 2.0])

    assert len(loaded(tmp_path, log + text(1, 0, "dynamic-forward") + text(1, 1, "dynamic-sideways"))) == 1
    assert len(loaded(tmp_path, log + text(1, 0, "none"))) == 1
    assert len(loaded(tmp_path, log + text(1, 0, "dynamic-forward"))) == 1  # and this is one test, to the end
    assert loaded(tmp_path, log + text(1, 0, "dynamic-forward"))[0].name == "dynamic-forward"


def test_a_log_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="aren't written"):
        save(small("a"), tmp_path / "a.wpilog")
