"""Every row that a source gets arrives: a pseudo-terminal, a socket, a growing file and a NetworkTables server."""

import errno
import os
import socket
import threading
from itertools import count
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.recordings.streams.base import STREAMS, Stream, stream_of
from servobench.recordings.streams.file import GrowingFile
from servobench.recordings.streams.networktables import NetworkTables
from servobench.recordings.streams.serial import SerialPort
from servobench.recordings.streams.udp import Udp
from tests.recordings.streams.robot import robot

ROWS = 10_000  # ten seconds at 1 kHz
LOOKS = 100  # of a tenth of a second: the patience of a test on a busy machine


def all_rows(stream: Stream, count: int) -> Array:
    """The rows of a stream until there are so many, or it ends, or too many looks found nothing."""
    found: list[Array] = []
    for _ in range(LOOKS + count):
        rows = stream.read(0.1)
        if rows is None:
            break
        assert rows.damaged == 0, rows.example
        found += [rows.values] if len(rows.values) else []
        if sum(map(len, found)) >= count:
            break
    return np.concatenate(found)


def lines(count: int) -> bytes:
    return b"".join(b"%d,1.5,%d\r\n" % (1000 * k, 7 * k) for k in range(count))


@pytest.mark.skipif(os.name != "posix", reason="a pseudo-terminal")
def test_all_lines_at_1_khz_arrive_over_a_pseudo_terminal() -> None:
    board, port = os.openpty()
    with SerialPort(os.ttyname(port)) as stream:

        def write() -> None:
            rest = b"t_us,u,counts\r\n" + lines(ROWS)
            while rest:
                rest = rest[os.write(board, rest) :]

        writer = threading.Thread(target=write)
        writer.start()
        rows = all_rows(stream, ROWS)
        writer.join()
    os.close(board)
    os.close(port)

    assert rows[:, 2].tolist() == [7.0 * k for k in range(ROWS)]


@pytest.mark.skipif(os.name != "posix", reason="a pseudo-terminal")
def test_a_board_loses_nothing_while_its_rows_are_being_worked_on() -> None:
    # A port holds 4 kB, a fifth of a second at 1 kHz; compiling the kernels at the first rows takes much longer.
    board, port = os.openpty()
    with SerialPort(os.ttyname(port)) as stream:
        written = b"t_us,u,counts\r\n" + lines(ROWS)
        writer = threading.Thread(target=lambda: os.write(board, written), daemon=True)
        writer.start()
        writer.join(30)  # nobody reads the stream meanwhile
        assert not writer.is_alive()
        rows = all_rows(stream, ROWS)
    os.close(board)
    os.close(port)

    assert len(rows) == ROWS


@pytest.mark.skipif(os.name != "posix", reason="a pseudo-terminal")
def test_a_port_that_is_gone_ends_the_stream() -> None:
    board, port = os.openpty()
    with SerialPort(os.ttyname(port)) as stream:
        os.close(port)
        os.close(board)

        assert stream.read(0.1) is None


def test_datagrams_bring_lines() -> None:
    with Udp("127.0.0.1:0") as stream, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as board:
        board.sendto(b"t,u,counts", ("127.0.0.1", stream.port))
        found = []
        for k in range(300):
            board.sendto(b"%d,1.5,%d" % (k, 7 * k), ("127.0.0.1", stream.port))
            if k % 50 == 49:
                found.append(all_rows(stream, 50))

    assert np.concatenate(found)[:, 2].tolist() == [7.0 * k for k in range(300)]


