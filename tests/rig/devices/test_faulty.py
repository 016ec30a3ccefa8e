"""Injected faults do what they say and nothing else: held sample by sample against the undisturbed run of the same seed."""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from servobench.core.channels import Sample
from servobench.core.errors import DeviceError, UnknownName, UsageError
from servobench.core.finding import Severity
from servobench.recordings.recording import Stopped
from servobench.rig.devices.base import Device, RunEnded
from servobench.rig.devices.faults.base import FAULTS, Fault, fault_from, table_of, text_of
from servobench.rig.devices.faulty import Faulty, injection_findings
from servobench.rig.devices.replay import Replay
from servobench.rig.devices.twin import Twin, TwinSettings
from servobench.rig.experiment import Experiment
from servobench.rig.loop.run import run
from tests.rig.devices.faults import MOTOR, H, Numbered, driven, fault, faulty, undisturbed

FIRST, LAST = 500, 549  # the samples of 1.0 s to 1.1 s, without the one at its end
TIME = "from=1s for=100ms"

EXAMPLES = {
    "blocked_shaft": f"blocked_shaft {TIME}",
    "clock_step": "clock_step from=1s by=50ms",
    "clock_stuck": f"clock_stuck {TIME}",
    "counter_wrap": "counter_wrap bits=16 start=32767",
    "device_unplugged": "device_unplugged from=1s",
    "dropouts": f"dropouts {TIME} share=0.5",
    "encoder_flipped": f"encoder_flipped {TIME}",
    "encoder_unplugged": f"encoder_unplugged {TIME}",
    "jitter": f"jitter {TIME} largest=1ms",
    "lost": f"lost {TIME} every=10",
    "nan": f"nan {TIME} channel=current",
    "repeated": f"repeated {TIME} every=10",
    "restart": "restart from=1s",
    "slow_read": f"slow_read {TIME} every=10 takes=5ms",
    "stale": f"stale {TIME} every=10",
    "starved": f"starved {TIME}",
    "stuck_channel": f"stuck_channel {TIME} channel=B",
}
"""Each fault once, with nothing wrong before 1 s."""


def counts(samples: list[Sample]) -> list[int]:
    return [sample.counts for sample in samples]


def some_of(device: Device, ticks: int) -> list[Sample]:
    """The samples of so many ticks, or those before the device fails."""
    samples = []
    with device:
        device.start(H, 5)
        for _ in range(ticks):
            try:
                samples.append(device.read())
                device.write(4.0)
            except DeviceError:
                break
    return samples


def test_every_fault_has_an_example_here_and_a_test_of_its_own() -> None:
    """A new fault fails here until it is tested: its name stands in the name of a test of this file."""
    told = Path(__file__).read_text(encoding="utf-8")

    assert set(EXAMPLES) == set(FAULTS.names())
    assert [name for name in FAULTS.names() if f"def test_{name}_" not in told] == []


# What holds for every fault.


@pytest.mark.parametrize("name", [name for name in FAULTS.names() if name not in ("counter_wrap", "starved")])
def test_nothing_is_wrong_before_its_time_and_something_is_afterwards(name: str) -> None:
    plain, found = undisturbed(700), some_of(faulty(EXAMPLES[name]), 700)

    assert found[:FIRST] == plain[:FIRST]
    # Not the samples, as NaN differs from itself.
    assert str(found[FIRST:]) != str(plain[FIRST:])


@pytest.mark.promise("S40")
@pytest.mark.parametrize("name", FAULTS.names())
def test_the_same_seed_gives_the_same_faults_and_a_second_run_of_a_device_is_like_its_first(
    name: str,
) -> None:
    device = faulty(EXAMPLES[name])

    once, again, elsewhere = (some_of(each, 700) for each in (device, device, faulty(EXAMPLES[name])))

    assert str(once) == str(again) == str(elsewhere)


