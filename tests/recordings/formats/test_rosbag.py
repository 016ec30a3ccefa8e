"""MCAP files of others, written by the libraries of ROS 2 and Foxglove."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer as RosWriter

from servobench.core.errors import FormatError
from servobench.recordings.formats import rosbag
from servobench.recordings.formats.base import load
from servobench.recordings.formats.mapping import assign
from servobench.recordings.recording import Recording
from tests.recordings.formats.bags import JOINTS, START, bag, joints, of_json, stamp
from tests.recordings.formats.tables import codes, finding


def loaded(path: Path) -> Recording:
    (recording,) = load(path)
    return recording


@pytest.mark.parametrize("compression", list(CompressionType))
def test_joints_are_channels_by_their_names_and_times_are_those_of_their_headers(
    compression: CompressionType, tmp_path: Path
) -> None:
    path = tmp_path / "a.mcap"
    bag(path, compression=compression)

    recording = loaded(path)

    names = ["left.position", "right.position", "left.velocity", "right.velocity"]
    assert [each.channel.name for each in recording.series][:4] == names
    assert recording["right.position"].values.tolist() == [k + 0.1 for k in range(20)]
    assert recording["right.velocity"].values.tolist() == [10 * (k + 0.1) for k in range(20)]
    assert recording["left.position"].channel.unit == "rad"
    assert recording["left.velocity"].channel.unit == "rad/s"
    assert recording.source.format == "rosbag"
    # The first stamp of the joints is the earliest time of all; their messages were logged 2 ms after it.
    assert recording["left.position"].t.tolist() == [k / 100 for k in range(20)]
    assert np.allclose(recording["/motor/voltage.data"].t, 0.0025 + 0.01 * np.arange(20), rtol=0, atol=1e-12)
    assert recording["/both.data_2"].values.tolist() == [2.0 * k for k in range(20)]
    told = ["topic-skipped", "time-origin", "joint-units", "time-logged"]
    assert codes(recording.findings) == told
    assert "2023-11-14" in finding(recording.findings, "time-origin").sentence
    skipped = finding(recording.findings, "topic-skipped").sentence
    assert "`/log (no numbers)`" in skipped
    assert "`/scan (lists of more than 100 numbers)`" in skipped
    assert "`/motor/voltage`" in finding(recording.findings, "time-logged").sentence


def test_a_joint_and_a_topic_become_output_and_input(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    bag(path)

    assigned = assign(loaded(path), input="/motor/voltage.data:V", output="left.position")

    assert (assigned.input, assigned.output) == ("/motor/voltage.data", "left.position")


def ros(path: Path, messages: list[tuple[str, dict[str, Any], int]]) -> Recording:
    """Write joints' states on topics, each with the time at which it is logged."""
    with path.open("wb") as file:
        writer = RosWriter(file)
        schema = writer.register_msgdef("sensor_msgs/msg/JointState", JOINTS)
        for topic, message, at in messages:
            writer.write_message(topic, schema, message, at, at)
        writer.finish()
    return loaded(path)


def test_a_topic_with_one_message_without_a_stamp_has_the_times_of_the_log(tmp_path: Path) -> None:
    messages = [
        ("/j", {"header": stamp(START + k if k else 0), **joints(["a"], k)}, START + 7 * k) for k in range(4)
    ]

    recording = ros(tmp_path / "a.mcap", messages)

    assert np.allclose(recording["a.position"].t, [0, 7e-9, 14e-9, 21e-9], rtol=0, atol=1e-15)
    assert "`/j`" in finding(recording.findings, "time-logged").sentence


def test_joints_of_two_topics_are_told_apart_and_those_in_some_messages_only_have_their_own_times(
    tmp_path: Path,
) -> None:
    messages = [
        (
            f"/{arm}/j",
            {"header": stamp(START + 10**8 * k), **joints(["a", "b"] if k % 2 else ["a"], k)},
            START,
        )
        for k in range(4)
        for arm in ("left", "right")
    ]

    recording = ros(tmp_path / "a.mcap", messages)

    assert "/left/j.a.position" in recording
    assert recording["/right/j.b.position"].t.tolist() == [0.1, 0.3]


def test_stamps_out_of_order_are_sorted(tmp_path: Path) -> None:
    order = [0, 2, 1, 3]
    messages = [
        ("/j", {"header": stamp(START + 10**8 * k), **joints(["a"], k)}, START + n)
        for n, k in enumerate(order)
    ]

    recording = ros(tmp_path / "a.mcap", messages)

    assert recording["a.position"].values.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert "time-sorted" in codes(recording.findings)


def test_two_clocks_in_one_file_are_a_warning(tmp_path: Path) -> None:
    messages = [
        ("/sim", {"header": stamp(10**7 * (k + 1)), **joints(["a"], k)}, START + 10**7 * k) for k in range(4)
    ]
    messages += [("/real", {"header": stamp(0), **joints(["b"], k)}, START + 10**7 * k) for k in range(4)]

    assert "clock-differs" in codes(ros(tmp_path / "a.mcap", messages).findings)


def test_json_messages_are_flattened(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    of_json(
        path, [{"motor": {"u": 1.5 * k, "on": True, "name": "x"}, "pose": [k, {"z": 2}]} for k in range(3)]
    )

    recording = loaded(path)

    values = {each.channel.name: each.values.tolist() for each in recording.series}
    assert values == {
        "/state.motor.u": [0.0, 1.5, 3.0], "/state.motor.on": [1.0] * 3, "/state.pose_1": [0.0, 1.0, 2.0],
        "/state.pose_2.z": [2.0] * 3,
    }  # fmt: skip
    assert "`/image (encoded as protobuf)`" in finding(recording.findings, "topic-skipped").sentence


def test_a_cut_bag_is_read_up_to_the_cut(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    bag(path, count=200, chunk_size=2000)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 3])

    recording = loaded(path)

    assert 10 < len(recording["left.position"].values) < 200
    assert "recording-cut-short" in codes(recording.findings)


def test_a_damaged_chunk_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    bag(path, count=50, chunk_size=2000)
    data = bytearray(path.read_bytes())
    second = data.index(b"zstd", data.index(b"zstd") + 1)  # the first chunk has the definitions
    data[second + 40] ^= 255
    path.write_bytes(data)

    assert "1 chunks" in finding(loaded(path).findings, "chunk-damaged").sentence


def test_more_than_is_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.mcap"
    bag(path)

    with monkeypatch.context() as patched:
        patched.setattr(rosbag, "MOST_NUMBERS", 50)
        with pytest.raises(FormatError, match="more than 50 numbers"):
            load(path)


def test_a_file_without_numbers_says_what_its_topics_are(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    of_json(path, [{"name": "x"}])

    with pytest.raises(FormatError, match=r"/state \(no numbers\)"):
        load(path)


def test_without_the_library_the_error_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.mcap"
    bag(path)
    monkeypatch.setitem(sys.modules, "mcap_ros2.decoder", None)

    with pytest.raises(FormatError, match=r"servobench\[ros2\]"):
        load(path)
