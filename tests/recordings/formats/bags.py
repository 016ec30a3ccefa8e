"""MCAP files as ROS 2 and Foxglove write them, by the libraries of theirs."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer
from mcap_ros2.writer import Writer as RosWriter

HEADER = "std_msgs/Header header\n"
STAMP = """================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
JOINTS = f"{HEADER}string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n{STAMP}"
ARRAY = """float64[] data
"""
START = 1_700_000_000_000_000_000  # ns


def stamp(nanoseconds: int) -> dict[str, Any]:
    return {"stamp": {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}, "frame_id": "base"}


def joints(names: list[str], k: int) -> dict[str, Any]:
    values = [k + 0.1 * i for i in range(len(names))]
    return {"name": names, "position": values, "velocity": [10 * v for v in values], "effort": []}


def bag(path: Path, count: int = 20, **options: Any) -> None:
    """A bag with joints that have stamps, a command without, and what can't be read."""
    with path.open("wb") as file:
        writer = RosWriter(file, **options)
        of_joints = writer.register_msgdef("sensor_msgs/msg/JointState", JOINTS)
        of_number = writer.register_msgdef("std_msgs/msg/Float64", "float64 data\n")
        of_text = writer.register_msgdef("std_msgs/msg/String", "string data\n")
        of_array = writer.register_msgdef("std_msgs/msg/Float64MultiArray", ARRAY)
        for k in range(count):
            at = START + 10_000_000 * k
            state = {"header": stamp(at - 2_000_000), **joints(["left", "right"], k)}
            writer.write_message("/joint_states", of_joints, state, at, at)
            writer.write_message("/motor/voltage", of_number, {"data": float(np.sin(k))}, at + 500_000, at)
            writer.write_message("/log", of_text, {"data": "hello"}, at, at)
            writer.write_message("/both", of_array, {"data": [1.0 * k, 2.0 * k]}, at, at)
            writer.write_message("/scan", of_array, {"data": [0.0] * 500}, at, at)
        writer.finish()


def of_json(
    path: Path,
    contents: list[dict[str, Any]],
    compression: CompressionType = CompressionType.ZSTD,
    topic: str = "/state",
) -> None:
    with path.open("wb") as file:
        writer = Writer(file, compression=compression)
        writer.start(profile="", library="somebody 1.0")
        schema = writer.register_schema("any", "jsonschema", b"{}")
        channel = writer.register_channel(topic, "json", schema)
        other = writer.register_channel("/image", "protobuf", schema)
        for k, content in enumerate(contents):
            at = START + 10_000_000 * k
            writer.add_message(channel, at, json.dumps(content).encode(), at)
            writer.add_message(other, at, b"\1\2", at)
        writer.finish()