@pytest.mark.promise("S40")
@pytest.mark.parametrize("name", FAULTS.names())
def test_it_is_reported_in_the_info_and_the_recording_wherever_the_run_ends(name: str) -> None:
    device = faulty(EXAMPLES[name])
    told = text_of(fault(EXAMPLES[name]))

    assert dict(device.info.settings)["faults"] == told
    with device:
        try:
            recording = run(Experiment(duration=1.5, sample_time=H), device)
        except DeviceError as lost:
            recording = lost.recording  # type: ignore[attr-defined]
    marks = [finding for finding in recording.findings if finding.code == "faults-injected"]
    assert [finding.severity for finding in marks] == [Severity.WARNING]
    assert told in marks[0].sentence


@pytest.mark.parametrize("name", FAULTS.names())
def test_its_text_reads_back_the_same(name: str) -> None:
    asked = fault(EXAMPLES[name])

    assert fault(text_of(asked)) == asked


@pytest.mark.promise("S39")
def test_without_faults_it_is_the_device_itself() -> None:
    device = faulty()

    assert device.info == Twin(MOTOR).info
    assert injection_findings(device.info) == ()
    assert driven(device, 200) == undisturbed(200)


def test_chance_has_a_seed_of_its_own_or_the_runs() -> None:
    def lost(seed: int | None) -> list[int]:
        return [sample.index for sample in driven(faulty("lost probability=0.2", seed=seed), 300)]

    assert lost(5) == lost(None)  # the run's is 5
    assert lost(6) != lost(5)


def test_the_chance_of_one_fault_does_not_depend_on_another() -> None:
    alone = driven(faulty("lost probability=0.2"), 300)
    together = driven(faulty("lost probability=0.2", "nan channel=current probability=0.3"), 300)

    assert [sample.index for sample in alone] == [sample.index for sample in together]
    assert any(math.isnan(sample.current or 0.0) for sample in together)


def test_a_probability_is_met_as_often_as_it_says() -> None:
    found = driven(faulty("nan channel=current probability=0.1"), 4000)

    struck = sum(math.isnan(sample.current or 0.0) for sample in found)
    # A binomial number of 4000 at 0.1 has a standard deviation of 19; five of them are passed once in two million seeds.
    assert abs(struck - 400) < 5 * math.sqrt(4000 * 0.1 * 0.9)


@pytest.mark.promise("S41")
def test_a_stop_reaches_the_motor_of_an_unplugged_device() -> None:
    motor = Twin(MOTOR)
    device = Faulty(motor, [fault("device_unplugged from=1s")])
    with device:
        device.start(H, 0)
        for _ in range(500):
            device.read()
            device.write(4.0)
        with pytest.raises(DeviceError):
            device.read()
        assert motor.state.speed > 50
        device.stop()
        # Friction stops an undriven shaft within some time constants of 0.1 s.
        assert motor.coast(5.0).speed == 0.0


# What each one does.


def test_jitter_latches_late_and_says_so() -> None:
    plain, found = undisturbed(600), driven(faulty(f"jitter {TIME} largest=1ms"), 600)

    lateness = np.array([a.time - b.time for a, b in zip(found, plain, strict=True)])
    assert [sample.index for sample in found] == list(range(600))
    assert (lateness[:FIRST] == 0).all()
    assert (lateness[LAST + 1 :] == 0).all()
    assert (lateness[FIRST : LAST + 1] > 0).all()
    assert lateness.max() < 1e-3
    # The mean of 50 uniform numbers scatters by 1 ms / sqrt(12 · 50).
    assert lateness[FIRST : LAST + 1].mean() == pytest.approx(5e-4, abs=4 * 1e-3 / math.sqrt(600))


def test_jitter_that_is_not_recorded_gives_the_same_counts_with_the_times_of_the_schedule() -> None:
    said, unsaid = (
        driven(faulty(f"jitter {TIME} largest=1ms recorded={word}"), 600) for word in ("true", "false")
    )

    assert counts(said) == counts(unsaid)
    assert [sample.time for sample in unsaid] == pytest.approx([k * H for k in range(600)], abs=1e-12)


