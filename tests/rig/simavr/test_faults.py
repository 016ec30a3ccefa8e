"""Faults on the rig: the whole path from the experiment to the pin, in lock-step with the firmware in simavr.

docs/reference/rig-faults.md lists all rows of the table with their tests; what the firmware or the device answers alone has its
test beside them.
"""

import math
import random
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from servobench.cli.run import terminate_like_ctrl_c
from servobench.core.errors import UsageError
from servobench.recordings.recording import Recording
from servobench.rig.devices.guarded import Guarded
from servobench.rig.experiment import Experiment, Limits
from servobench.rig.experiment.limits import Plausibility
from servobench.rig.wire.frames import decode
from servobench.rig.wire.messages import protocol
from servobench.systems.control.pi import Pi
from servobench.systems.control.pid import Pid
from servobench.systems.signals.constant import Constant
from servobench.systems.signals.prbs import PRBS
from servobench.systems.signals.sine import Sine
from servobench.systems.signals.square import Square
from servobench.systems.signals.step import Step
from tests.faults.test_row28_exception import interrupt, mistake, terminate
from tests.rig.loop.shaft import Controller, odd
from tests.rig.simavr.board import MS, OWNER, PROTOCOL, REFUSALS, STATES, Board, motor
from tests.rig.simavr.build import needed
from tests.rig.simavr.lockstep import Bench

pytestmark = pytest.mark.usefixtures("simavr")
SAMPLE_TIME = 0.002  # s
STEP_OF_DUTY = 12 / 1024  # V


@pytest.fixture(scope="module")
def simavr() -> None:
    needed()


def not_finite(source: random.Random) -> float:
    """Return a NaN with any sign and payload, or an infinity."""
    bits = source.getrandbits(1) << 63 | 0x7FF << 52 | source.getrandbits(52) * source.getrandbits(1)
    return float(struct.unpack("<d", struct.pack("<Q", bits))[0])


# Row 6: NaN, infinities


def test_row_06_none_of_100_000_values_that_are_no_numbers_reaches_the_wire() -> None:
    bench, drawn = Bench(), random.Random(6)
    with bench.rig(batch=False, watchdog=0.5) as rig:
        guarded = Guarded(rig, Limits(), when_faulted="hold", now=bench.now)
        guarded.start(SAMPLE_TIME, None)
        guarded.read()
        guarded.write(3.0)
        sent: list[bytes] = []
        whole = bench.port.write
        bench.port.write = lambda data: (sent.append(data), whole(data))[1]  # type: ignore[method-assign]
        for _ in range(100_000):
            with pytest.raises(UsageError):
                rig.write(not_finite(drawn))
            assert not sent
        for _ in range(100):  # through the guard each is a fault, at zero volts
            assert guarded.write(not_finite(drawn)) == 0.0
        duty = PROTOCOL.message("duty")
        assert {len(each) for each in sent} == {duty.struct.size + 4}
        bench.board.run(ms=20)
        assert bench.board.look().duty == 0
        with pytest.raises(UsageError, match="reference"):
            rig.follow(math.nan)
        guarded.stop()  # its watchdog's thread would go on otherwise


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_row_06_a_controller_that_returns_none_ends_at_zero_volts_within_a_sample(value: float) -> None:
    bench = Bench()
    at = 0.0

    def command(k: int) -> float:
        nonlocal at
        if k == 200:
            at = bench.board.look().cycle
            assert bench.board.look().duty == 0.5
        return value if k >= 200 else 6.0

    with bench.rig() as rig:
        recording = bench.run(odd(controller=Controller(command), samples=1000, sample_time=SAMPLE_TIME), rig)
        bench.board.run(ms=50)
        assert recording.stopped.reason == "fault"
        assert (bench.board.look().pwm_high - at) / MS <= 1000 * SAMPLE_TIME
        assert not bench.board.look().enable


# Row 9: an encoder that is stuck or unplugged at speed


def plausible(around: Any) -> Limits:
    truth = around.truth
    return Limits(plausibility=Plausibility(gain=truth["gain"], time_constant=truth["time_constant"]))


