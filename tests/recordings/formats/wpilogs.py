"""WPILib data logs, put together record by record as the specification has them."""

import struct
from collections.abc import Sequence

import numpy as np

HEADER = bytes.fromhex("57 50 49 4c 4f 47 00 01 00 00 00 00")  # the specification's own example


def _bytes(number: int) -> bytes:
    """A whole number in as few bytes as it takes; a negative one in eight."""
    if number < 0:
        return struct.pack("<q", number)
    return number.to_bytes(max(1, (number.bit_length() + 7) // 8), "little")


def record(entry: int, stamp: int, payload: bytes) -> bytes:
    """A record whose head is as short as its numbers allow, as WPILib's writer makes it."""
    parts = [_bytes(entry), _bytes(len(payload)), _bytes(stamp)]
    lengths = [len(part) - 1 for part in parts]
    return bytes([lengths[0] | lengths[1] << 2 | lengths[2] << 4]) + b"".join(parts) + payload


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def start(entry: int, name: str, kind: str = "double", metadata: str = "", stamp: int = 0) -> bytes:
    return record(0, stamp, struct.pack("<BI", 0, entry) + _text(name) + _text(kind) + _text(metadata))


def finish(entry: int, stamp: int = 0) -> bytes:
    return record(0, stamp, struct.pack("<BI", 1, entry))


def about(entry: int, metadata: str, stamp: int = 0) -> bytes:
    return record(0, stamp, struct.pack("<BI", 2, entry) + _text(metadata))


def double(entry: int, stamp: int, value: float) -> bytes:
    return record(entry, stamp, struct.pack("<d", value))


def doubles(entry: int, stamps: Sequence[int], values: Sequence[float]) -> bytes:
    return b"".join(double(entry, stamp, value) for stamp, value in zip(stamps, values, strict=True))


def text(entry: int, stamp: int, value: str) -> bytes:
    return record(entry, stamp, value.encode())


def robot() -> bytes:
    """A log with an entry of each type, in NetworkTables' manner."""
    random = np.random.default_rng(3)
    log = HEADER + start(1, "NT:/arm/voltage", metadata='{"source":"NT"}') + start(2, "NT:/arm/position_rad")
    log += start(3, "count", "int64") + start(4, "on", "boolean") + start(5, "pose", "double[]")
    log += start(6, "messages", "string") + start(7, "schema", "structschema") + start(8, "f", "float")
    for k in range(60):
        stamp = 20_000 * k + int(random.integers(0, 300))
        log += double(1, stamp, round(float(random.normal()), 2)) + double(2, stamp + 40, 0.01 * k)
        log += record(3, stamp, struct.pack("<q", k)) + record(4, stamp, bytes([k % 2]))
        log += record(5, stamp, struct.pack("<3d", k, 2 * k, 3 * k)) + text(6, stamp, f"loop {k}")
        log += record(7, stamp, b"\1\2\3") + record(8, stamp, struct.pack("<f", k / 4))
    return log + finish(8)


STATES = ("quasistatic-forward", "quasistatic-reverse", "dynamic-forward", "dynamic-reverse")


def sysid(loops: int = 40, step: int = 20_000) -> bytes:
    """A log of SysId: in each loop of a test its measurements and then its state, between tests nothing."""
    log = HEADER + start(1, "sysid-test-state-arm", "string") + start(2, "voltage-motor-arm", metadata="Volt")
    log += start(3, "position-motor-arm", metadata="Rotation")
    log += start(4, "velocity-motor-arm", metadata="Rotation per Second")
    stamp = 5_000_000
    for state in STATES:
        sign = 1.0 if state.endswith("forward") else -1.0
        for k in range(loops):
            volts = sign * (7.0 if state.startswith("dynamic") else 0.02 * k)
            log += (
                double(2, stamp, volts)
                + double(3, stamp + 10, sign * k / 50)
                + double(4, stamp + 20, sign * k / 5)
            )
            log += text(1, stamp + 60, state)
            stamp += step
        log += text(1, stamp, "none")
        stamp += 2_000_000
    return log