def test_jitter_shows_the_motor_where_it_is_at_the_late_time() -> None:
    """By algebra: at a steady 4 V nothing is known of the voltage's time, and counts grow by speed times lateness."""
    device = faulty(
        "jitter from=1s largest=1.9ms", motor=TwinSettings(counts_per_rev=10_000_000, counter_bits=32)
    )
    found = driven(device, 700)

    t = np.array([sample.time for sample in found[FIRST:]])
    angle = np.array(counts(found[FIRST:]), dtype=np.float64)
    # After 1 s, ten time constants, what is left of the start is 5e-5 of the speed; a line through times that scatter fits the
    # counts to that and to their rounding, a line through the schedule misses them by speed times lateness, a hundred times more.
    scheduled = np.arange(FIRST, 700) * H
    late, schedule = (
        np.abs(angle - np.polyval(np.polyfit(x - 1, angle, 2), x - 1)).max() for x in (t, scheduled)
    )
    assert late < 0.02 * schedule


def test_jitter_of_whole_ticks_is_refused_before_anything_moves() -> None:
    with faulty("jitter largest=2ms") as device, pytest.raises(UsageError, match="less than the sample time"):
        device.start(H, 0)


def test_slow_read_skips_the_ticks_that_go_by_and_is_late_by_the_rest() -> None:
    found = driven(faulty(f"slow_read {TIME} every=10 takes=5ms"), 560)

    # The tenth, twentieth... sample of 1.0 s and later takes 5 ms: two ticks go by, and 1 ms of the third.
    gaps = [(a.index, b.index - a.index) for a, b in pairwise(found) if b.index - a.index > 1]
    assert gaps == [(508, 3), (520, 3), (532, 3), (544, 3)]
    late = {sample.index: sample.time - sample.index * H for sample in found}
    assert {index for index, lateness in late.items() if lateness > 1e-9} == {511, 523, 535, 547}
    assert [late[index] for index in (511, 523, 535, 547)] == pytest.approx([1e-3] * 4)


def test_slow_read_holds_the_voltage_through_the_ticks_that_go_by() -> None:
    """A slow read of exactly two ticks leaves a motor that was driven as if those two answers had never been given."""
    found = driven(faulty("slow_read from=1s for=1ms takes=4ms"), 600, lambda k: 4.0 + (k % 2))
    plain = undisturbed(602, lambda k: 4.0 + (499 % 2 if k in (500, 501) else k % 2))

    assert found == [sample for sample in plain if sample.index not in (500, 501)]


def test_slow_read_sleeps_by_host_time() -> None:
    slept: list[float] = []
    device = Faulty(
        Numbered(lambda k: k, timing="host"), [fault("slow_read every=3 takes=5ms")], sleep=slept.append
    )

    assert counts(driven(device, 9)) == list(range(9))
    assert slept == [0.005] * 3


def test_lost_leaves_exactly_those_samples_out_and_changes_no_other() -> None:
    found = driven(faulty(f"lost {TIME} every=10"), 600)

    missing = sorted(set(range(605)) - {sample.index for sample in found})
    assert missing == [509, 519, 529, 539, 549]
    # The input held through a gap: the answer to the sample before stays, which here is the same voltage.
    assert found == [sample for sample in undisturbed(605) if sample.index not in missing]


def test_lost_for_a_time_loses_all_of_it() -> None:
    found = driven(faulty(f"lost {TIME}"), 600)

    assert sorted(set(range(650)) - {sample.index for sample in found}) == list(range(FIRST, LAST + 1))


def test_lost_without_an_end_is_refused() -> None:
    with pytest.raises(UsageError, match="lose every sample"):
        table_of("lost")
    with pytest.raises(UsageError, match="lose every sample"):
        table_of("lost probability=1")


def test_repeated_gives_a_sample_twice_and_loses_none() -> None:
    found = driven(faulty(f"repeated {TIME} every=10"), 600)

    twice = [b.index for a, b in pairwise(found) if a == b]
    assert twice == [509, 519, 529, 539, 549]
    once = [sample for k, sample in enumerate(found) if not (k and sample == found[k - 1])]
    assert once == undisturbed(595)


