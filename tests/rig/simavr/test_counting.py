"""The encoder: counted exactly as fast as promised, across the wraps of both counters, and by each of the 16 transitions."""

import ctypes as c
import itertools

import pytest

from tests.rig.simavr import build
from tests.rig.simavr.board import MODES, Board, motor

FAST = motor(step=20)
WRAP = 2**31


def check_count(rate: int, seconds: float) -> None:
    """Count forth and back at that rate while samples come at 1 kHz and commands at 500 Hz."""
    with Board(around=FAST) as board:
        board.enable()
        board.ask("sampling", period=1, block=0)
        there = round(rate * seconds)
        for edges in (there, -2 * there):
            board.move_encoder(rate, edges)
            k = 0
            while board.edges_left():
                board.send("duty", duty=(-1) ** k * 50)
                board.run(ms=2)
                k += 1
        board.run(ms=3)
        samples = [values for message, values in board.heard if message.name == "sample"]
        status = board.status()
        assert status["position"] == board.look().edges == -there
        assert status["encoder_errors"] == status["ticks_lost"] == status["tx_lost"] == status["rx_lost"] == 0
        assert status["crc_bad"] == status["received_gaps"] == board.sequence_gaps == board.damaged == 0
        assert [each["index"] for each in samples] == list(range(len(samples)))
        assert len(samples) >= 3000 * seconds
        most = max(abs(b["position"] - a["position"]) for a, b in itertools.pairwise(samples))
        # An edge may come on either side of a sample; the latch may be an interrupt late.
        assert most <= rate / 1000 + 2


def test_counts_are_exact_at_100_000_a_second_while_samples_come_at_1_khz() -> None:
    check_count(100_000, 0.5)


@pytest.mark.long
def test_counts_are_exact_at_125_000_a_second_for_ten_seconds() -> None:
    check_count(125_000, 10.0)


@pytest.mark.parametrize("direction", [1, -1])
def test_the_position_wraps_at_32_bits_either_way_and_the_counter_at_16(direction: int) -> None:
    with Board(around=FAST) as board:
        board.claim()
        start = direction * (WRAP - 40_000) - (direction < 0)
        assert board.ask("set_position", position=start)["position"] == start
        board.move_encoder(100_000, direction * 80_000)
        board.run(ms=805)
        expected = (start + direction * 80_000 + WRAP) % 2**32 - WRAP
        assert board.status()["position"] == expected
        assert (expected > 0) == (direction < 0)


@pytest.mark.parametrize("step", [1, 7, 32767, -1, -7, -32768])
def test_the_counter_is_extended_exactly_over_a_thousand_million_counts_either_way(step: int) -> None:
    library = c.CDLL(str(build.pure()))
    library.pure_extend.restype = c.c_int32
    library.pure_extend.argtypes = [c.c_int32, c.c_int16, c.c_uint32]
    times = 10**9 // abs(step)
    for start in (0, 5, -70_000):
        assert library.pure_extend(start, step, times) == start + step * times


def test_each_transition_of_the_encoder_is_counted_by_its_kind() -> None:
    with Board(around=FAST) as board:
        board.move_encoder(1000, 8)  # all eight single steps forward ...
        board.run(ms=10)
        assert board.status()["position"] == 8
        board.move_encoder(1000, -9)  # ... and backward
        board.run(ms=12)
        assert board.status()["position"] == -1
        for place in range(4):  # and the four double ones
            board.disturb()
            board.run(ms=1)
            board.disturb()
            board.run(ms=1)
            status = board.status()
            assert status["position"] == place - 1
            assert status["encoder_errors"] == 2 * (place + 1)
            board.move_encoder(1000, 1)
            board.run(ms=3)


def test_a_stuck_channel_makes_no_illegal_transition_so_that_only_a_model_can_see_it() -> None:
    with Board() as board:
        board.enable(*MODES.keys() & {"direct"})
        board.duty(512, ms=200)
        before = board.status()["position"]
        board.stick(1)
        true = board.look().edges
        board.duty(512, ms=100)
        status = board.status()
        assert status["encoder_errors"] == 0
        assert abs(status["position"] - before) < 100
        assert board.look().edges - true > 3000