def test_a_file_is_read_from_its_beginning_and_as_it_grows(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(b"t,u,counts\n0,1,0\n1,1,")
    with GrowingFile(str(path)) as stream:
        assert all_rows(stream, 1).tolist() == [[0.0, 1.0, 0.0]]
        with path.open("ab") as file:
            file.write(b"7\n2,1,14\n")
        assert all_rows(stream, 2).tolist() == [[1.0, 1.0, 7.0], [2.0, 1.0, 14.0]]
        path.write_bytes(b"0,1,5\n")  # its program began again
        assert all_rows(stream, 1).tolist() == [[0.0, 1.0, 5.0]]


def test_another_file_of_the_same_name_is_read_from_its_beginning(tmp_path: Path) -> None:
    """As where logs are rotated, even if the new one is longer than what was read of the old."""
    log = tmp_path / "log.csv"
    log.write_bytes(lines(50))
    with GrowingFile(str(log), sleep=lambda _: None) as stream:
        assert len(all_rows(stream, 50)) == 50
        log.rename(tmp_path / "log.old")
        log.write_bytes(lines(80))
        assert len(all_rows(stream, 80)) == 80


def test_all_values_of_a_robot_arrive_with_the_times_of_its_server() -> None:
    t = 0.02 * np.arange(1000)
    with robot() as server, NetworkTables(f"127.0.0.1:{server.port}/drive/voltage,/drive/position") as stream:
        server.await_listener(stream)
        server.publish(t, np.sin(t), 3 * t)
        rows = all_rows(stream, len(t))

    # The stamps are whole microseconds, so a time is off by half of one at most.
    np.testing.assert_allclose(rows[:, 0], 1.0 + t, atol=6e-7)
    np.testing.assert_array_equal(rows[:, 1], np.sin(t))
    np.testing.assert_array_equal(rows[:, 2], 3 * t)


class Queue:
    """A topic's values at one look after the other, as (time [s], value)."""

    def __init__(self, *looks: list[tuple[float, float]]) -> None:
        self._looks = list(looks)

    def readQueue(self) -> list[SimpleNamespace]:
        found = self._looks.pop(0) if self._looks else []
        return [SimpleNamespace(serverTime=1e6 * t, value=value) for t, value in found]


def test_values_that_the_network_brings_late_belong_to_the_row_of_their_time() -> None:
    looks = count()
    stream = NetworkTables("robot/drive/voltage,/drive/position", now=lambda: 0.02 * next(looks))
    voltages = Queue([(0.0, 1.0)], [(0.02, 2.0), (0.04, 3.0)])
    positions = Queue([(0.0, 10.0), (0.02, 11.0), (0.04, 12.0)])
    stream._subscribers = [voltages, positions]
    rows = [stream._rows() for _ in range(20)]

    assert np.concatenate(rows).tolist() == [[0.0, 1.0, 10.0], [0.02, 2.0, 11.0], [0.04, 3.0, 12.0]]


def test_after_a_pause_of_the_network_positions_wait_for_voltages_however_far_they_are_ahead() -> None:
    looks = count()
    stream = NetworkTables("robot/drive/voltage,/drive/position", now=lambda: 0.02 * next(looks))
    times = 0.02 * np.arange(50)  # a second at once; the voltages come a look later
    voltages = Queue([(0.0, 0.0)], [(t, t) for t in times[1:].tolist()])
    stream._subscribers = [voltages, Queue([(t, 3 * t) for t in times.tolist()])]

    rows = np.concatenate([stream._rows() for _ in range(20)])

    np.testing.assert_allclose(rows, np.column_stack([times, times, 3 * times]), rtol=1e-12, atol=0.0)


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("nowhere.csv", "isn't a source of rows"),
        ("udp:many", "isn't a port"),
        ("udp:70000", "isn't a port"),
        ("serial:", "isn't a port"),
        ("networktables:10.0.0.2/drive/position", "the position last"),
        ("standard_input:x", "write - alone"),
    ],
)
def test_a_source_that_cannot_be_is_refused(source: str, expected: str) -> None:
    with pytest.raises(UsageError, match=expected):
        stream_of(source)


def test_a_port_that_is_not_there_is_a_sentence() -> None:
    with (
        pytest.raises(UsageError, match=r"/dev/no_such_port can't be opened \(No such file or directory\)"),
        SerialPort("/dev/no_such_port"),
    ):
        pass


def test_a_port_that_one_may_not_use_says_how_one_may(monkeypatch: pytest.MonkeyPatch) -> None:
    import serial

    def refuse(*_: object, **__: object) -> None:
        raise serial.SerialException(errno.EACCES, "could not open port")

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(UsageError, match=r"\(Permission denied\): .*dialout"), SerialPort("/dev/ttyACM0"):
        pass


@pytest.mark.skipif(os.name != "posix", reason="a pseudo-terminal")
def test_a_port_that_another_program_has_is_said_to_be_so() -> None:
    board, port = os.openpty()
    with (
        SerialPort(os.ttyname(port)),
        pytest.raises(UsageError, match=r"can't be opened \(another program is using it\)"),
        SerialPort(os.ttyname(port)),
    ):
        pass
    os.close(board)
    os.close(port)


def test_no_stream_has_a_way_to_drive_a_motor() -> None:
    for member in STREAMS:
        assert not {"write", "send", "publish"} & set(dir(member))