def test_stale_gives_the_values_before_under_a_new_number_and_time() -> None:
    plain, found = undisturbed(600), driven(faulty(f"stale {TIME} every=10"), 600)

    for k in range(600):
        if k in (509, 519, 529, 539, 549):
            assert found[k] == replace(plain[k - 1], index=k, time=k * H)
        else:
            assert found[k] == plain[k]


def test_counter_wrap_shows_the_low_bits_and_says_so() -> None:
    device = faulty("counter_wrap bits=16 start=32000")
    found = driven(device, 600)

    plain = undisturbed(600)
    assert device.info.channel("counts").counter_bits == 16  # type: ignore[union-attr]
    assert min(counts(found)) < 0 <= min(counts(plain))  # it wrapped
    assert [(sample.counts - 32000) % 65536 for sample in found] == [
        sample.counts % 65536 for sample in plain
    ]
    assert all(-32768 <= sample.counts < 32768 for sample in found)


def test_counter_wrap_of_a_start_that_can_not_be_shown_is_refused() -> None:
    with pytest.raises(UsageError, match="expected -32768 to 32767"):
        table_of("counter_wrap bits=16 start=32768")


def test_dropouts_lose_edges_in_bursts_and_never_give_them_back() -> None:
    plain = undisturbed(700)
    found = driven(faulty("dropouts from=1s for=10ms burst=100ms share=0.25"), 700)

    lost = np.array(counts(plain)) - np.array(counts(found))
    edges = plain[FIRST + 50].counts - plain[FIRST].counts
    assert (np.diff(lost) >= 0).all()  # forward motion: counts are missing
    assert lost[FIRST] == 0
    assert len(set(lost[FIRST + 50 :])) == 1
    # A binomial number of `edges` at a quarter.
    assert lost[-1] == pytest.approx(0.25 * edges, abs=5 * math.sqrt(edges * 0.25 * 0.75))


def test_dropouts_of_all_edges_lose_all_of_a_burst_in_either_direction() -> None:
    for sign in (1, -1):
        plain = undisturbed(600, lambda k, s=sign: 4.0 * s)
        found = driven(faulty("dropouts from=1s for=10ms burst=20ms share=1"), 600, lambda k, s=sign: 4.0 * s)

        expected = [c - plain[min(max(k, FIRST), FIRST + 10)].counts for k, c in enumerate(counts(plain))]
        assert counts(found) == [c + plain[FIRST].counts for c in expected]


def test_starved_keeps_the_last_voltage_where_nothing_watches_and_passes_the_next_on() -> None:
    def voltage(k: int) -> float:
        return 4.0 if k < FIRST else -4.0

    found = driven(faulty(f"starved {TIME}"), 600, voltage)
    late = driven(Twin(MOTOR), 600, lambda k: 4.0 if k <= LAST else -4.0)

    assert counts(found) == counts(late)


def test_starved_lets_a_watchdog_expire_and_the_stop_goes_through() -> None:
    watched = TwinSettings(watchdog="20 ms")
    motor, held = Twin(watched), Twin(MOTOR)
    for twin, ends in ((motor, True), (held, False)):
        device = Faulty(twin, [fault("starved from=1s")])
        with device:
            device.start(H, 0)
            for _ in range(1500):
                device.read()
                device.write(4.0)
            # By 2 s after the cut friction has stopped the shaft; 4 V make more than 90 rad/s.
            assert (twin.state.speed == 0.0) == ends
            device.stop()
            assert twin.coast(5.0).speed == 0.0


def test_starved_needs_a_device_that_is_driven() -> None:
    with pytest.raises(UsageError, match="no voltage drives it"):
        Faulty(replayed(), [fault("starved")])


