"""Row 13: missed deadlines. Every gap is found by the samples' numbers, and injected equals reported.

More than a tenth missed in half a second stops the motor.
"""

import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from servobench.core.finding import warning
from servobench.identification.trust.doubts.base import DOUBTS
from servobench.recordings.measurement.measure import measure
from servobench.recordings.recording import Recording
from servobench.rig.clock import HostClock
from servobench.rig.devices.faults.base import fault_from, table_of
from servobench.rig.devices.faulty import Faulty
from servobench.rig.devices.twin import Twin
from servobench.rig.experiment import Experiment
from servobench.rig.loop.run import run
from servobench.systems.signals.prbs import PRBS
from tests.rig.loop.shaft import Shaft, experiment

H = 0.01
TICKS = 3000


class HostTime:
    """A host's time that moves on by what is slept, and by a microsecond at each look."""

    def __init__(self) -> None:
        self.seconds = 50.0

    def now(self) -> float:
        self.seconds += 1e-6
        return self.seconds

    def sleep(self, duration: float) -> None:
        self.seconds += duration


def with_stalls(stalls: dict[int, int]) -> Recording:
    """A run whose loop hangs in the write of some ticks, each for so many ticks and a half."""
    host = HostTime()

    def hang(index: int) -> None:
        # The device counts reads; the clock's own count of the tick is the time that has passed.
        tick = round((host.seconds - 50.0) / H - 5)  # the clock begins five ticks ahead
        host.seconds += stalls.get(tick, -0.5) * H + 0.5 * H

    shaft = Shaft(timing="host", on_write=hang)
    return run(
        experiment(duration=TICKS * H, sample_time=H), shaft, clock=HostClock(now=host.now, sleep=host.sleep)
    )


def gaps(recording: Recording) -> dict[int, int]:
    """The missed ticks after each tick, by the scheduled times of the samples."""
    numbers = np.rint(recording["scheduled"].values / H).astype(int).tolist()
    return {a: b - a - 1 for a, b in pairwise(numbers) if b > a + 1}


def reported(recording: Recording) -> int:
    """The number of missed ticks that the run reports."""
    (finding,) = [finding for finding in recording.findings if finding.code == "samples-missed"]
    said = re.match(r"(\d+) of (\d+) samples were missed", finding.sentence)
    assert said is not None
    assert int(said[2]) == TICKS
    return int(said[1])


def chosen(seed: int) -> dict[int, int]:
    """Some dozens of ticks with a stall of 0 to 5 ticks (and a half) each; no two within half a second."""
    random = np.random.default_rng(seed)
    return {
        int(tick): int(random.integers(0, 6)) for tick in range(20, TICKS - 10, 57) if random.random() < 0.8
    }


@pytest.mark.promise("S30")
@pytest.mark.parametrize("seed", range(3))
def test_every_injected_gap_is_found_by_sequence_and_all_of_them_are_reported(seed: int) -> None:
    stalls = chosen(seed)
    recording = with_stalls(stalls)

    # A stall of n ticks and a half from tick k on ends in the middle of tick k + n, done late; the n - 1 before are missed.
    expected = {tick: length - 1 for tick, length in stalls.items() if length > 1}
    assert recording.stopped.reason == "finished"
    assert gaps(recording) == expected
    assert reported(recording) == sum(expected.values())
    assert len(recording["counts"].values) == TICKS - sum(expected.values())


@pytest.mark.promise("S31")
@pytest.mark.parametrize("seed", range(3))
def test_every_late_sample_is_marked_and_no_other(seed: int) -> None:
    stalls = chosen(seed)
    recording = with_stalls(stalls)

    late = np.rint(recording["scheduled"].values[recording["late"].values == 1] / H).astype(int).tolist()
    assert late == [tick + length for tick, length in stalls.items() if length > 0]
    actual, scheduled = recording["counts"].t, recording["scheduled"].values
    assert actual is not None
    assert (np.diff(actual) > 0).all()
    # By half a tick where it is late, and otherwise by the few looks at the clock that a tick takes.
    lateness = actual - scheduled
    assert lateness[recording["late"].values == 1] == pytest.approx(0.5 * H, abs=1e-4)
    assert lateness[recording["late"].values == 0].max() < 1e-4


@pytest.mark.promise("S30")
def test_ticks_that_are_missed_at_the_very_end_are_counted() -> None:
    recording = with_stalls({TICKS - 4: 6})

    assert recording.stopped.reason == "finished"
    assert reported(recording) == 3
    assert len(recording["counts"].values) == TICKS - 3


@pytest.mark.promise("S32")
@pytest.mark.parametrize(("missed", "ends"), [(5, False), (6, True)])
def test_more_than_a_tenth_missed_in_half_a_second_stops_the_motor(missed: int, ends: bool) -> None:
    """At 100 Hz half a second is 50 ticks: 5 missed ones are a tenth, 6 are more."""
    recording = with_stalls({1000: missed + 1})

    if ends:
        assert recording.stopped.reason == "fault"
        assert "6 of the last 50 ticks (0.5 s) were missed" in recording.stopped.sentence
        assert len(recording["counts"].values) == 1002  # with the tick at which it was noticed
    else:
        assert recording.stopped.reason == "finished"


@pytest.mark.promise("S32")
def test_a_motor_that_nobody_controls_any_more_is_stopped_and_comes_to_rest() -> None:
    motor = Twin()
    device = Faulty(motor, [fault_from(table_of("lost from=1s probability=0.3"))])
    with device:
        recording = run(Experiment(duration=10.0), device)
        assert motor.coast(5.0).speed == 0.0

    assert recording.stopped.reason == "fault"
    assert "were missed" in recording.stopped.sentence
    # A third of 250 is reached long before half a second is over: the 26th loss is expected after 87 samples.
    t = recording["counts"].t
    assert t is not None
    assert 1.0 < t[-1] < 1.5


@pytest.mark.promise("S30")
@pytest.mark.parametrize("text", ["lost every=50", "slow_read every=40 takes=5ms", "lost probability=0.02"])
def test_what_a_faulty_device_loses_is_reported_to_the_last_sample(text: str) -> None:
    with Faulty(Twin(), [fault_from(table_of(text))]) as device:
        recording = run(Experiment(duration=6.0), device)

    numbers = np.rint(recording["scheduled"].values / 0.002).astype(int)
    missing = 3000 - len(numbers)
    (finding,) = [finding for finding in recording.findings if finding.code == "samples-missed"]
    assert missing > 30
    assert finding.sentence.startswith(f"{missing} of 3000 samples")
    assert missing == len(set(range(3000)) - set(numbers.tolist()))


def test_an_input_that_held_through_missed_ticks_is_known_and_one_that_nobody_recorded_is_not() -> None:
    with Faulty(Twin(), [fault_from(table_of("slow_read every=200 takes=9ms"))]) as device:
        recording = run(Experiment(signal=PRBS(), duration=10.2), device)
    about = DOUBTS["gaps"].about_data
    assert about is not None

    assert "gap-input-unknown" not in [finding.code for finding in about([measure(recording)])]
    # The same gaps, where rows were lost of ticks that were done: other voltages were written in them.
    lost = replace(recording, findings=(warning("rows-not-recorded", "Rows are missing."),))
    assert "gap-input-unknown" in [finding.code for finding in about([measure(lost)])]
    both = recording.with_findings(warning("rows-not-recorded", "Rows are missing."))
    assert "gap-input-unknown" in [finding.code for finding in about([measure(both)])]