def with_encoder_stuck(voltage: float, channels: int) -> tuple[Bench, Recording, float]:
    """Drive the motor, stick channels of its encoder at 0.6 s, and return when that was by the board's clock [cycles]."""
    bench, stuck = Bench(), 0.0

    def watch(progress: Any) -> None:
        nonlocal stuck
        if progress.time >= 0.6 and not stuck:
            bench.board.stick(channels)
            stuck = bench.board.look().cycle

    with bench.rig() as rig:
        asked = Experiment(
            signal=Constant(value=voltage),
            duration=2,
            sample_time=SAMPLE_TIME,
            limits=plausible(bench.board.motor),
        )
        recording = bench.run(asked, rig, watch=watch)
        bench.board.run(ms=100)
        assert not bench.board.look().enable
        return bench, recording, stuck


@pytest.mark.parametrize("channels", [1, 2, 3], ids=["A stuck", "B stuck", "unplugged"])
@pytest.mark.parametrize("voltage", [2.0, -6.0])
def test_row_09_an_encoder_that_is_stuck_at_speed_cuts_the_motor_off_in_a_tenth_of_a_second(
    voltage: float, channels: int
) -> None:
    bench, recording, stuck = with_encoder_stuck(voltage, channels)

    assert recording.stopped.reason == "fault"
    assert "encoder" in recording.stopped.sentence
    assert (bench.board.look().pwm_high - stuck) / MS <= 100 + 16  # and a block of samples


@pytest.mark.parametrize("part", [0.8, 1.2])
@pytest.mark.parametrize("name", ["resistance", "constant", "inertia"])
def test_row_09_a_motor_20_percent_off_its_figures_is_no_stuck_encoder(name: str, part: float) -> None:
    nominal = motor()
    bench = Bench(motor(**{name: part * getattr(nominal, name)}))
    with bench.rig() as rig:
        asked = Experiment(
            signal=PRBS(low=-6, high=6, bit_time=0.1),
            duration=4,
            sample_time=SAMPLE_TIME,
            limits=plausible(nominal),
        )
        recording = bench.run(asked, rig)

    assert recording.stopped.reason == "finished", recording.stopped.sentence


# Row 10: the encoder's sign


@pytest.mark.parametrize(
    "controller", [Pid(kp=3, ki=10, kd=0.1, cutoff=250), Pi(kp=3, ki=4)], ids=["pid", "the board's pi"]
)
def test_row_10_a_loop_with_a_flipped_encoder_is_stopped_in_0_3_s(controller: Any) -> None:
    bench = Bench(motor(constant=-0.042))  # its leads are swapped, which to a loop is the same
    with bench.rig() as rig:
        asked = Experiment(
            signal=Constant(value=7.0), controller=controller, duration=2, sample_time=SAMPLE_TIME
        )
        recording = bench.run(asked, rig)
        bench.board.run(ms=50)

        assert recording.stopped.reason == "fault"
        assert "the shaft accelerates against the voltage" in recording.stopped.sentence
        assert recording["counts"].t[-1] <= 0.3
        assert not bench.board.look().enable


@pytest.mark.parametrize(
    "controller", [Pid(kp=3, ki=10, kd=0.1, cutoff=250), Pi(kp=3, ki=4)], ids=["pid", "the board's pi"]
)
def test_row_10_the_right_sign_is_not_stopped(controller: Any) -> None:
    bench = Bench()
    with bench.rig() as rig:
        asked = Experiment(
            signal=Constant(value=7.0), controller=controller, duration=2, sample_time=SAMPLE_TIME
        )

        assert bench.run(asked, rig).stopped.reason == "finished"


# Row 12: saturation


@pytest.mark.parametrize(("supply", "limit"), [(12.0, 6.0), (6.0, 10.0)], ids=["limit", "supply"])
def test_row_12_the_flag_of_saturation_is_exact_for_each_sample(supply: float, limit: float) -> None:
    bench = Bench(motor(supply=supply))
    with bench.rig(supply=supply) as rig:
        asked = Experiment(signal=Sine(amplitude=9, frequency=1.3), duration=2, limits=Limits(voltage=limit))
        recording = bench.run(asked, rig)

    wanted = 9 * np.sin(2 * np.pi * 1.3 * SAMPLE_TIME * np.arange(1000))
    least = min(supply, limit)
    # Beyond half a step of the duty; nearer to the limit than that the voltage is as it was asked for.
    assert recording["saturated"].values.tolist() == (np.abs(wanted) > least + supply / 2048).tolist()
    assert np.abs(recording["applied"].values - np.clip(wanted, -least, least)).max() <= supply / 2048 + 1e-9