def test_starved_goes_on_after_a_device_that_ends_the_run_and_only_then() -> None:
    class Ending(Twin):
        def read(self) -> Sample:
            sample = super().read()
            if sample.index == 520:
                raise RunEnded(Stopped(reason="fault", sentence="its watchdog tripped"))
            return sample

    found = driven(Faulty(Ending(MOTOR), [fault(f"starved {TIME}")]), 600)
    assert [sample.index for sample in found][518:523] == [518, 519, 521, 522, 523]

    with pytest.raises(RunEnded):
        driven(Faulty(Ending(MOTOR), [fault("starved from=1.1s")]), 600)


@pytest.mark.parametrize("channel", ["A", "B"])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("first", range(4))
def test_stuck_channel_is_what_a_decoder_makes_of_the_levels_edge_by_edge(
    channel: str, sign: int, first: int
) -> None:
    """Truth: two square waves a quarter apart, one of them held, and the decoder's table of the open rig's firmware."""
    table = [0, 1, -1, None, -1, 0, None, 1, 1, None, 0, -1, None, -1, 1, 0]

    def levels(count: int, held: int | None) -> int:
        a, b = int(count % 4 in (1, 2)), int(count % 4 in (2, 3))
        held_a, held_b = channel == "A" and held is not None, channel == "B" and held is not None
        return (held if held_a else a) | (held if held_b else b) << 1  # type: ignore[operator]

    def true(k: int) -> int:
        return first + sign * 7 * k

    expected, seen, decoded, held, bad = [], levels(true(0), None), true(0), None, 0
    which = 0 if channel == "A" else 1
    for k in range(40):
        for count in range(true(k - 1) if k else true(0), true(k) + sign, sign) if k else []:
            now = levels(count, held)
            step = table[seen << 2 | now]
            bad += step is None
            decoded, seen = decoded + (step or 0), now
        if k == 10:
            held = levels(true(k), None) >> which & 1
        if k == 30:
            held = None
            now = levels(true(k), None)
            step = table[seen << 2 | now]
            bad += step is None
            decoded, seen = decoded + (step or 0), now
        expected.append(decoded)

    device = Faulty(Numbered(true, 16), [fault(f"stuck_channel from=20ms for=40ms channel={channel}")])
    found = counts(driven(device, 40))

    assert bad == 0  # no transition against the rules: nothing in a decoder can tell
    assert found == expected
    assert max(found[10:30]) - min(found[10:30]) == 1  # it dithers by one count


def test_stuck_channel_loses_what_the_shaft_goes_meanwhile() -> None:
    plain, found = undisturbed(700), driven(faulty(f"stuck_channel {TIME}"), 700)

    offset = [a - b for a, b in zip(counts(plain), counts(found), strict=True)]
    assert len(set(offset[LAST + 1 :])) == 1
    went = plain[LAST + 1].counts - plain[FIRST].counts
    assert abs(offset[-1] - went) <= 2


def test_encoder_unplugged_keeps_its_counts_and_goes_on_from_there() -> None:
    plain, found = undisturbed(700), driven(faulty(f"encoder_unplugged {TIME}"), 700)

    held = plain[FIRST].counts
    assert set(counts(found[FIRST : LAST + 2])) == {held}
    missing = plain[LAST + 1].counts - held
    assert counts(found[LAST + 1 :]) == [sample.counts - missing for sample in plain[LAST + 1 :]]


def test_encoder_flipped_counts_backwards_from_where_it_was_and_forwards_again_afterwards() -> None:
    plain, found = counts(undisturbed(700)), counts(driven(faulty(f"encoder_flipped {TIME}"), 700))

    assert found[: FIRST + 1] == plain[: FIRST + 1]
    went = [after - before for before, after in pairwise(plain)]
    shown = [after - before for before, after in pairwise(found)]
    assert shown[FIRST : LAST + 1] == [-step for step in went[FIRST : LAST + 1]]
    assert shown[LAST + 1 :] == went[LAST + 1 :]
    assert min(went[FIRST:]) > 0  # the motor itself turned on


