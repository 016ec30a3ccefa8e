"""Frames on a serial line: a payload with its checksum in consistent-overhead byte stuffing, ended by a zero byte.

COBS: Cheshire and Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Transactions on Networking 7 (1999). The checksum is
CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, not reflected; appended low byte first. What may drive the motor has a second
one inside the payload: CRC-16/T10-DIF, polynomial 0x8BB7, start 0.
"""

from __future__ import annotations

_LONGEST_RUN = 0xFE  # bytes without a zero that one code byte can stand before


def _remainder(polynomial: int, byte: int) -> int:
    value = byte << 8
    for _ in range(8):
        value = (value << 1 ^ polynomial if value & 0x8000 else value << 1) & 0xFFFF
    return value


_CCITT, _T10_DIF = (tuple(_remainder(each, byte) for byte in range(256)) for each in (0x1021, 0x8BB7))


def crc16(data: bytes) -> int:
    """Return the checksum of a frame's bytes.

    >>> hex(crc16(b"123456789"))
    '0x29b1'
    """
    return _checksum(_CCITT, 0xFFFF, data)


def check16(data: bytes) -> int:
    """Return the second checksum of some bytes.

    >>> hex(check16(b"123456789"))
    '0xd0db'
    """
    return _checksum(_T10_DIF, 0, data)


def _checksum(table: tuple[int, ...], value: int, data: bytes) -> int:
    for byte in data:
        value = (value << 8 ^ table[value >> 8 ^ byte]) & 0xFFFF
    return value


def encode(payload: bytes) -> bytes:
    """Return the frame of a payload, its ending zero included.

    >>> encode(b"a").hex(" ")
    '04 61 77 9d 00'
    """
    data = payload + crc16(payload).to_bytes(2, "little")
    frame = bytearray()
    for run in data.split(b"\0"):
        while len(run) >= _LONGEST_RUN:
            frame += b"\xff" + run[:_LONGEST_RUN]
            run = run[_LONGEST_RUN:]
        frame += bytes([len(run) + 1]) + run
    return bytes(frame) + b"\0"


def decode(frame: bytes) -> bytes | None:
    """Return the payload of a frame without its ending zero; None where it is damaged.

    >>> decode(encode(b"a")[:-1])
    b'a'
    """
    data = bytearray()
    place = 0
    while place < len(frame):
        code = frame[place]
        run = frame[place + 1 : place + code]
        if code == 0 or len(run) != code - 1:
            return None
        data += run
        place += code
        if code <= _LONGEST_RUN and place < len(frame):
            data.append(0)
    if len(data) < 3 or crc16(bytes(data[:-2])) != int.from_bytes(data[-2:], "little"):
        return None
    return bytes(data[:-2])


class Reader:
    """Cuts a stream of bytes into payloads, and counts what was damaged.

    >>> reader = Reader()
    >>> reader.feed(encode(b"ab")[:3]), reader.feed(encode(b"ab")[3:])
    ([], [b'ab'])
    """

    def __init__(self) -> None:
        self._rest = b""
        self.damaged = 0
        """Frames whose checksum or stuffing was wrong."""

    def feed(self, data: bytes) -> list[bytes]:
        """Return the payloads that end within these bytes."""
        *frames, self._rest = (self._rest + data).split(b"\0")
        payloads = [decode(frame) for frame in frames if frame]
        self.damaged += sum(payload is None for payload in payloads)
        return [payload for payload in payloads if payload is not None]
