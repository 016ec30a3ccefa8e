"""ROS 2 bags as folders and as SQLite files, and messages that are like joints' states."""

import hashlib
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servobench.core.errors import FormatError, MissingInformation, UsageError
from servobench.recordings.formats.mapping import assign
from servobench.recordings.loading.load import load
from servobench.recordings.recording import Recording
from tests.recordings.formats.bags import HEADER, JOINTS, STAMP, START, bag, joints, stamp
from tests.recordings.formats.db3s import arm, db3, metadata
from tests.recordings.formats.tables import codes, finding


def loaded(path: Path) -> Recording:
    (recording,) = load(path)
    return recording


def holds_the_arm(recording: Recording, count: int) -> None:
    """Assert that a file holds what `arm` wrote: the positions by joint at their stamps, and the voltages at the times of the
    log.
    """
    position, voltage = recording["elbow.position"], recording["/arm/voltage.data"]
    assert position.values.tolist() == [k + 0.1 for k in range(count)]
    assert position.channel.unit == "rad"
    assert position.t is not None
    assert np.allclose(position.t, 0.01 * np.arange(count), rtol=0, atol=1e-12)
    assert voltage.values.tolist() == [0.5 * k for k in range(count)]


@pytest.mark.parametrize("definitions", [True, False], ids=["with definitions", "without"])
def test_an_sqlite_bag_is_read_with_its_definitions_or_with_those_that_are_known(
    definitions: bool, tmp_path: Path
) -> None:
    db3(tmp_path / "a.db3", arm(0, 20), definitions)

    recording = loaded(tmp_path / "a.db3")

    holds_the_arm(recording, 20)
    assert recording.source.format == "rosbag"
    assert recording.name == "a"


def test_a_folder_is_one_recording_of_all_its_files(tmp_path: Path) -> None:
    folder = tmp_path / "run_1"
    folder.mkdir()
    db3(folder / "run_1_0.db3", arm(0, 12))
    db3(folder / "run_1_1.db3", arm(12, 8))
    metadata(folder, ["run_1_0.db3", "run_1_1.db3"])

    recording = loaded(folder)

    holds_the_arm(recording, 20)
    assert recording.name == "run_1"
    files = [folder / name for name in ("metadata.yaml", "run_1_0.db3", "run_1_1.db3")]
    assert (
        recording.source.sha256 == hashlib.sha256(b"".join(each.read_bytes() for each in files)).hexdigest()
    )
    assert "format-by-content" not in codes(recording.findings)
    assert loaded(folder / "metadata.yaml").series == recording.series


def test_a_folder_of_mcap_files_is_read_too(tmp_path: Path) -> None:
    folder = tmp_path / "run_2"
    folder.mkdir()
    bag(folder / "run_2_0.mcap")
    metadata(folder, ["run_2_0.mcap"])

    assert loaded(folder)["right.position"].values.tolist() == [k + 0.1 for k in range(20)]


@pytest.mark.parametrize(
    ("names", "why"),
    [
        ([], "lists no file"),
        (["gone.db3"], "lacks its file gone.db3"),
        (["../../etc/passwd"], "lacks its file passwd"),
    ],
)
def test_a_folder_without_its_files_is_reported(names: list[str], why: str, tmp_path: Path) -> None:
    metadata(tmp_path, names)

    with pytest.raises(FormatError, match=why):
        load(tmp_path)


def test_a_folder_that_is_no_bag_and_a_database_that_is_none_are_reported(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"not a ROS 2 bag .it lacks metadata\.yaml"):
        load(tmp_path)
    for name in ("run1.csv", "run2.csv"):
        (tmp_path / name).write_text("t,u,y\n")
    with pytest.raises(
        UsageError, match=r"such as .*run1\.csv; several files of one motor are fitted jointly"
    ):
        load(tmp_path)
    connection = sqlite3.connect(tmp_path / "songs.db3")
    connection.execute("CREATE TABLE songs(name TEXT)")
    connection.commit()
    connection.close()
    with pytest.raises(FormatError, match="not a readable ROS 2 bag"):
        load(tmp_path / "songs.db3")
    (tmp_path / "half.db3").write_bytes(b"SQLite format 3\x00" + bytes(300))
    with pytest.raises(FormatError, match=r"half\.db3"):
        load(tmp_path / "half.db3")


