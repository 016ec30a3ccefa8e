"""Row 27: a clock that is set, and a computer that sleeps. No recording's time repeats or goes back.

A device whose time goes back, or stands, is refused as a device that fails, as one whose samples come out of order is: nobody can
say any more when its samples were taken, and what was recorded before stays right. A jump ahead keeps the order; it is recorded
as it came, and told. (Where it is longer than the watchdog waits, nobody can tell it from a motor that was left alone.)
"""

import time
from collections.abc import Callable

import numpy as np
import pytest

from servobench.recordings.recording import Recording
from servobench.rig.clock import HostClock
from servobench.rig.devices.base import Device
from servobench.rig.devices.faults.base import fault_from, table_of
from servobench.rig.devices.faulty import Faulty
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import Experiment
from servobench.rig.loop.run import run
from servobench.rig.lost_device import DeviceLost
from tests.rig.devices.faults import Numbered
from tests.rig.loop.shaft import Shaft, experiment

H = 0.002
EXPERIMENT = Experiment(duration=2.0, sample_time=H)


def outcome(device: Device) -> Recording:
    """The recording, whichever way the run ended."""
    with device:
        try:
            return run(EXPERIMENT, device)
        except DeviceLost as lost:
            return lost.recording


def times(recording: Recording) -> np.ndarray:
    t = recording["counts"].t
    assert t is not None
    return t


def devices() -> dict[str, Callable[[], Device]]:
    return {"virtual": Twin, "device": lambda: Numbered(lambda k: k)}


@pytest.mark.promise("S33")
@pytest.mark.parametrize("timing", devices())
@pytest.mark.parametrize(
    "text",
    [
        "clock_step from=1s by=-1s",
        "clock_step from=1s by=-2ms",  # the time of the sample before, once more
        "clock_step from=1s by=-3ms",
        "clock_step from=1s by=50ms for=100ms",  # ahead, and back
        "clock_stuck from=1s for=100ms",
        "clock_stuck from=1s for=2ms",
        "restart from=1s",
        "repeated from=1s every=7",
    ],
)
def test_a_time_that_repeats_or_goes_back_ends_the_run_before_it_is_recorded(timing: str, text: str) -> None:
    recording = outcome(Faulty(devices()[timing](), [fault_from(table_of(text))]))

    # A clock that stands for one sample repeats nothing; it only seems to do so at the next.
    if text == "clock_stuck from=1s for=2ms":
        assert recording.stopped.reason == "finished"
    else:
        # A restarted twin's counter begins anew as well, which the guard sees before the clock sees the sample.
        at_the_guard = text.startswith("restart") and timing == "virtual"
        assert recording.stopped.reason == ("fault" if at_the_guard else "device_lost")
        assert 500 <= len(times(recording)) <= 560
    assert (np.diff(times(recording)) > 0).all()


@pytest.mark.promise("S33")
@pytest.mark.parametrize("timing", devices())
def test_a_jump_ahead_is_recorded_as_it_came_and_reported_with_its_time_and_size(timing: str) -> None:
    recording = outcome(Faulty(devices()[timing](), [fault_from(table_of("clock_step from=1s by=50ms"))]))

    assert recording.stopped.reason == "finished"
    shift = times(recording) - recording["scheduled"].values
    assert shift == pytest.approx(np.where(np.arange(1000) < 500, 0.0, 0.05), abs=1e-9)
    (finding,) = [finding for finding in recording.findings if finding.code == "clock-stepped"]
    assert "jumped by 50 ms at 1 s" in finding.sentence


@pytest.mark.promise("S33")
@pytest.mark.parametrize("timing", devices())
def test_a_jump_ahead_that_is_longer_than_the_watchdog_waits_ends_the_run(timing: str) -> None:
    recording = outcome(Faulty(devices()[timing](), [fault_from(table_of("clock_step from=1s by=1h"))]))

    assert recording.stopped.reason == "fault"
    assert times(recording).tolist() == pytest.approx([k * H for k in range(500)])


@pytest.mark.parametrize(
    "text",
    ["jitter largest=1.9ms", "slow_read every=60 takes=7ms", "lost every=60"],
)
def test_lateness_and_loss_are_no_steps_of_the_clock(text: str) -> None:
    recording = outcome(Faulty(Twin(), [fault_from(table_of(text))]))

    assert recording.stopped.reason == "finished"
    assert "clock-stepped" not in [finding.code for finding in recording.findings]
    assert (np.diff(times(recording)) > 0).all()


@pytest.mark.promise("S33")
def test_the_computers_clock_that_is_set_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wall time is a label: a run whose wall clock is set by a year, at each look another way, is the same to the bit."""
    plain = outcome(Twin())
    jumps = iter(range(10**9))
    monkeypatch.setattr(time, "time", lambda: 1e9 + (-1) ** next(jumps) * 3.15e7)
    monkeypatch.setattr(time, "time_ns", lambda: int(1e18) + (-1) ** next(jumps) * int(3.15e16))

    assert outcome(Twin()).series == plain.series


@pytest.mark.promise("S33")
def test_the_hosts_clock_is_a_monotonic_one() -> None:
    assert time.get_clock_info("perf_counter").monotonic
    assert not time.get_clock_info("perf_counter").adjustable


@pytest.mark.promise("S33")
def test_a_computer_that_sleeps_in_the_middle_has_missed_those_ticks_and_says_so() -> None:
    """A suspend of an hour, as a host clock sees it that counts it: the motor was on its own, so the run ends there."""
    seconds = [0.0]

    def now() -> float:
        seconds[0] += 1e-6
        return seconds[0]

    def sleep(duration: float) -> None:
        seconds[0] += duration

    def suspend(index: int) -> None:
        if index == 50:
            seconds[0] += 3600.0

    shaft = Shaft(timing="host", on_write=suspend)
    recording = run(
        experiment(duration=7200.0, sample_time=0.01), shaft, clock=HostClock(now=now, sleep=sleep)
    )

    t = times(recording)
    assert recording.stopped.reason == "fault"
    assert len(t) == 52
    assert t[-1] == pytest.approx(3600.5, abs=0.02)
    assert (np.diff(t) > 0).all()
    (finding,) = [finding for finding in recording.findings if finding.code == "samples-missed"]
    # The tick at 0.50 s went on to 3600.50 s and some looks at the clock; the next is the one that is due then.
    assert int(finding.sentence.split()[0]) == round(recording["scheduled"].values[-1] / 0.01) - 51
