"""The device `rig` with the firmware in simavr, in lock-step: what a run of it gives, and how each of its faults is reported."""

import errno
import itertools
import os
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from servobench.core.errors import DeviceError, UsageError
from servobench.identification.identify import identify
from servobench.recordings.measurement.measure import measure
from servobench.rig.devices.base import RunEnded
from servobench.rig.devices.faulty import with_faults
from servobench.rig.devices.rig import FAULTS, GREETING_TIME, LATCH_TO_DUTY, Rig, RigSettings
from servobench.rig.experiment import Experiment, Limits
from servobench.rig.lost_device import DeviceLost
from servobench.rig.wire import conversation, serial_port
from servobench.rig.wire.frames import Reader
from servobench.rig.wire.messages import protocol
from servobench.systems.control.pid import Pid
from servobench.systems.signals.prbs import PRBS
from servobench.systems.signals.square import Square
from servobench.systems.signals.step import Step
from tests.rig.simavr.board import CYCLES, MS, Board, motor
from tests.rig.simavr.build import needed
from tests.rig.simavr.lockstep import Bench

pytestmark = pytest.mark.usefixtures("simavr")


@pytest.fixture(scope="module")
def simavr() -> None:
    needed()


@pytest.mark.parametrize(
    ("firmware", "sample_time"),
    [("rig-115200", 0.001), ("rig-500000", 0.002)],
    ids=["1 kHz at 115200 Bd", "500 Hz"],
)
def test_a_batch_gives_the_motor_back_without_a_gap(firmware: str, sample_time: float) -> None:
    bench = Bench(firmware=firmware)
    with bench.rig(baud=int(firmware[4:])) as rig:
        signal = PRBS(low=-3, high=3, bit_time=0.04)
        recording = bench.run(Experiment(signal=signal, duration=3, sample_time=sample_time), rig)
        status = bench.board.status()

    assert recording.stopped.reason == "finished"
    counts, applied = recording["counts"], recording["applied"].values
    assert np.allclose(np.diff(counts.t), sample_time, rtol=0, atol=1e-9)
    assert len(counts.values) == round(3 / sample_time)
    assert np.array_equal(applied, recording["commanded"].values)
    assert status["tx_lost"] == status["rx_lost"] == status["received_gaps"] == status["refused"] == 0
    result = identify(measure(recording), structure="first_order_coulomb")  # what the motor is
    truth = bench.board.motor.truth
    for name in ("gain", "time_constant", "coulomb_voltage"):
        estimate = result[name]
        # Twice the 95 % interval: 4 standard deviations.
        assert abs(truth[name] - estimate.value) < 2 * estimate.half_width, name


def test_the_delay_that_a_batch_states_is_the_firmware_s() -> None:
    """The encoder serves as a clock: a latched count says when it was latched, by the edges that simavr was given."""
    rate, duties = 29_370, [10 * k for k in range(1, 65)]
    with Board(around=motor(step=4)) as board:
        board.enable("table")
        for first in range(0, 64, 8):
            board.send("table", first=first, count=8, last=first == 56, duty=duties[first : first + 8])
            board.run(ms=2)
        begun = board.look().cycle
        board.move_encoder(rate, rate)
        board.send("sampling", period=2, block=1)
        changed = []
        for k, duty in enumerate(duties):
            if k % 8 == 0:
                board.send(
                    "table", first=64, count=0, last=1, duty=[0] * 8
                )  # so that the watchdog stays quiet
            while board.look().duty != duty / 1024:
                board.let_pass(0, cycles=4)
            changed.append((board.look().cycle - begun) / CYCLES)
        board.run(ms=5)
        blocks = [values for message, values in board.heard if message.name == "block"][:8]
    assert [duty for block in blocks for duty in block["duty"]] == duties
    latched = np.concatenate([block["position"] + np.cumsum([0, *block["delta"]]) for block in blocks]) / rate
    # The latch lies between that edge and the next one, half of their distance after it on average: over 64 phases of clock and
    # encoder to 34 us / sqrt(12 * 64) = 1.2 us.
    assert np.mean(changed - latched) - 0.5 / rate == pytest.approx(LATCH_TO_DUTY, abs=5e-6)


def test_a_position_loop_at_250_hz_has_no_gap_in_its_samples() -> None:
    bench = Bench()
    with bench.rig() as rig:
        experiment = Experiment(
            signal=Step(final=1.0), controller=Pid(kp=10, kd=0.1), duration=1, sample_time=0.004
        )
        recording = bench.run(experiment, rig)
        status = bench.board.status()

    assert recording.stopped.reason == "finished"
    assert np.allclose(np.diff(recording["counts"].t), 0.004, rtol=0, atol=1e-9)
    assert status["received_gaps"] == status["crc_bad"] == status["tx_lost"] == 0
    assert recording["counts"].values[-1] * 2 * np.pi / 2048 == pytest.approx(1, abs=0.05)