@pytest.mark.parametrize(
    "law", [Pid(kp=3, ki=6, kd=0.12, cutoff=300), Pi(kp=3, ki=4)], ids=["pid", "the board's pi"]
)
def test_row_12_behind_a_limit_the_loop_overshoots_no_more_than_without_it(law: Any) -> None:
    def most(limit: float) -> float:
        bench = Bench(motor(supply=60.0))  # 20 rad by 3 V/rad
        with bench.rig(supply=60.0) as rig:
            asked = Experiment(
                signal=Step(final=20.0),
                controller=law,
                duration=5,
                sample_time=SAMPLE_TIME,
                limits=Limits(voltage=limit, speed=None, plausibility=None, stall=None),
            )
            recording = bench.run(asked, rig)
        assert recording.stopped.reason == "finished", recording.stopped.sentence
        return float(recording["counts"].values.max()) * 2 * np.pi / 2048

    assert most(2.0) <= most(60.0) + 2 * np.pi / 2048


# Row 13: missed deadlines


def losing(lost: set[int]) -> Recording:
    """Run while the frames of those samples are lost on the wire."""
    bench = Bench()
    with bench.rig(batch=False) as rig:
        whole, rest = bench.port.read, b""
        sample = protocol().message("sample")

        def read() -> bytes:
            nonlocal rest
            *frames, rest = (rest + whole()).split(b"\0")
            kept = b""
            for frame in frames:
                payload = payload_of(frame)
                if not (payload[:1] == bytes([sample.code]) and sample.unpack(payload)["index"] in lost):
                    kept += frame + b"\0"
            return kept

        bench.port.read = read  # type: ignore[method-assign]
        return bench.run(Experiment(signal=Constant(value=2.0), duration=4, sample_time=SAMPLE_TIME), rig)


def payload_of(frame: bytes) -> bytes:
    """Return the payload of a frame, nothing where it is damaged."""
    return decode(frame) or b""


def test_row_13_each_sample_that_is_lost_is_reported_by_its_number_and_time() -> None:
    drawn = random.Random(13)
    lost = set(drawn.sample(range(5, 1995), 60))
    recording = losing(lost)

    assert recording.stopped.reason == "finished"
    numbers = np.round(recording["counts"].t / SAMPLE_TIME).astype(int)
    assert set(range(2000)) - set(numbers.tolist()) == lost
    told = [finding for finding in recording.findings if finding.code == "samples-missed"]
    assert len(told) == 1
    assert told[0].sentence.startswith(f"{len(lost)} of 2000 samples were missed")


def test_row_13_more_than_a_tenth_in_half_a_second_ends_the_run() -> None:
    recording = losing(set(range(500, 1500, 4)))

    assert recording.stopped.reason == "fault"
    assert "of the last 250 ticks" in recording.stopped.sentence
    # The 26th lost one: 26 x 4 samples after the first; it is seen with the sample after it.
    assert recording["counts"].t[-1] == pytest.approx((500 + 25 * 4 + 1) * SAMPLE_TIME, abs=1e-9)


def test_row_13_a_batch_has_no_missed_deadline_however_late_the_computer_is() -> None:
    bench = Bench()
    drawn = random.Random(14)
    with bench.rig() as rig:
        whole = bench.port.read

        def read() -> bytes:
            bench.board.let_pass(drawn.choice([0, 0, 0, 25]))
            return whole()

        bench.port.read = read  # type: ignore[method-assign]
        recording = bench.run(Experiment(duration=4, sample_time=SAMPLE_TIME), rig)

    assert recording.stopped.reason == "finished"
    assert np.allclose(np.diff(recording["counts"].t), SAMPLE_TIME, rtol=0, atol=1e-9)
    assert len(recording["counts"].t) == 2000


# Row 20: two programs, one rig


