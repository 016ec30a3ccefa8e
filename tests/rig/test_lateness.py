"""The lateness of samples, with times that the tests make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from servobench.core.channels import Sample, Timing
from servobench.recordings.measurement.tick_times import write_times
from servobench.recordings.recording import Recording
from servobench.rig.clock import DeviceClock, HostClock, Missed, Phase
from servobench.rig.devices.guarded import Guarded
from servobench.rig.experiment import Experiment, WhenLate
from servobench.rig.lateness import lateness
from servobench.rig.loop.run import run
from tests.rig.loop.shaft import Shaft, experiment
from tests.rig.test_clock import FakeTime

RULES: list[tuple[Missed, Phase]] = [
    ("discard", "keep"),
    ("discard", "lose"),
    ("process", "keep"),
    ("process", "lose"),
]


def stalled(asked: Experiment, stall: Callable[[int], float]) -> Recording:
    """A run on a shaft in host time, in which tick k takes so long [s]."""
    time = FakeTime()

    def busy(index: int) -> None:
        time.seconds += stall(index)

    clock = HostClock(
        missed=asked.when_late.missed, phase=asked.when_late.phase, now=time.now, sleep=time.sleep
    )
    return run(asked, guarded(Shaft("host", on_write=busy), asked, time), clock=clock)


def guarded(device: Shaft, asked: Experiment, time: FakeTime) -> Guarded:
    """A device whose watchdog goes by the time that is made, too: by the wall's a busy machine would stop the motor."""
    return Guarded(device, asked.limits, now=lambda: time.seconds)


@pytest.mark.parametrize(("missed", "phase"), RULES)
def test_late_and_missed_ticks_are_counted_by_each_rule(missed: Missed, phase: Phase) -> None:
    """Of 100 ticks of 10 ms the tenth that is done takes 25 ms, the eleventh 43 ms, and all others nothing."""
    asked = experiment(when_late=WhenLate(missed=missed, phase=phase))
    recording = stalled(asked, lambda index: {9: 0.025, 10: 0.043}.get(index, 0.0))

    found = lateness(recording)

    assert found is not None
    assert found.samples + found.missed == 100
    assert found.late == np.count_nonzero(recording["late"].values)
    # By hand; tick 9 is over at 115 ms, and the next that is done at 158 ms.
    # Discard, keep: 10 is missed, 11 done at 115 ms; 12 to 14 are missed, 15 (due at 150 ms) is done at 158 ms.
    # Discard, lose: the same, but 12 to 15 are due at 125 to 155 ms.
    # Process, keep: 10 is done at 115 ms, 11 to 15 (due at 110 to 150 ms) at 158 ms.
    # Process, lose: 10 is done at 115 ms, 11 (due at 125 ms) at 158 ms, and 12 at its new time, 168 ms.
    assert (found.missed, found.late) == {
        ("discard", "keep"): (4, 2),
        ("discard", "lose"): (4, 2),
        ("process", "keep"): (0, 6),
        ("process", "lose"): (0, 2),
    }[missed, phase]
    assert (found.missed_rule, found.phase_rule) == (missed, phase)


def test_ticks_before_the_first_sample_are_missed() -> None:
    whole = stalled(experiment(), lambda index: 0.0)
    begun_late = replace(
        whole,
        series=tuple(
            replace(each, values=each.values[3:], t=None if each.t is None else each.t[3:])
            for each in whole.series
        ),
    )

    found = lateness(begun_late)

    assert found is not None
    assert (found.samples, found.missed) == (97, 3)


@pytest.mark.parametrize(("missed", "phase"), RULES)
def test_every_tick_is_accounted_for_whatever_happens(missed: Missed, phase: Phase) -> None:
    """100 % of the missed ticks are counted: samples and missed ticks are all ticks, or those up to the last sample's."""
    random = np.random.default_rng(4)
    asked = experiment(duration=20.0, when_late=WhenLate(missed=missed, phase=phase))
    time = FakeTime()
    device = guarded(Shaft("host"), asked, time)
    numbers: list[int] = []

    class Noted(HostClock):
        """Notes the numbers of the ticks, which a recording doesn't have."""

        def latch(self, index, read):  # type: ignore[no-untyped-def]
            time.seconds += float(random.exponential(0.008))
            tick = super().latch(index, read)
            numbers.append(tick.index)
            return tick

    found = lateness(
        run(asked, device, clock=Noted(missed=missed, phase=phase, now=time.now, sleep=time.sleep))
    )

    within = [number for number in numbers if number < 2000]
    assert found is not None
    assert found.samples == len(within)
    assert found.missed == within[-1] + 1 - len(within)
    assert (found.missed > 0) == (missed == "discard")


