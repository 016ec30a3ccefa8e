"""The causes that remove the motor's voltage, by the shipped binary in simavr: asserted on the pin and on the shaft, in device
time.
"""

import random

import pytest

from servobench.rig.wire.frames import encode
from tests.rig.simavr.board import FAULTS, MODES, MS, OWNER, PROTOCOL, REFUSALS, STATES, Board, motor

HALF = 512


def silence_ms(board: Board) -> float:
    """Device time from the last byte that the host sent to the last moment at which the PWM pin was high [ms]."""
    view = board.look()
    return (int(view.pwm_high) - int(view.received)) / MS


def killed_after(ms: float, **settings: int) -> tuple[Board, float]:
    board = Board()
    with board:
        assert board.claim()["refusal"] == 0
        if settings:
            assert board.ask("configure", stall_duty=500, **settings)["refusal"] == 0
        assert board.ask("enable", mode=MODES["direct"])["refusal"] == 0
        board.duty(HALF, ms=ms)
        board.run(ms=600 if settings else 70)
        cut = silence_ms(board)
        speed = board.look().speed
        board.run(ms=100)
        view = board.look()
        assert not (view.enable)
        assert not (view.pwm)
        assert not (view.in1)
        assert not (view.in2)
        assert abs(view.speed) < abs(speed)
        state = board.status()
        assert state["state"] == STATES["fault"]
        assert state["faults"] == FAULTS["watchdog"]
    return board, cut


def check_kills(count: int, seed: int) -> None:
    """Kill the host at random moments while the motor turns, and hold the cut to its time, by device time."""
    drawn = random.Random(seed)
    for _ in range(count):
        _, cut = killed_after(drawn.uniform(20, 120))

        assert 48 <= cut <= 51


@pytest.mark.promise("S62")
def test_a_host_that_dies_leaves_the_motor_without_voltage_after_51_ms() -> None:
    check_kills(4, 1)


@pytest.mark.long
@pytest.mark.promise("S62")
def test_a_host_that_dies_leaves_the_motor_without_voltage_after_51_ms_in_100_of_100() -> None:
    check_kills(100, 2)


@pytest.mark.promise("S62")
@pytest.mark.parametrize("timeout", [20, 500])
def test_the_watchdog_s_time_can_be_set(timeout: int) -> None:
    _, cut = killed_after(30, watchdog_ms=timeout)

    assert timeout - 2 <= cut <= timeout + 1


def test_the_watchdog_can_not_be_switched_off() -> None:
    with Board() as board:
        board.claim()
        for timeout in (0, 19, 501, 65535):
            answer = board.ask("configure", watchdog_ms=timeout, stall_duty=500)
            assert answer["refusal"] == REFUSALS["value"]
            assert answer["watchdog_ms"] == 50


@pytest.mark.promise("S63")
def test_only_actuation_feeds_the_watchdog_and_what_it_did_lasts_until_it_is_cleared() -> None:
    with Board() as board:
        board.enable()
        board.send("duty", duty=HALF)
        board.run(ms=1)
        fed = board.look().cycle
        for _ in range(30):  # everything else that a host may say, and garbage
            board.send("hello", schema=PROTOCOL.schema)
            board.send("sampling", period=10, block=0)
            board.write(b"\x05garbage\0")
            board.run(ms=3)
        assert (board.look().pwm_high - fed) / MS <= 51

        board.duty(HALF, ms=30)
        assert board.look().duty == 0
        assert board.ask("enable", mode=MODES["direct"])["refusal"] == REFUSALS["state"]
        assert board.claim()["refusal"] == REFUSALS["state"]

        assert board.ask("clear")["state"] == STATES["switch_on_disabled"]
        assert board.ask("enable", mode=MODES["direct"])["refusal"] == REFUSALS["owner"]
        board.enable()
        board.duty(HALF, ms=5)
        assert board.look().duty == 0.5


def test_a_hung_main_loop_ends_in_a_reset_after_35_ms_although_the_host_talks_on() -> None:
    with Board("rig-test") as board:
        board.enable()
        board.duty(HALF, ms=100)
        board.write(encode(b"\x7f\x00"))
        hung = board.look().cycle
        for _ in range(30):
            board.send("duty", duty=HALF)
            board.run(ms=3)
        view = board.look()
        assert (view.pwm_high - hung) / MS <= 35
        assert not view.enable

        state = board.status()
        assert state["state"] == STATES["fault"]
        assert state["faults"] == FAULTS["hardware_watchdog"]
        assert state["reset_cause"] == PROTOCOL.codes["reset_causes"]["watchdog"]
        assert board.look().duty == 0


def test_a_replug_leaves_the_motor_alone_until_it_is_claimed_and_enabled_anew() -> None:
    with Board() as board:
        board.enable()
        board.duty(HALF, ms=50)
        board.reset()
        for _ in range(10):  # the old host goes on
            board.send("duty", duty=HALF)
            board.run(ms=5)
        view = board.look()
        assert view.duty == 0
        assert not view.enable
        assert board.status()["state"] == STATES["switch_on_disabled"]
        assert board.status()["owner"] == 0


@pytest.mark.promise("S64")
def test_a_stalled_shaft_is_reported_in_100_ms_and_cut_off_after_3_s() -> None:
    with Board() as board:
        board.block()
        board.enable()
        board.send("duty", duty=HALF)
        board.run(ms=1)
        begun = board.look().cycle
        board.duty(HALF, ms=100)
        assert board.heard[-1][1]["warnings"] == PROTOCOL.codes["warnings"]["stall"]
        board.duty(HALF, ms=3100)

        assert 2.9 <= (board.look().pwm_high - begun) / MS / 1000 <= 3.1
        assert board.status()["faults"] == FAULTS["stall"]