def check_two_programs(tries: int, seed: int) -> None:
    """Let a second program try all that it can while the first one drives."""
    drawn = random.Random(seed)
    with Board() as board:
        board.enable()
        for k in range(tries):
            other = drawn.randrange(1, 1 << 16)
            other += other == OWNER
            name, values = drawn.choice(
                [
                    ("duty", {"duty": drawn.choice([-1024, 512, 1024])}),
                    ("table", {"first": 0, "count": 8, "last": 0, "duty": [900] * 8}),
                    ("reference", {"reference": drawn.randrange(-(2**31), 2**31)}),
                    ("enable", {"mode": drawn.randrange(4)}),
                    ("configure", {"watchdog_ms": 500, "stall_duty": 1024}),
                    ("gains", {"kp": 2**24, "ki": 2**24, "limit": 1024}),
                    ("sampling", {"period": 1, "block": 0}),
                    ("set_position", {"position": 0}),
                    ("release", {}),
                    ("claim", {"schema": PROTOCOL.schema}),
                ]
            )
            board.send("duty", duty=100)
            board.send(name, owner=other, **values)
            board.run(ms=1.2)
            if k % 100 == 0:
                assert board.look().duty == 100 / 1024
        board.run(ms=5)
        refused = [
            values["refusal"]
            for message, values in board.heard
            if message.name == "status" and values["command"]
        ]
        assert len(refused) == tries
        assert set(refused) <= {REFUSALS["owner"], REFUSALS["state"]}
        status = board.status()
        assert status["owner"] == OWNER
        assert status["state"] == STATES["operation_enabled"]
        assert status["refused"] == tries


def test_row_20_nothing_that_a_second_program_says_is_obeyed() -> None:
    check_two_programs(300, 20)


@pytest.mark.long
def test_row_20_nothing_that_a_second_program_says_is_obeyed_in_10_000_tries() -> None:
    check_two_programs(10_000, 21)


# Row 28: an exception in somebody's controller, Ctrl-C, SIGTERM


@pytest.mark.parametrize("what", [mistake, interrupt, terminate], ids=["exception", "Ctrl-C", "SIGTERM"])
def test_row_28_whatever_ends_the_program_takes_the_voltage_away_within_20_ms(
    what: Callable[[], Any],
) -> None:
    bench, at = Bench(), 0

    def command(k: int) -> float:
        nonlocal at
        if k == 200:
            at = bench.board.look().cycle
            assert bench.board.look().duty == 0.5
            what()
        return 6.0

    asked = odd(controller=Controller(command), samples=1000, sample_time=SAMPLE_TIME)
    with terminate_like_ctrl_c(), bench.rig() as rig:
        if what is mistake:
            with pytest.raises(ZeroDivisionError):
                bench.run(asked, rig)
        else:
            assert bench.run(asked, rig).stopped.reason == "interrupted"
    bench.board.run(ms=100)
    view = bench.board.look()
    assert (view.pwm_high - at) / MS <= 20
    assert not view.enable
    assert bench.board.status()["faults"] == 0  # it was stopped, and not starved
    assert bench.board.status()["owner"] == 0


@pytest.mark.parametrize("what", [interrupt, terminate], ids=["Ctrl-C", "SIGTERM"])
@pytest.mark.parametrize("controller", [None, Pi(kp=6)], ids=["a table", "the board's law"])
def test_row_28_what_the_board_does_by_itself_is_ended_as_well(
    what: Callable[[], Any], controller: Any
) -> None:
    bench, at = Bench(), 0

    def watch(progress: Any) -> None:
        nonlocal at
        if progress.time > 0.3 and not at:
            at = bench.board.look().cycle
            what()

    law = {} if controller is None else {"controller": controller}
    asked = Experiment(
        signal=Square(low=1, high=3, frequency=0.4), duration=5, sample_time=SAMPLE_TIME, **law
    )
    with terminate_like_ctrl_c(), bench.rig() as rig:
        assert bench.run(asked, rig, watch=watch).stopped.reason == "interrupted"
    bench.board.run(ms=100)
    view = bench.board.look()
    assert (view.pwm_high - at) / MS <= 20
    assert not view.enable