def test_the_percentiles_are_those_of_the_lateness_that_was_made() -> None:
    """Of 10,000 ticks of 10 ms, 200 come 300 µs late and 20 of these 4 ms: too little to be missed."""
    late = dict.fromkeys(range(50, 10000, 50), 0.0003) | dict.fromkeys(range(500, 10000, 500), 0.004)
    recording = stalled(
        experiment(duration=100.0), lambda index: 0.01 + late[index + 1] if index + 1 in late else 0.0
    )

    found = lateness(recording)

    assert found is not None
    # Two looks at the clock, of a microsecond each, are the rest.
    assert found.p50 == pytest.approx(0.0, abs=3e-6)
    assert found.p99 == pytest.approx(3e-4, abs=5e-6)
    assert found.p999 == pytest.approx(4e-3, abs=5e-6)
    assert found.largest == pytest.approx(4e-3, abs=5e-6)
    assert (found.samples, found.late, found.missed) == (10_000, 19, 0), recording.stopped
    assert "(99.9th)" in found.sentence


def test_a_device_that_keeps_the_time_is_held_against_its_own_even_pace() -> None:
    """Its count begins at 50 s and runs 100 ppm fast: neither is lateness, the 2 ms by which one sample is off are."""
    recording = run(experiment(), Shaft("device"))
    series = {each.channel.name: each for each in recording.series}
    t = 50 + 1.0001 * series["scheduled"].values
    t[40] += 2e-3

    found = lateness(replace(recording, series=tuple(replace(each, t=t) for each in recording.series)))

    assert found is not None
    # The one sample moves the line by no more than 2 ms · (1/N + its leverage), some 2 % of it.
    assert found.largest == pytest.approx(2e-3, rel=0.05)
    assert found.p99 < 1e-4
    assert (found.late, found.missed) == (0, 0)


def test_in_virtual_time_nothing_is_late_and_nothing_is_said() -> None:
    recording = run(experiment(), Shaft())

    assert lateness(recording) is None
    assert "written" not in recording


@pytest.mark.parametrize("timing", ["virtual", "host"])
def test_a_run_by_the_host_s_clock_tells_lateness_and_writes_of_a_simulation_too(timing: Timing) -> None:
    """Each write takes 300 µs. A motor in virtual time takes a voltage at its sample all the same."""
    time = FakeTime()

    def busy(index: int) -> None:
        time.seconds += 3e-4

    recording = run(
        experiment(), Shaft(timing, on_write=busy), clock=HostClock(now=time.now, sleep=time.sleep)
    )

    found = lateness(recording)
    assert found is not None
    assert (found.late, found.missed) == (0, 0)
    t = recording["applied"].t
    assert t is not None
    # Two looks at the clock more, of a microsecond each.
    assert recording["written"].values - t == pytest.approx(3e-4, abs=3e-6)
    assert (write_times(recording, t) is None) == (timing == "virtual")


def test_a_run_by_the_device_s_clock_notes_the_host_s_time_of_each_sample_and_voltage() -> None:
    """A sample takes 200 µs to be read and a write 300 µs, of a host's time in a count of its own."""
    time = FakeTime()

    class Slow(Shaft):
        def read(self) -> Sample:
            sample = super().read()
            time.seconds = 2000.0 + sample.time + 2e-4
            return sample

    device = Slow("device", on_write=lambda index: time.sleep(3e-4))

    recording = run(experiment(), guarded(device, experiment(), time), clock=DeviceClock(now=time.now))

    t = recording["applied"].t
    assert t is not None
    # Some looks at the clock, of a microsecond each.
    assert recording["handed"].values - recording["received"].values == pytest.approx(0.0, abs=5e-6)
    assert recording["written"].values - recording["handed"].values == pytest.approx(3e-4, abs=5e-6)
    done = write_times(recording, t)
    assert done is not None
    assert done - t == pytest.approx(3e-4, abs=5e-6)


def test_a_device_that_runs_through_its_samples_faster_than_they_were_made_has_no_host_s_times() -> None:
    recording = run(experiment(), Shaft("device"))
    t = recording["applied"].t

    assert t is not None
    assert "received" in recording
    assert write_times(recording, t) is None