def test_device_unplugged_fails_each_read_and_write_from_then_on() -> None:
    with faulty("device_unplugged from=1s") as device:
        device.start(H, 5)
        found = []
        for _ in range(FIRST):
            found.append(device.read())
            device.write(4.0)
        for _ in range(3):
            with pytest.raises(DeviceError, match="unplugged on purpose"):
                device.read()
            with pytest.raises(DeviceError, match="unplugged on purpose"):
                device.write(4.0)

    assert found == undisturbed(FIRST)


def test_restart_begins_anew_without_a_voltage() -> None:
    motor = Twin(MOTOR)
    applied = []
    with Faulty(motor, [fault("restart from=1s")]) as device:
        device.start(H, 5)
        found = []
        for _ in range(1500):
            found.append(device.read())
            applied.append(device.write(4.0))
        assert motor.state.speed == 0.0

    assert (found[FIRST].index, found[FIRST].time, found[FIRST].counts) == (0, 0.0, 0)
    assert [sample.index for sample in found] == [*range(FIRST), *range(1000)]
    assert applied == [4.0] * FIRST + [0.0] * 1000
    coasting = undisturbed(1500, lambda k: 4.0 if k < FIRST else 0.0)
    assert counts(found[FIRST:]) == [sample.counts - coasting[FIRST].counts for sample in coasting[FIRST:]]


@pytest.mark.parametrize("channel", ["current", "tachometer"])
def test_nan_takes_the_place_of_that_value_alone(channel: str) -> None:
    plain, found = undisturbed(600), driven(faulty(f"nan {TIME} channel={channel}"), 600)

    for k in range(600):
        if FIRST <= k <= LAST:
            assert math.isnan(getattr(found[k], channel))
            assert replace(found[k], **{channel: 0.0}) == replace(plain[k], **{channel: 0.0})
        else:
            assert found[k] == plain[k]


def test_nan_as_the_devices_answer_changes_nothing_of_what_it_does() -> None:
    found, answers = [], []
    with faulty(f"nan {TIME}") as device:
        device.start(H, 5)
        for _ in range(600):
            found.append(device.read())
            answers.append(device.write(4.0))

    assert found == undisturbed(600)
    assert [k for k, answer in enumerate(answers) if math.isnan(answer)] == list(range(FIRST, LAST + 1))


def test_clock_step_shifts_the_times_and_nothing_else() -> None:
    plain, found = undisturbed(600), driven(faulty("clock_step from=1s for=100ms by=-30ms"), 600)

    assert [replace(sample, time=0.0) for sample in found] == [replace(sample, time=0.0) for sample in plain]
    shift = [a.time - b.time for a, b in zip(found, plain, strict=True)]
    assert shift == pytest.approx([-0.03 if FIRST <= k <= LAST else 0.0 for k in range(600)], abs=1e-12)


def test_clock_stuck_repeats_the_time_and_nothing_else() -> None:
    plain, found = undisturbed(600), driven(faulty(f"clock_stuck {TIME}"), 600)

    assert [replace(sample, time=0.0) for sample in found] == [replace(sample, time=0.0) for sample in plain]
    assert [sample.time for sample in found] == [
        plain[FIRST].time if FIRST <= k <= LAST else plain[k].time for k in range(600)
    ]


@pytest.mark.parametrize("inductance", [0.0, 1.16e-3])
def test_blocked_shaft_stands_and_draws_the_stall_current(inductance: float) -> None:
    motor = TwinSettings(inductance=inductance)
    device = faulty(f"blocked_shaft {TIME}", motor=motor)
    found = driven(device, 700)

    assert len({sample.counts for sample in found[FIRST : LAST + 2]}) == 1
    resolution = device.info.channel("current").resolution  # type: ignore[union-attr]
    stall = 4.0 / motor.parameters.resistance
    # Ten ticks are 20 ms, over a hundred electrical time constants of 0.14 ms; the channel rounds by half its step.
    for sample in found[FIRST + 10 : LAST + 2]:
        assert sample.current == pytest.approx(stall, abs=0.5 * resolution)  # type: ignore[operator]
    # Let go, it starts as a motor at rest does, but for its current, which is there already: it is ahead by the electrical time
    # constant at most; of two differences of counts that are rounded down one may be larger by less than two.
    steps = np.diff(counts(found[LAST + 1 :])).max()
    ahead = 1.01 * steps / H * motor.parameters.inductance / motor.parameters.resistance
    assert [c - found[LAST + 1].counts for c in counts(found[LAST + 1 :])] == pytest.approx(
        [c - found[0].counts for c in counts(found[: 700 - LAST - 1])], abs=2 + ahead
    )