def test_a_type_that_nobody_defines_is_named_and_the_rest_is_read(tmp_path: Path) -> None:
    odd = ("/odd", "my_msgs/msg/Odd", "float64 x\n", {"x": 1.0}, START)
    db3(tmp_path / "a.db3", [*arm(0, 20), odd], definitions=False)

    recording = loaded(tmp_path / "a.db3")

    holds_the_arm(recording, 20)
    assert "my_msgs/msg/Odd isn't in the file" in finding(recording.findings, "topic-skipped").sentence


STATE = (
    f"{HEADER}string[] joint_names\ntrajectory_msgs/Point desired\ntrajectory_msgs/Point actual\n{STAMP}"
    f"{'=' * 80}\nMSG: trajectory_msgs/Point\nfloat64[] positions\nfloat64[] velocities\n"
)


def test_a_controllers_state_is_read_by_joint_whatever_its_type_is_called(tmp_path: Path) -> None:
    def point(k: int) -> dict[str, Any]:
        return {"positions": [k + 0.0, k + 0.1], "velocities": [2.0 * k, 3.0 * k]}

    states = [
        ("/arm/state", "my_msgs/msg/State", STATE,
         {"header": stamp(START + 10**7 * k), "joint_names": ["shoulder", "elbow"], "desired": point(k + 1), "actual": point(k)},
         START + 10**7 * k)
        for k in range(10)
    ]  # fmt: skip
    db3(tmp_path / "a.db3", states)

    recording = loaded(tmp_path / "a.db3")

    assert recording["elbow.actual.position"].values.tolist() == [k + 0.1 for k in range(10)]
    assert recording["shoulder.desired.velocity"].values.tolist() == [2.0 * (k + 1) for k in range(10)]
    assert recording["elbow.actual.velocity"].channel.unit == "rad/s"


def test_joints_of_namespaces_are_told_apart_and_proposed(tmp_path: Path) -> None:
    both = [
        (f"/{side}/joint_states", "my_msgs/msg/Joints", JOINTS, {"header": stamp(START + 10**7 * k), **joints(["hip"], k)}, START)
        for k in range(10)
        for side in ("left", "right")
    ]  # fmt: skip
    db3(tmp_path / "a.db3", both)

    recording = loaded(tmp_path / "a.db3")

    assert "/left/joint_states.hip.position" in recording
    with pytest.raises(MissingInformation, match=r"output=/right/joint_states\.hip\.position"):
        assign(recording)


def test_the_joint_that_moves_and_the_topic_of_commands_are_proposed(tmp_path: Path) -> None:
    states, commands = [], []
    for k in range(10):
        at = START + 10**7 * k
        position = {"name": ["shoulder", "elbow"], "position": [0.1 * k, 0.5], "velocity": [], "effort": []}
        state = {"header": stamp(at), **position}
        states.append(("/arm/joint_states", "sensor_msgs/msg/JointState", JOINTS, state, at))
        commands.append(
            ("/arm/commands", "std_msgs/msg/Float64", "float64 data\n", {"data": float(k % 2)}, at)
        )
    db3(tmp_path / "a.db3", [*states, *commands])

    with pytest.raises(MissingInformation) as error:
        assign(loaded(tmp_path / "a.db3"))
    assert "(perhaps `/arm/commands.data`): say `input=/arm/commands.data:UNIT`" in str(error.value)
    # The joint that stands still isn't proposed.
    assert "`output=elbow" not in str(error.value)
