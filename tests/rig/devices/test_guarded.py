"""A guarded device: its limits, its watchdog, its latch, its light."""

import math
import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from servobench.core.channels import Array, Channel, DeviceInfo, Sample
from servobench.core.errors import DeviceError, UnknownName, UsageError
from servobench.rig.devices.base import Device, Lit, RunEnded
from servobench.rig.devices.faulty import Faulty
from servobench.rig.devices.guard.base import MONITORS, Motion, Rig
from servobench.rig.devices.guarded import Guarded
from servobench.rig.devices.replay import Replay
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import PAPER, Limits
from servobench.rig.experiment.limits import Outputs, Plausibility, StallLimits, Watchdog
from servobench.rig.loop.run import run
from tests.faults.doubles import Bench, drive
from tests.rig.loop.shaft import Controller, Shaft, odd

RED, GREEN, BLUE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


class Time:
    """A time that a test moves on."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def started(device: Any, limits: Limits | None = None, **changes: Any) -> Guarded:
    guarded = Guarded(device, limits, **changes)
    guarded.start(0.01, 0)
    return guarded


def tick(guarded: Guarded, voltage: float = 2.0) -> float:
    guarded.read()
    return guarded.write(voltage)


def test_it_is_a_device_and_hands_on_what_the_inner_one_says() -> None:
    with Guarded(Twin()) as guarded:
        assert isinstance(guarded, Device)
        assert isinstance(guarded.device, Lit)
        assert guarded.info == Twin().info
        guarded.start(0.002, 0)
        assert guarded.read() == Sample(index=0, time=0.0, counts=0, current=0.0)
    with pytest.raises(DeviceError, match="isn't connected"):
        guarded.read()


def test_a_run_through_it_records_what_a_run_without_it_did() -> None:
    # Truth from elsewhere: the twin driven by hand, with nothing in between.
    with Twin() as motor:
        recording = run(PAPER, motor)
        motor.start(0.002, 0)
        counts = []
        for voltage in recording["commanded"].values:
            counts.append(motor.read().counts)
            motor.write(float(voltage))

    assert recording["counts"].values.tolist() == counts
    assert not recording["saturated"].values.any()


@pytest.mark.promise("S6")
def test_speed_travel_and_current_are_faults_where_they_leave_their_limits() -> None:
    # 10 V: 238 rad/s at the end, with τ = 0.1 s; i = 10 V / 8.4 Ω = 1.19 A at the start.
    for limits, code in (
        (Limits(speed="100 rad/s"), "speed-above-limit"),  # type: ignore[arg-type]
        (Limits(travel="1 rev"), "travel-above-limit"),  # type: ignore[arg-type]
        (Limits(current="1 A"), "current-above-limit"),  # type: ignore[arg-type]
    ):
        for voltage in (10.0, -10.0):
            with Bench() as motor:
                guarded = drive(motor, lambda t, voltage=voltage: voltage, duration=2.0, limits=limits)
                assert guarded.fault is not None
                assert guarded.fault.code == code
                assert motor.reached[-1] == 0.0
                i, w, theta = motor.state
                # Noticed by the sample after, or by what the smoothing of 10 ms is behind: dω/dt is 2,400 rad/s² at the most.
                if code == "speed-above-limit":
                    assert 100.0 < abs(w) <= 100.0 + 2400 * 0.014
                if code == "travel-above-limit":
                    assert 2 * math.pi < abs(theta) <= 2 * math.pi + 238 * 0.002 + 2 * math.pi / 2048
                if code == "current-above-limit":
                    assert guarded.fault.time <= 0.004
                    assert abs(i) > 0.9


@pytest.mark.promise("S6")
@pytest.mark.parametrize("limit", [{"current": 1.0}, {"speed": 10.0}, {"travel": 1.0}])
def test_a_limit_that_the_device_cannot_be_held_to_is_refused_by_name(limit: dict[str, Any]) -> None:
    device = Shaft()
    with pytest.raises(UsageError, match=rf"limits\.{next(iter(limit))} is .* 'shaft'.*leave that limit out"):
        Guarded(device, Limits(**limit))
    assert device.events == []


def test_a_data_sheet_that_there_is_not_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UnknownName, match="qube_servo_2"):
        Guarded(Twin(), Limits(plausibility=Plausibility(motor="qube")))


@pytest.mark.promise("S10")
@pytest.mark.parametrize("bits", [16, 24, 32])
@pytest.mark.parametrize("direction", [1, -1])
def test_counts_are_unwrapped_exactly_by_the_half_range_rule(bits: int, direction: int) -> None:
    with Twin(Twin.Settings(counter_bits=bits)) as motor:
        motion = Motion(Rig(limits=Limits(), info=motor.info, sample_time=0.01, nominal=None))
    half = 1 << (bits - 1)
    true, step = 0, direction * (half - 1)
    for index in range(2000):
        shown = (true + half) % (2 * half) - half
        motion.take(Sample(index=index, time=0.01 * index, counts=shown))
        assert motion.position == true
        true += step if index % 3 else direction * 7
    assert abs(true) > 1000 * half


@pytest.mark.promise("S9")
def test_a_step_that_no_motor_makes_is_a_fault_of_the_encoder() -> None:
    class Jumps(Bench):
        def read(self) -> Sample:
            sample = super().read()
            jump = 4000 if sample.index >= 200 else 0
            return Sample(
                index=sample.index, time=sample.time, counts=sample.counts + jump, current=sample.current
            )

    with Jumps() as motor:
        guarded = drive(motor, lambda t: 10.0, duration=1.0)
        assert guarded.fault is not None
        assert guarded.fault.code == "encoder-step-impossible"
        assert guarded.fault.time == pytest.approx(0.4)
        assert "stepped by 4" in guarded.fault.sentence


@pytest.mark.promise("S9")
def test_a_gap_in_which_the_counter_may_have_wrapped_is_a_fault() -> None:
    # 1.5 · 238 rad/s are 116,000 counts a second: half of 16 bits, 32,768, within 0.28 s.
    with Bench(counter_bits=16) as motor:
        guarded = Guarded(motor, Limits(watchdog=Watchdog(timeout=0.5)))
        guarded.start(0.2, 0)
        tick(guarded, 1.0)
        motor._index += 1
        with pytest.raises(RunEnded, match=r"400 ms passed .* wrapped unnoticed"):
            guarded.read()


@pytest.mark.promise("S14")
def test_the_watchdog_is_fed_by_a_write_after_a_new_sample_and_by_nothing_else() -> None:
    def only_reads(guarded: Guarded) -> None:
        guarded.read()

    def only_writes(guarded: Guarded) -> None:
        guarded.write(2.0)

    for poll in (only_reads, only_writes):
        now, device = Time(), Shaft()
        guarded = started(device, now=now)
        tick(guarded)
        for _ in range(9):
            now.now += 0.01
            poll(guarded)
            assert guarded.look() > 0
            assert guarded.fault is None
        now.now += 0.02
        guarded.look()
        assert guarded.fault is not None
        assert guarded.fault.code == "watchdog"
        assert "for 110 ms after a new sample (limit: 100 ms)" in guarded.fault.sentence
        assert device.voltage == 0.0
        with pytest.raises(RunEnded):
            poll(guarded)
        assert device.voltage == 0.0


@pytest.mark.promise("S14")
def test_fresh_actuation_feeds_the_watchdog_for_ever() -> None:
    now = Time()
    guarded = started(Shaft(), now=now)
    for _ in range(1000):
        tick(guarded)
        now.now += 0.0999
        guarded.look()
    assert guarded.fault is None


@pytest.mark.promise("S14")
def test_a_device_that_sends_the_same_sample_again_is_not_fresh() -> None:
    class Repeats(Shaft):
        def read(self) -> Sample:
            sample = super().read()
            self.index = min(self.index, 5)
            return sample if sample.index <= 5 else Sample(index=5, time=0.05, counts=sample.counts)

    now, device = Time(), Repeats()
    guarded = started(device, now=now)
    for _ in range(100):
        if guarded.fault is not None:
            break
        tick(guarded)
        now.now += 0.01
        guarded.look()

    assert guarded.fault is not None
    assert guarded.fault.code == "watchdog"
    assert 0.1 < now.now - 100.05 <= 0.12  # the sixth sample, at 50 ms, was the last that was new
    assert device.voltage == 0.0


@pytest.mark.promise("S14")
def test_in_device_time_a_gap_between_samples_is_noticed_at_the_next_read() -> None:
    device = Shaft()
    guarded = started(device)
    tick(guarded)
    device.index += 10  # 110 ms
    with pytest.raises(RunEnded, match="no new voltage came for 110 ms"):
        guarded.read()
    assert device.voltage == 0.0


@pytest.mark.promise("S14")
def test_a_loop_that_is_stuck_is_cut_off_by_the_watchdogs_thread() -> None:
    cut = threading.Event()

    class Stuck(Shaft):
        def write(self, voltage: float) -> float:
            if threading.current_thread() is not threading.main_thread():
                assert voltage == 0.0
                cut.set()
            return super().write(voltage)

    device, others = Stuck("host"), set(threading.enumerate())
    guarded = started(device, Limits(watchdog=Watchdog(timeout=0.02, light="red")))
    tick(guarded)
    assert cut.wait(30)  # the loop's thread does nothing; what is waited for comes after 20 ms
    guarded.stop()
    assert guarded.fault is not None
    assert guarded.fault.code == "watchdog"
    assert device.voltage == 0.0
    own = set(threading.enumerate()) - others
    assert "servobench watchdog" not in [thread.name for thread in own]


@pytest.mark.promise("S14")
def test_a_write_that_hangs_in_the_device_is_overtaken_and_undone() -> None:
    # The loop's write comes to its end after the watchdog's zero: the guard puts zero out again.
    now, release = Time(), threading.Event()

    class Hangs(Shaft):
        def write(self, voltage: float) -> float:
            if voltage:
                release.wait(30)
            return super().write(voltage)

    device = Hangs()
    guarded = started(device, now=now)
    guarded.read()
    guarded.write(0.0)
    guarded.read()
    ended: list[bool] = []

    def loop() -> None:
        try:
            guarded.write(2.0)
        except RunEnded:
            ended.append(True)

    thread = threading.Thread(target=loop)
    thread.start()
    now.now += 0.2
    guarded.look()
    assert guarded.fault is not None
    release.set()
    thread.join(30)
    assert ended == [True]
    assert device.voltage == 0.0


@pytest.mark.promise("S14")
@pytest.mark.parametrize("timing", ["host", "device"])
def test_a_sample_time_that_the_watchdog_cannot_wait_for_is_refused(timing: Any) -> None:
    device = Shaft(timing)
    with pytest.raises(UsageError, match=r"limits\.watchdog\.timeout is 0\.1 s; .* two samples of 0\.06 s"):
        Guarded(device).start(0.06, 0)
    assert device.events == []
    for timeout in (0.0, 0.019, 0.51, math.inf):
        with pytest.raises(ValueError, match="timeout"):
            Watchdog(timeout=timeout)


@pytest.mark.promise("S11", "S12")
def test_on_hold_the_run_goes_on_at_the_terminate_value_until_the_fault_is_acknowledged() -> None:
    device = Shaft()
    guarded = started(device, Limits(terminate=Outputs(voltage=0.5)), when_faulted="hold")
    tick(guarded)
    assert tick(guarded, math.nan) == 0.5
    assert [tick(guarded) for _ in range(3)] == [0.5] * 3
    assert guarded.saturated
    guarded.acknowledge()
    assert guarded.fault is None
    assert tick(guarded) == 2.0
    assert not guarded.saturated
    assert [fault.code for fault in guarded.faults] == ["voltage-not-finite"]
    assert {finding.code for finding in guarded.findings()} == {"saturated", "voltage-not-finite"}


@pytest.mark.promise("S11")
def test_the_first_fault_is_kept_as_it_is_the_cause() -> None:
    guarded = started(Shaft(), when_faulted="hold")
    tick(guarded, math.nan)
    tick(guarded, math.inf)
    assert guarded.fault is not None
    assert "nan" in guarded.fault.sentence


@pytest.mark.promise("S13")
@pytest.mark.parametrize("faulty", [False, True])
def test_the_light_is_blue_at_rest_green_while_driven_and_red_after_a_fault(faulty: bool) -> None:
    motor = Twin()
    with Guarded(Faulty(motor, []) if faulty else motor) as guarded:
        assert motor.lit == BLUE
        guarded.start(0.002, 0)
        guarded.read()
        assert motor.lit == BLUE
        guarded.write(2.0)
        assert motor.lit == GREEN
        guarded.stop()
        assert motor.lit == BLUE
        guarded.start(0.002, 0)
        with pytest.raises(RunEnded):
            tick(guarded, math.nan)
        assert motor.lit == RED
        guarded.stop()
        assert motor.lit == RED


@pytest.mark.promise("S12")
def test_start_and_watchdog_values_are_put_out() -> None:
    limits = Limits(start=Outputs(voltage=1.0, light="off"), watchdog=Watchdog(voltage=0.25, light="blue"))
    now, motor = Time(), Bench()
    with Guarded(motor, limits, now=now) as guarded:
        guarded.start(0.002, 0)
        assert motor.lit == (0.0, 0.0, 0.0)
        tick(guarded)
        assert motor.reached == [1.0, 2.0]
        now.now += 0.2
        guarded.look()
        assert motor.reached[-1] == 0.25
        with pytest.raises(ValueError, match=r"start\.voltage is 11 V, beyond the limit of 10 V"):
            Limits(start=Outputs(voltage=11.0))


@pytest.mark.promise("S12")
@pytest.mark.parametrize(("starves", "voltage"), [(True, 0.25), (False, 0.5)])
def test_what_stopped_the_motor_decides_what_is_held_until_it_is_acknowledged(
    starves: bool, voltage: float
) -> None:
    limits = Limits(watchdog=Watchdog(voltage=0.25), terminate=Outputs(voltage=0.5))
    now, shaft = Time(), Shaft(timing="host")
    guarded = started(shaft, limits, when_faulted="hold", now=now)
    tick(guarded)
    if starves:
        now.now += 1.0
        guarded.look()
    else:
        tick(guarded, math.nan)

    assert tick(guarded, 5.0) == voltage
    guarded.stop()


@pytest.mark.promise("S12")
def test_the_start_value_comes_with_the_first_sample_and_is_slewed_and_watched_as_any_other() -> None:
    limits = Limits(start=Outputs(voltage=5.0), slew=100.0, watchdog=Watchdog(voltage=0.25))
    now, motor = Time(), Bench()
    with Guarded(motor, limits, now=now) as guarded:
        guarded.start(0.01, 0)
        now.now += 100.0  # however long it takes until there is a first sample
        guarded.look()
        assert motor.reached == []
        guarded.read()
        assert motor.reached == [1.0]  # 100 V/s for 10 ms
        assert guarded.write(5.0) == 2.0
        guarded.start(0.01, 0)
        guarded.read()
        now.now += 0.2
        guarded.look()
        assert motor.reached == [1.0, 2.0, 1.0, 0.25]
        assert guarded.fault is not None
        assert guarded.fault.code == "watchdog"


@pytest.mark.promise("S19")
@pytest.mark.parametrize(
    "limits", [Limits(), Limits(terminate=Outputs(voltage=0.5))], ids=["zero", "hold a load"]
)
def test_stop_never_raises_may_be_called_twice_and_ends_at_zero_volts_where_the_devices_own_fails(
    limits: Limits,
) -> None:
    def broken() -> None:
        raise OSError("gone")

    device = Shaft()
    device.stop = broken  # type: ignore[method-assign]
    guarded = started(device, limits)
    tick(guarded)
    guarded.stop()
    guarded.stop()
    assert device.voltage == 0.0
    assert guarded.fault is not None
    assert guarded.fault.code == "stop-failed"


def test_what_nothing_drives_is_not_watched() -> None:
    with Twin() as motor:
        recording = run(PAPER.model_copy(update={"duration": 1.0}), motor)
    with Replay(recording) as replay:
        guarded = Guarded(replay, Limits(current=1e-6, speed=1.0, travel=0.1))
        played = run(
            odd(controller=Controller(lambda k: 9.0), samples=None, sample_time=0.002), guarded, to=None
        )
        assert played.stopped.reason == "finished"
        assert len(played["counts"].values) == 500
        assert played.findings == ()


def test_every_monitor_says_what_it_watches_by() -> None:
    assert set(MONITORS.names()) >= {"current", "plausibility", "speed", "stall", "steps", "travel"}


class Held(Shaft):
    """A shaft that something holds; its clock can be set, and its output may be in another unit."""

    unit, ahead = "V", 0.0

    @property
    def info(self) -> DeviceInfo:
        return replace(
            super().info,
            channels=(Channel(name="voltage", unit=self.unit), Channel(name="counts", unit="counts")),
        )

    def read(self) -> Sample:
        sample = super().read()
        return replace(sample, time=sample.time + self.ahead, counts=0)


STALLS_AT_1_V = Limits(stall=StallLimits(voltage=1.0, duration=0.1))


def test_a_clock_that_goes_back_took_as_long_as_a_tick() -> None:
    shaft = Held()
    guarded = started(shaft, STALLS_AT_1_V)
    for _ in range(5):
        tick(guarded)
    shaft.ahead = -3600.0
    tick(guarded)

    assert guarded.fault is None
    assert guarded.time_stalled == pytest.approx(5 * 0.01)


def test_a_stall_that_was_acknowledged_is_timed_anew() -> None:
    guarded = started(Held(), STALLS_AT_1_V, when_faulted="hold")
    for _ in range(20):
        tick(guarded)
    assert guarded.fault is not None
    guarded.acknowledge()
    assert guarded.time_stalled == 0.0
    for _ in range(9):
        tick(guarded)
    assert guarded.fault is None


def test_limits_in_volts_watch_nothing_that_is_put_out_in_percent() -> None:
    shaft = Held()
    shaft.unit = "%"
    guarded = started(shaft, STALLS_AT_1_V)
    for _ in range(20):
        tick(guarded)

    assert guarded.fault is None
    assert guarded.time_stalled == 0.0


class Table(Shaft):
    """A device that takes the voltages of a run in advance."""

    def preload(self, voltages: Array) -> None:
        self.ahead = voltages.tolist()


def test_voltages_in_advance_are_limited_too_and_none_are_given_where_they_will_differ() -> None:
    device = Table()
    for limits, expected in (
        (Limits(voltage=3.0), [2.0, 3.0, -3.0]),
        (Limits(voltage=3.0, slew=100.0), []),
        (Limits(voltage=3.0, start=Outputs(voltage=1.0)), []),
    ):
        started(device, limits).preload(np.array([2.0, 5.0, -5.0]))
        assert device.ahead == expected


@pytest.mark.parametrize("fails", ["read", "write"])
def test_what_the_device_raises_passes_through(fails: str) -> None:
    def fail(index: int) -> None:
        raise DeviceError("the cable is out")

    failing: dict[str, Callable[[int], None]] = {f"on_{fails}": fail}
    guarded = started(Shaft(**failing))  # type: ignore[arg-type]
    with pytest.raises(DeviceError, match="the cable is out"):
        tick(guarded)
