"""Bags of ROS 2 as SQLite files, and their folders, as rosbag2's recorder leaves them."""

import sqlite3
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mcap_ros2._dynamic import serialize_dynamic

from tests.recordings.formats.bags import JOINTS, START, joints, stamp

Written = tuple[str, str, str, dict[str, Any], int]
"""Topic, type, definition, content and time [ns] of a message."""

_TABLES = {
    "topics": "name TEXT, type TEXT, serialization_format TEXT, offered_qos_profiles TEXT",
    "messages": "topic_id INTEGER, timestamp INTEGER, data BLOB",
    "message_definitions": "topic_type TEXT, encoding TEXT, encoded_message_definition TEXT, type_description_hash TEXT",
}


def db3(path: Path, written: Sequence[Written], definitions: bool = True) -> None:
    """Write messages to an SQLite bag; without definitions as before Iron."""
    connection = sqlite3.connect(path)
    for table, columns in _TABLES.items():
        if definitions or table != "message_definitions":
            connection.execute(f"CREATE TABLE {table}(id INTEGER PRIMARY KEY, {columns})")
    numbers: dict[str, int] = {}
    known: set[str] = set()
    for topic, kind, definition, content, at in written:
        if topic not in numbers:
            numbers[topic] = len(numbers) + 1
            row = (numbers[topic], topic, kind, "cdr", "")
            connection.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", row)
        if definitions and kind not in known:
            known.add(kind)
            connection.execute(
                "INSERT INTO message_definitions VALUES (NULL, ?, 'ros2msg', ?, '')", (kind, definition)
            )
        data = serialize_dynamic(kind, definition)[kind](content)
        connection.execute("INSERT INTO messages VALUES (NULL, ?, ?, ?)", (numbers[topic], at, data))
    connection.commit()
    connection.close()


def arm(begin: int, count: int, topic: str = "/arm/joint_states") -> list[Written]:
    """Joints' states and voltages, from one number to another."""
    found: list[Written] = []
    for k in range(begin, begin + count):
        at = START + 10_000_000 * k
        state = {"header": stamp(at), **joints(["shoulder", "elbow"], k)}
        found.append((topic, "sensor_msgs/msg/JointState", JOINTS, state, at + 1_000_000))
        found.append(("/arm/voltage", "std_msgs/msg/Float64", "float64 data\n", {"data": 0.5 * k}, at))
    return found


def metadata(folder: Path, names: Sequence[str], more: Mapping[str, str] | None = None) -> None:
    """Write metadata.yaml as rosbag2 does, with the parts that matter."""
    lines = ["rosbag2_bagfile_information:", "  version: 5", "  storage_identifier: sqlite3"]
    lines += ["  relative_file_paths:", *(f"    - {name}" for name in names)]
    lines += ["  duration:", "    nanoseconds: 200000000", "  topics_with_message_count:"]
    lines += ["    - topic_metadata:", "        name: /arm/joint_states", "      message_count: 20"]
    lines += [f"  {key}: {value}" for key, value in (more or {}).items()]
    (folder / "metadata.yaml").write_text("\n".join(lines) + "\n")