def test_blocked_shaft_is_let_go_in_the_next_run() -> None:
    device = faulty("blocked_shaft from=1s")
    first = some_of(device, 600)

    assert driven(device, 400) == undisturbed(400) == first[:400]


# What a device can't have.


def replayed() -> Device:
    with Twin(TwinSettings(current_sensor=False)) as motor:
        return Replay(run(Experiment(duration=0.2, sample_time=H), motor))


@pytest.mark.promise("S41")
@pytest.mark.parametrize(
    ("text", "device", "reason"),
    [
        ("blocked_shaft", replayed, "simulated motor"),
        ("jitter", replayed, "by its own clock"),
        ("slow_read", replayed, "by its own clock"),
        ("nan channel=current", replayed, "no channel 'current'"),
        ("nan channel=tachometer", Twin, "no channel 'tachometer'"),
        ("counter_wrap bits=32", Twin, "24 bits"),
        ("lost every=9", lambda: Twin(TwinSettings(timing="host")), "clock numbers its samples"),
        ("clock_step", lambda: Twin(TwinSettings(timing="host")), "the host's time"),
        ("clock_stuck", lambda: Twin(TwinSettings(timing="host")), "the host's time"),
        ("jitter", lambda: Twin(TwinSettings(timing="host")), "recorded = false"),
    ],
)
def test_a_fault_that_a_device_can_not_have_is_refused_with_those_it_can_have(
    text: str,
    device: type[Twin],
    reason: str,
) -> None:
    with pytest.raises(UsageError, match=reason) as refused:
        Faulty(device(), [fault(text)])

    able = str(refused.value).partition("possible faults: ")[2].split(", ")
    assert "stuck_channel" in able
    assert set(able) <= set(FAULTS.names())


@pytest.mark.parametrize("name", FAULTS.names())
def test_what_is_listed_as_possible_is_possible(name: str) -> None:
    """The list is right for the replay: each fault is in it, or refused."""
    with pytest.raises(UsageError) as refused:
        Faulty(replayed(), [fault("blocked_shaft")])
    able = str(refused.value).partition("possible faults: ")[2].split(", ")

    asked = fault(EXAMPLES[name].replace("channel=current", "channel=applied"))
    assert (asked.unsupported(replayed()) is None) == (name in able)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "a name and settings"),
        ("lost 'every=3", "can't be read"),
        ("lost every", "key=value"),
        ("lost every=3 every=4", "occurs twice"),
        ("lost every=0", "greater than or equal to 1"),
        ("lost every=3 probability=0.1", "leave one of them out"),
        ("stuck_channel from=-1s", "from"),
        ("stuck_channel form=1s", "did you mean 'for'"),
        ("stuck_channel channel=C", "'A' or 'B'"),
        ("stuck_channel from=2V", "from"),
    ],
)
def test_a_text_that_describes_no_fault_is_refused(text: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        table_of(text)


def test_an_unknown_fault_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UnknownName, match="stuck_channel"):
        table_of("stuck_chanel")


def test_a_fault_takes_its_settings_by_their_names_in_python_and_in_a_file() -> None:
    kind = FAULTS["stuck_channel"]

    assert kind.model_validate({"from_": 2.0, "for_": 0.1}) == fault_from(
        {"name": "stuck_channel", "from": "2 s", "for": "100 ms"}
    )
    with pytest.raises(ValidationError):
        kind.model_validate({"form": 2.0})
    assert issubclass(kind, Fault)
