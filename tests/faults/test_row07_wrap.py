"""Row 7: an encoder counter of 16, 24 or 32 bits wraps, either way. Unwrapped it is exact; a step too long is told."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.recordings.measurement.measure import measure
from servobench.recordings.measurement.unwrap import Unwrap
from servobench.recordings.recording import Recording
from servobench.rig.devices.faults.base import fault_from, table_of
from servobench.rig.devices.faulty import Faulty
from servobench.rig.experiment import Experiment, Limits
from servobench.rig.loop.run import run
from servobench.systems.signals.constant import Constant
from tests.rig.devices.faults import Numbered, wrapped

H = 0.002
BITS = [16, 24, 32]
FAR = 1_000_000_000  # counts: there and back, in either direction


def walk(bits: int, seed: int) -> NDArray[np.int64]:
    """Counts from 0 beyond +1e9, below -1e9 and back, in integers, by steps up to the longest that can be told."""
    random = np.random.default_rng(seed)
    longest = (1 << (bits - 1)) - 1
    # As few samples as the narrow counter allows, and as many with a wide one that it wraps often.
    step = min(longest, FAR // 500)
    legs = []
    for target in (FAR, -2 * FAR, FAR):
        count = (
            abs(target) * 5 // (4 * step) + 1
        )  # a fifth of the steps are a third as long, which leaves 87 % of the way
        leg = np.full(count, step if target > 0 else -step, dtype=np.int64)
        leg[random.random(count) < 0.2] //= 3
        legs.append(leg)
    # Now and then the longest steps that there are, one way and the other.
    jumps = np.tile(np.array([longest, -longest, -longest, longest]), 20)
    return np.concatenate([[0], np.cumsum(np.concatenate([*legs, jumps]))])


def recorded(
    counts: NDArray[np.int64],
    bits: int,
    start: int,
    shown: int | None = None,
    counts_per_rev: float | None = None,
    **changes: Any,
) -> Recording:
    """A run of a device whose counter has `shown` bits, looked at through a narrower one that begins at `start`."""
    # In virtual time, where no watchdog waits by the wall clock: some minutes of ticks are gone through at once.
    inner = Numbered(lambda k: int(counts[k]), shown, timing="virtual", counts_per_rev=counts_per_rev)
    device = Faulty(inner, [fault_from(table_of(f"counter_wrap bits={bits} start={start}"))])
    experiment = Experiment(signal=Constant(value=1.0), duration=len(counts) * H, sample_time=H, **changes)
    return run(experiment, device)


@pytest.mark.promise("S10")
@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize(
    ("near", "direction"),
    [
        ("the upper end", 1),
        ("the lower end", -1),
        ("zero", 1),
        pytest.param("the upper end", -1, marks=pytest.mark.long),
        pytest.param("the lower end", 1, marks=pytest.mark.long),
        pytest.param("zero", -1, marks=pytest.mark.long),
    ],
)
def test_a_recorded_counter_is_unwrapped_to_the_count_over_a_billion_counts(
    bits: int, near: str, direction: int
) -> None:
    half = 1 << (bits - 1)
    start = {"the upper end": half - 1, "the lower end": -half, "zero": 0}[near]
    counts = direction * walk(bits, seed=bits)
    recording = recorded(counts, bits, start)

    assert recording.stopped.reason == "finished"
    shown = recording["counts"].values
    assert -half <= shown.min()
    assert shown.max() < half
    if bits < 32 or near != "zero":  # 32 bits are 4.3e9 counts: from zero, a billion doesn't reach their end
        assert (np.abs(np.diff(shown)) > half).any()
    found = Unwrap.parse((str(bits), "bit"))(shown, recording["counts"].t)  # type: ignore[arg-type]
    assert np.array_equal(found.astype(np.int64) - start, counts)
    assert np.array_equal(found, found.astype(np.int64))  # whole numbers to the last bit
    assert counts.max() >= FAR
    assert counts.min() <= -FAR


@pytest.mark.promise("S10")
@pytest.mark.parametrize("bits", BITS)
def test_one_sample_at_a_time_it_is_the_same(bits: int) -> None:
    counts = walk(bits, seed=1)[:5000]
    stage = Unwrap.parse((str(bits), "bit"))
    half = 1 << (bits - 1)

    state: tuple[float | None, float] = stage.start()
    found = []
    for count in counts:
        shown = (int(count) + half) % (2 * half) - half
        state, value = stage.step(state, float(shown), H)
        found.append(int(value))

    assert found == counts.tolist()


@pytest.mark.parametrize("bits", BITS)
def test_the_recording_says_its_counters_width_so_that_a_measurement_unwraps_it(bits: int) -> None:
    # Speeds below 2^14 counts a tick, so that no step is near half of the narrowest counter.
    counts = np.cumsum(np.concatenate([np.full(4000, 9000), np.full(8000, -9000), np.full(4000, 9000)]))
    recording = recorded(counts, bits, start=(1 << (bits - 1)) - 1)

    assert recording["counts"].channel.counter_bits == bits
    dataset = measure(recording)
    assert np.array_equal(dataset.y - dataset.y[0], counts - counts[0])
    # 9,000 counts a tick are a seventh of 16 bits, near enough for a word on the fastest that these can show.
    said = [finding.code for finding in dataset.findings if finding.code.startswith("unwrap")]
    assert said == (["unwrap-limit"] if bits == 16 else [])


def test_a_wide_counter_seen_through_a_narrow_one_wraps_at_both() -> None:
    """The device's own 24 bits wrap in the middle of it: 2^16 divides 2^24, so that the narrow counter can't tell."""
    counts = walk(16, seed=2)[:40_000]
    recording = recorded(counts, 16, 0, shown=24)

    found = Unwrap.parse(("16", "bit"))(recording["counts"].values, recording["counts"].t)  # type: ignore[arg-type]
    assert np.array_equal(found.astype(np.int64), counts)


def leaping(step: int) -> NDArray[np.int64]:
    """Counts at 100 a tick, with a step between two samples in the middle."""
    return np.arange(400) * 100 + np.where(np.arange(400) >= 200, step, 0)


@pytest.mark.promise("S10")
@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("direction", [1, -1])
def test_in_a_file_a_step_of_half_the_range_is_reported_and_not_believed(bits: int, direction: int) -> None:
    """It may as well have been the other way; a little more looks like the other way, which shows after a steady speed."""
    half = 1 << (bits - 1)
    plain = recorded(leaping(0), bits, 0)
    for step in (half - 100, half):  # beside the 100 counts of each tick
        shown = [float(wrapped(int(count), bits)) for count in direction * leaping(step)]
        series = [
            replace(each, values=np.array(shown)) if each.channel.name == "counts" else each
            for each in plain.series
        ]
        dataset = measure(replace(plain, series=tuple(series)))

        (finding,) = [finding for finding in dataset.findings if finding.code == "unwrap-ambiguous"]
        assert finding.rows is not None
        assert finding.rows[0] == 201


@pytest.mark.promise("S9")
@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("direction", [1, -1])
def test_in_a_run_a_step_of_half_the_range_is_a_fault(bits: int, direction: int) -> None:
    half = 1 << (bits - 1)
    recording = recorded(direction * leaping(half - 100), bits, 0)

    assert recording.stopped.reason == "fault"
    assert "the encoder stepped" in recording.stopped.sentence
    assert len(recording["counts"].values) == 200


@pytest.mark.promise("S9")
@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("direction", [1, -1])
def test_in_a_run_a_step_beyond_half_the_range_is_a_fault_where_the_motors_speed_is_known(
    bits: int, direction: int
) -> None:
    """100 counts a tick are 153 rad/s at 2048 counts a turn; beyond half the range a step looks like one the other way."""
    half = 1 << (bits - 1)
    for step in (half, half + half // 4, 2 * half - 2000):
        recording = recorded(
            direction * leaping(step), bits, 0, counts_per_rev=2048.0, limits=Limits(possible_speed=300.0)
        )

        assert recording.stopped.reason == "fault"
        assert "the encoder stepped" in recording.stopped.sentence
        assert len(recording["counts"].values) == 200