def test_the_run_of_a_guard_that_stops_early_ends_the_table_at_once() -> None:
    bench = Bench()
    with bench.rig() as rig:
        experiment = Experiment(signal=Square(low=1, high=3, frequency=0.4), duration=1)
        recording = bench.run(
            experiment, rig, watch=lambda progress: "enough" if progress.tick > 100 else None
        )
        bench.board.run(ms=5)

        assert recording.stopped.sentence == "enough"
        assert bench.board.look().enable == 0
        assert len(recording["counts"].values) < 200


def ended(break_it: Callable[[Bench], object], **settings: Any) -> tuple[Bench, str]:
    """Run until something breaks in the middle, and return the sentence with which the run ended."""
    bench = Bench(firmware="rig-test")
    with bench.rig(**settings) as rig:
        done = False

        def watch(progress: Any) -> None:
            nonlocal done
            if progress.tick > 100 and not done:
                done = True
                break_it(bench)

        experiment = Experiment(signal=Step(final=6.0), duration=5, limits=Limits(stall=None))
        try:
            recording = bench.run(experiment, rig, watch=watch)
        except DeviceLost as error:
            recording = error.recording
        assert len(recording["counts"].values) > 100
        bench.port.unplugged = False
        bench.board.run(ms=60)
        assert bench.board.look().enable == 0
        assert bench.board.look().duty == 0
        return bench, recording.stopped.sentence


def test_an_unplugged_board_loses_the_device_and_its_watchdog_stops_the_motor() -> None:
    _bench, sentence = ended(lambda bench: setattr(bench.port, "unplugged", True))

    assert "the port simavr is gone (Input/output error)" in sentence
    assert "cuts the motor off after 50 ms" in sentence


def test_a_board_that_restarts_is_reported_with_its_cause() -> None:
    _bench, sentence = ended(lambda bench: bench.board.reset())

    assert "the position is lost" in sentence


def test_a_board_whose_program_hung_is_reported_in_words() -> None:
    _bench, sentence = ended(lambda bench: bench.board.write(conversation.encode(b"\x7f\x00")))

    assert FAULTS["hardware_watchdog"] in sentence


@pytest.mark.parametrize("batch", [True, False])
def test_a_blocked_shaft_is_cut_off_by_the_board_and_ends_the_run(batch: bool) -> None:
    _bench, sentence = ended(lambda bench: bench.board.block(), batch=batch)

    assert FAULTS["stall"] in sentence


def test_a_host_that_comes_too_late_is_told_that_the_watchdog_tripped() -> None:
    _bench, sentence = ended(lambda bench: bench.board.let_pass(80))

    assert "its watchdog tripped: no voltage came for 50 ms" in sentence


def test_a_run_that_came_too_late_is_reported_from_one_that_the_bench_ended() -> None:
    assert "voltages-late" in codes_after(lambda bench: bench.board.let_pass(80))
    assert "voltages-late" not in codes_after(lambda bench: bench.board.block())


def codes_after(break_it: Callable[[Bench], object]) -> set[str]:
    """The findings of a run that ends by a fault, after something breaks in the middle."""
    bench = Bench()

    def watch(progress: Any) -> None:
        if progress.tick == 100:
            break_it(bench)

    with bench.rig() as rig:
        experiment = Experiment(signal=Step(final=6.0), duration=5, limits=Limits(stall=None))
        recording = bench.run(experiment, rig, watch=watch)
    assert recording.stopped.reason == "fault"
    return {each.code for each in recording.findings}


def test_the_samples_that_a_fault_left_on_are_switched_off_before_the_next_run() -> None:
    """A board that makes up samples can't take the whole table as fast as it comes."""
    bench = Bench()
    with with_faults(bench.rig(), [{"name": "starved", "from": 0.3}]) as rig:
        bench.run(Experiment(duration=0.6), rig)
    said = []
    with bench.rig() as rig:
        whole = bench.port.write
        reader = Reader()

        def write(data: bytes) -> None:
            said.extend(protocol().of(payload) for payload in reader.feed(data))
            whole(data)

        bench.port.write = write  # type: ignore[method-assign]
        recording = bench.run(Experiment(duration=0.4), rig)

    names = [each.name for each in said if each is not None]
    assert names.index("sampling") < names.index("enable") < names.index("table")
    assert recording.stopped.reason == "finished"


def test_what_a_dead_host_left_is_cleared_by_the_next_one() -> None:
    bench = Bench()
    with bench.rig() as rig:
        rig.start(0.002, None)
        rig.read()
        rig.write(5.0)
        bench.board.let_pass(100)
        with pytest.raises(RunEnded, match="watchdog tripped"):
            rig.read()
        rig.start(0.002, None)
        rig.read()

        assert rig.write(3.0) == 3.0


def test_a_frame_of_the_table_that_is_lost_is_sent_again() -> None:
    bench = Bench()
    with bench.rig() as rig:
        lost = 0
        whole = bench.port.write

        def write(data: bytes) -> None:
            nonlocal lost
            table = protocol().message("table").struct.size
            if len(data) == table + 4 and bench.board.look().cycle > 300 * MS and not lost:
                lost += 1
                return
            whole(data)

        bench.port.write = write  # type: ignore[method-assign]
        recording = bench.run(Experiment(duration=1), rig)
        assert lost == 1
        assert bench.board.status()["received_gaps"] == 1
    assert recording.stopped.reason == "finished"
    assert np.array_equal(recording["applied"].values, recording["commanded"].values)


