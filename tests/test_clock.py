"""The clocks, by a time that the tests make themselves."""

from collections.abc import Callable

import pytest

from servobench.channels import Sample
from servobench.clock import DeviceClock, HostClock, Tick, VirtualClock, clock_for
from servobench.errors import DeviceError


class FakeTime:
    """A host's time that moves on by what is slept, by a microsecond at each look, and by what a test adds."""

    def __init__(self, oversleeps: float = 0.0, sleeps: float = 1.0) -> None:
        self.seconds = 1000.0
        self.slept: list[float] = []
        self.oversleeps = oversleeps
        self.sleeps = sleeps

    def now(self) -> float:
        self.seconds += 1e-6
        return self.seconds

    def sleep(self, duration: float) -> None:
        self.slept.append(duration)
        self.seconds += self.sleeps * duration + self.oversleeps


class Counter:
    """Reads samples with a running number; each read takes some time."""

    def __init__(self) -> None:
        self.index = -1

    def __call__(self) -> Sample:
        self.index += 1
        return Sample(index=self.index, time=0.0, counts=self.index)


def ticks(clock: HostClock, count: int, work: Callable[[int], None]) -> list[Tick]:
    """Let a loop with work in each tick run for some ticks."""
    read = Counter()
    done: list[Tick] = []
    due = 0
    for _ in range(count):
        done.append(clock.latch(due, read))
        due = done[-1].index + 1
        work(done[-1].index)
    return done


def test_virtual_time_is_the_number_of_the_tick_times_the_sample_time_to_the_bit() -> None:
    clock = VirtualClock()
    clock.start(0.002)

    found = [clock.latch(k, Counter()) for k in (0, 1, 2, 4999)]

    assert [(tick.index, tick.scheduled, tick.actual, tick.late) for tick in found] == [
        (k, k * 0.002, k * 0.002, False) for k in (0, 1, 2, 4999)
    ]


def test_a_host_clock_latches_no_tick_before_its_time_and_each_soon_after() -> None:
    time = FakeTime()
    clock = HostClock(now=time.now, sleep=time.sleep)
    clock.start(0.002)

    found = ticks(clock, 100, lambda index: None)

    assert [tick.index for tick in found] == list(range(100))
    assert [tick.scheduled for tick in found] == [0.002 * k for k in range(100)]
    # Two looks at the clock pass between the deadline and the latch, of a microsecond each; and the last bits of 1000 s.
    assert all(-1e-12 <= tick.actual - tick.scheduled <= 3e-6 for tick in found)
    assert not any(tick.late for tick in found)


def test_lateness_does_not_add_up_from_tick_to_tick() -> None:
    time = FakeTime(oversleeps=1e-4)
    clock = HostClock(now=time.now, sleep=time.sleep)
    clock.start(0.002)

    found = ticks(clock, 1000, lambda index: None)

    # A sleep that lasts 100 µs too long is within the spin of 150 µs: no tick feels it, the last no more than the first.
    assert all(tick.actual - tick.scheduled <= 3e-6 for tick in found)


@pytest.mark.parametrize(("sample_time", "longest"), [(0.0001, 0.00002), (0.002, 0.00015), (1.0, 0.00015)])
def test_the_spin_is_no_longer_than_a_fifth_of_the_sample_time_and_150_microseconds(
    sample_time: float, longest: float
) -> None:
    time = FakeTime()
    clock = HostClock(now=time.now, sleep=time.sleep)
    clock.start(sample_time)
    ticks(clock, 10, lambda index: None)

    # After the first, each of the nine ticks sleeps but for the spin and a few looks at the clock, of a microsecond each.
    assert sum(time.slept[1:]) >= 9 * (sample_time - longest - 5e-6)


def test_a_tick_that_is_late_by_less_than_a_tick_is_done_at_once_and_the_next_is_on_time() -> None:
    time = FakeTime()
    clock = HostClock(now=time.now, sleep=time.sleep)
    clock.start(0.002)

    def stall(index: int) -> None:
        if index == 3:
            time.seconds += 0.0027  # 0.7 ms into tick 4

    found = ticks(clock, 7, stall)

    assert [tick.index for tick in found] == [0, 1, 2, 3, 4, 5, 6]
    assert [tick.late for tick in found] == [False, False, False, False, True, False, False]
    assert found[4].actual == pytest.approx(0.0087, abs=1e-5)
    assert found[5].actual == pytest.approx(0.010, abs=1e-5)


def test_ticks_that_have_gone_by_are_skipped_and_never_made_up_for_in_a_burst() -> None:
    time = FakeTime()
    clock = HostClock(now=time.now, sleep=time.sleep)
    clock.start(0.002)

    def stall(index: int) -> None:
        if index == 3:
            time.seconds += 0.0115  # into the middle of tick 8

    found = ticks(clock, 7, stall)

    assert [tick.index for tick in found] == [0, 1, 2, 3, 8, 9, 10]
    assert [tick.scheduled for tick in found] == [tick.index * 0.002 for tick in found]
    assert [tick.late for tick in found] == [False, False, False, False, True, False, False]


def test_a_tick_is_late_from_a_tenth_of_the_sample_time_on() -> None:
    for stall, late in ((0.00015, False), (0.00025, True)):
        time = FakeTime()
        clock = HostClock(now=time.now, sleep=time.sleep)
        clock.start(0.002)

        found = ticks(clock, 2, lambda index, by=stall, time=time: _pass(time, 0.002 + by))

        assert [tick.late for tick in found] == [False, late]


def _pass(time: FakeTime, seconds: float) -> None:
    time.seconds += seconds


def test_a_sleep_that_ends_early_brings_no_tick_forward() -> None:
    time = FakeTime(sleeps=0.5)
    clock = HostClock(now=time.now, sleep=time.sleep)
    clock.start(0.002)

    found = ticks(clock, 20, lambda index: None)

    assert all(tick.actual >= tick.scheduled - 1e-12 for tick in found)


def device_samples(clock: DeviceClock, numbers: list[int]) -> list[Tick]:
    found: list[Tick] = []
    for number in numbers:
        due = found[-1].index + 1 if found else 0
        found.append(
            clock.latch(due, lambda number=number: Sample(index=number, time=50 + 0.002 * number, counts=0))
        )
    return found


def test_a_device_clock_takes_number_and_time_from_the_sample() -> None:
    clock = DeviceClock()
    clock.start(0.002)

    found = device_samples(clock, [7, 8, 11, 12])

    assert [tick.index for tick in found] == [0, 1, 4, 5]
    assert [tick.scheduled for tick in found] == [0.0, 0.002, 0.008, 0.01]
    assert [tick.actual for tick in found] == [50 + 0.002 * k for k in (7, 8, 11, 12)]


@pytest.mark.parametrize("numbers", [[0, 1, 1], [5, 6, 4]])
def test_samples_of_a_device_that_go_back_are_a_device_error(numbers: list[int]) -> None:
    clock = DeviceClock()
    clock.start(0.002)

    with pytest.raises(DeviceError, match="don't come in order"):
        device_samples(clock, numbers)


def test_each_timing_has_its_clock() -> None:
    for timing in ("virtual", "host", "device"):
        assert clock_for(timing).timing == timing