@pytest.mark.promise("S64")
def test_the_paper_s_square_wave_is_no_stall() -> None:
    with Board() as board:
        board.claim()
        board.ask("configure", watchdog_ms=50, stall_duty=60)  # 0.7 V of 12 V: far stricter than by default
        board.ask("enable", mode=MODES["direct"])
        for volts in (1, 3, 1, 3):
            board.duty(round(volts / 12 * 1024), ms=1250)
            assert board.status()["state"] == STATES["operation_enabled"]


@pytest.mark.parametrize(("burst", "fault"), [(4, False), (5, True)])
def test_more_than_four_illegal_transitions_in_a_tenth_of_a_second_are_a_fault(
    burst: int, fault: bool
) -> None:
    with Board() as board:
        board.block()
        board.enable()
        while board.status()["time"] % 100 > 20:  # well within a window
            board.duty(50, ms=5)
        for _ in range(burst):
            board.disturb()
            board.run(cycles=4000)
        board.duty(50, ms=100)
        status = board.status()
        assert status["encoder_errors"] == burst
        assert status["faults"] == (FAULTS["encoder"] if fault else 0)
        assert (board.look().duty == 0) == fault


@pytest.mark.promise("S65")
def test_nothing_but_the_owner_s_frames_moves_the_motor_and_anybody_may_stop_it() -> None:
    with Board() as board:
        board.enable()
        drawn = random.Random(3)
        for _ in range(50):
            board.send(
                "duty", owner=drawn.randrange(1, 1 << 16) ^ OWNER, duty=drawn.randrange(-1024, 1025) or 1
            )
            board.send("duty", duty=0)
            board.run(ms=2)
        assert board.look().pwm_rises == 0
        assert board.status()["refused"] == 50
        assert board.ask("claim", schema=PROTOCOL.schema, owner=77)["refusal"] == REFUSALS["state"]

        board.duty(HALF, ms=20)
        board.send("stop")
        sent = board.look().cycle
        board.run(ms=5)
        assert (board.look().pwm_high - sent) / MS < 2
        assert board.status()["state"] == STATES["ready"]

        assert board.ask("claim", schema=PROTOCOL.schema, owner=77)["owner"] == 77
        assert board.ask("enable", mode=MODES["direct"])["refusal"] == REFUSALS["owner"]


@pytest.mark.promise("S65")
def test_another_schema_is_refused_and_nothing_moves() -> None:
    with Board() as board:
        assert board.ask("claim", schema=PROTOCOL.schema ^ 1)["refusal"] == REFUSALS["schema"]
        assert board.ask("enable", mode=MODES["direct"])["refusal"] == REFUSALS["owner"]
        board.duty(HALF, ms=50)
        assert board.look().pwm_rises == 0


def test_a_duty_out_of_range_is_refused_and_the_last_one_stays() -> None:
    with Board() as board:
        board.enable()
        board.duty(100, ms=5)
        for wrong in (1025, -1025, 32767, -32768):
            board.duty(wrong, ms=2)
            assert board.look().duty == 100 / 1024


@pytest.mark.parametrize("duty", [1, -1, 512, -512, 1023, 1024, -1024])
def test_the_pin_carries_the_duty_and_zero_is_without_a_spike(duty: int) -> None:
    with Board(around=motor(coulomb=1.0, step=4)) as board:
        board.enable()
        board.duty(duty, ms=10)
        high, before = 0, board.look()
        begun = before.cycle
        while before.cycle - begun < 4 * 1024:  # four periods
            board.run(cycles=1)
            after = board.look()
            high += (after.cycle - before.cycle) * before.pwm
            before = after
        # An instruction takes up to 4 cycles, and an edge is seen after it.
        assert high == pytest.approx(4 * abs(duty), abs=4 * 4)
        assert board.look().duty == duty / 1024
        board.duty(0, ms=5)
        before = board.look()
        board.duty(0, ms=20)
        after = board.look()
        assert after.pwm_high == before.pwm_high
        assert after.enable


def test_two_runs_are_the_same_to_the_last_bit() -> None:
    def run() -> tuple[object, ...]:
        with Board() as board:
            board.enable()
            board.ask("sampling", period=1, block=0)
            for duty in (300, -400, 500):
                board.duty(duty, ms=40)
            view = board.look()
            return [values for _, values in board.heard], view.cycle, view.angle, view.speed

    assert run() == run()


def check_damage(frames: int, seed: int) -> None:
    """Send damaged frames while zero volts are due: no other duty may come out, and good ones pass between them."""
    with Board() as board:
        board.enable()
        drawn = random.Random(seed)
        for n in range(frames):
            good = encode(PROTOCOL.message("duty").pack(n & 0xFF, owner=OWNER, duty=700))
            frame = bytearray(good)
            for _ in range(drawn.randint(1, 4)):
                frame[drawn.randrange(len(frame))] ^= 1 << drawn.randrange(8)
            if frame == good:
                continue  # two flips of one bit
            if drawn.random() < 0.2:
                frame += drawn.randbytes(drawn.randrange(40)) + b"\0"
            board.write(bytes(frame))
            board.send("duty", duty=0)
            board.run(ms=1.5)
        assert board.look().pwm_rises == 0
        board.duty(HALF, ms=5)
        assert board.look().duty == 0.5  # within two frames it listens again
        assert board.status()["state"] == STATES["operation_enabled"]


def test_no_damaged_frame_drives_the_motor() -> None:
    check_damage(300, 4)


@pytest.mark.long
def test_no_damaged_frame_drives_the_motor_in_20_000() -> None:
    check_damage(20_000, 5)