def test_firmware_with_another_schema_is_refused_before_anything_moves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench()
    other = replace(protocol(), schema=protocol().schema ^ 1)
    monkeypatch.setattr("servobench.rig.devices.rig.protocol", lambda: other)
    with pytest.raises(DeviceError, match=r"speaks another protocol .*flash"), bench.rig():
        pass

    bench.board.run(ms=10)
    assert bench.board.look().pwm_rises == 0
    assert bench.board.look().enable == 0


@pytest.mark.parametrize(
    ("sample_time", "settings", "words"),
    [
        (0.0015, {}, "whole number of milliseconds"),
        (0.3, {"watchdog": 0.5}, "from 1 to 255"),
        (0.03, {}, "too long for a watchdog of 50 ms"),
    ],
)
def test_a_sample_time_that_the_board_has_not_is_refused(
    sample_time: float, settings: Any, words: str
) -> None:
    with Bench().rig(**settings) as rig, pytest.raises(UsageError, match=words):
        rig.start(sample_time, None)


@pytest.mark.parametrize("watchdog", [0.019, 0.501, 1.0])
def test_a_watchdog_that_is_none_is_refused(watchdog: float) -> None:
    with pytest.raises(UsageError, match="20 to 500 ms"):
        Bench().rig(watchdog=watchdog)


def test_the_current_is_the_motor_s_own() -> None:
    bench = Bench(motor(inertia=1.0))  # it hardly turns: the current is voltage over resistance
    with bench.rig(current_scale=0.185) as rig:
        rig.start(0.002, None)
        for _ in range(10):
            sample = rig.read()
            rig.write(8.4)
        # A step of the converter is 26 mA.
        assert sample.current == pytest.approx(1.0, abs=0.027)
        assert bench.board.look().current == pytest.approx(1.0, abs=0.01)


def test_without_pyserial_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(UsageError, match=r'needs pyserial: pip install "servobench\[rig\]"'):
        serial_port.SerialPort("nowhere", 500_000)


def test_a_port_that_is_not_there_is_a_sentence() -> None:
    with pytest.raises(
        DeviceError, match=r"the port /dev/ttyNOWHERE can't be opened \(No such file or directory\)"
    ):
        Rig(RigSettings(port="/dev/ttyNOWHERE")).__enter__()


def test_a_port_that_one_may_not_use_says_how_one_may(monkeypatch: pytest.MonkeyPatch) -> None:
    import serial

    def refuse(*_: Any, **__: Any) -> None:
        raise serial.SerialException(errno.EACCES, "could not open port")

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(DeviceError, match=r"\(Permission denied\); .*dialout"):
        Rig(RigSettings(port="/dev/ttyUSB0")).__enter__()


def test_a_computer_that_stands_still_while_it_writes_has_not_lost_its_port(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from serial.serialutil import Timeout

    longest = protocol().constants["watchdog_max_ms"] * 1e-3
    clock = itertools.count()
    ours, theirs = os.openpty()
    try:
        port = serial_port.SerialPort(os.ttyname(theirs), 500_000)
        # As long as the longest watchdog passes between the write's beginning and the look whether its time is over, two on.
        monkeypatch.setattr(Timeout, "TIME", lambda *_: longest / 2 * next(clock))
        port.write(b"taken")
        monkeypatch.undo()
        assert os.read(ours, 5) == b"taken"
        port.close()
    finally:
        os.close(ours)
        os.close(theirs)


class Talker:
    """The port of a board with another program, which prints ten lines a second and never answers."""

    def __init__(self) -> None:
        self.now = 0.0

    def read(self) -> bytes:
        self.now += 0.1
        return b"12,1.5,2048\r\n"

    def write(self, data: bytes) -> None:
        pass

    def close(self) -> None:
        pass


def test_a_board_that_talks_of_other_things_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    talker = Talker()
    monkeypatch.setattr("servobench.rig.devices.rig.monotonic", lambda: talker.now)
    rig = Rig(RigSettings(port="/dev/ttyUSB0"), open_port=lambda name, baud: talker)
    with pytest.raises(DeviceError, match=r"no board at .* though something is sent there; flash"):
        rig.__enter__()
    assert talker.now <= GREETING_TIME + 0.1


def test_a_stop_that_never_arrives_is_made_up_for_by_the_watchdog() -> None:
    bench = Bench()
    with bench.rig(batch=False) as rig:
        rig.start(0.002, None)
        for _ in range(50):
            rig.read()
            rig.write(6.0)
        turning = bench.board.look()
        assert turning.duty == 0.5
        bench.port.write = lambda data: None  # type: ignore[method-assign]
        rig.stop()
        bench.board.run(ms=300)
        stopped = bench.board.look()

    later = bench.board
    later.run(ms=100)
    assert later.look().speed < stopped.speed  # it coasts
    assert not stopped.enable
    assert (stopped.pwm_high - turning.cycle) / MS <= 51
