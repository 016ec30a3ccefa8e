"""The messages in a bag of ROS 2 that is an SQLite file (`.db3`), with a decoder for each topic.

Bags since Iron contain the definitions of their messages; older bags are read for the message types defined here.
Source: ROS 2, rosbag2_storage_sqlite3; common_interfaces (std_msgs, sensor_msgs, geometry_msgs) for the definitions.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import quote

from servobench.core.errors import FormatError
from servobench.recordings.formats.mcap_messages import Message, Reading, Topic, cdr_decoder, import_library

MAGIC = b"SQLite format 3\x00"

_TIME = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
_HEADER = f"MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{'=' * 80}\n{_TIME}"
_LAYOUT = (
    "MSG: std_msgs/MultiArrayLayout\nstd_msgs/MultiArrayDimension[] dim\nuint32 data_offset\n"
    f"{'=' * 80}\nMSG: std_msgs/MultiArrayDimension\nstring label\nuint32 size\nuint32 stride\n"
)
_VECTOR = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
_TWIST = "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"


def _with(text: str, *parts: str) -> str:
    """A definition with those of its parts behind it, as bags have them."""
    return f"\n{'=' * 80}\n".join((text, *parts))


_KNOWN = {
    "sensor_msgs/msg/JointState": _with(
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n", _HEADER
    ),
    "geometry_msgs/msg/Twist": _with(_TWIST, _VECTOR),
    "geometry_msgs/msg/TwistStamped": _with(
        "std_msgs/Header header\ngeometry_msgs/Twist twist\n", _HEADER, f"MSG: geometry_msgs/Twist\n{_TWIST}", _VECTOR
    ),
    **{
        f"std_msgs/msg/{name}": f"{kind} data\n"
        for name, kind in {
            "Bool": "bool", "Float32": "float32", "Float64": "float64", "Int8": "int8", "Int16": "int16", "Int32": "int32",
            "Int64": "int64", "UInt8": "uint8", "UInt16": "uint16", "UInt32": "uint32", "UInt64": "uint64",
        }.items()
    },
    **{
        f"std_msgs/msg/{name}MultiArray": _with(f"std_msgs/MultiArrayLayout layout\n{kind}[] data\n", _LAYOUT)
        for name, kind in {"Float32": "float32", "Float64": "float64", "Int32": "int32", "Int64": "int64"}.items()
    },
}  # fmt: skip


def messages(path: Path, reading: Reading) -> Iterator[Message]:
    """Yield the messages in a file by their times, as far as it is whole; `reading` says afterwards what it has and lacks.

    Raises `FormatError` where it is no bag, or the libraries aren't installed.
    """
    import_library()
    # Opened as it stands: nothing is written, not even the journal of a robot that lost its power.
    connection = sqlite3.connect(f"file:{quote(str(path.resolve()))}?mode=ro&immutable=1", uri=True)
    try:
        try:
            reading.topics.update(_topics(connection))
        except (sqlite3.Error, TypeError, ValueError) as error:
            raise FormatError(
                f"{path.name} is an SQLite file, but not a readable ROS 2 bag: {error}"
            ) from None
        try:
            rows = connection.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id")
            for topic, stamp, data in rows:
                if topic in reading.topics and isinstance(stamp, int) and isinstance(data, bytes):
                    yield Message(topic=reading.topics[topic], log_time=stamp, data=data)
        except sqlite3.Error as error:
            reading.damage = str(error)
    finally:
        connection.close()


def _topics(connection: sqlite3.Connection) -> dict[int, Topic]:
    """The topics by number, each with its decoder or the reason why it has none."""
    tables = {row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    stored: dict[str, tuple[str, str]] = {}
    if "message_definitions" in tables:
        rows = connection.execute(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        )
        stored = {str(kind): (str(encoding), str(text)) for kind, encoding, text in rows}
    topics = {}
    for number, name, kind, encoding in connection.execute(
        "SELECT id, name, type, serialization_format FROM topics"
    ):
        how, text = stored.get(kind, ("ros2msg", _KNOWN.get(kind, "")))
        if encoding != "cdr":
            decoder, why = None, f"encoded as {encoding}"
        elif not text:
            decoder, why = (
                None,
                f"its definition {kind} isn't in the file: convert the bag to mcap with `ros2 bag convert`",
            )
        else:
            decoder, why = cdr_decoder(str(kind), how, text.encode())
        topics[int(number)] = Topic(name=str(name), schema=str(kind), decoder=decoder, why_not=why)
    return topics
