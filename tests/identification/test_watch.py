"""A stream is recorded whole, and says what is known and which motion is missing."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import servobench as sb
from servobench.core.channels import Array
from servobench.core.errors import MissingInformation, UsageError
from servobench.core.rounding import TWO_SIDED
from servobench.identification.design.stopping_rule import half
from servobench.identification.identify import identify_evidence
from servobench.identification.live import ANOTHER_SPEED, LONGER, _motion_for
from servobench.identification.models.kernels import COULOMB
from servobench.identification.watch import Watch, stop_text
from servobench.recordings.formats.mapping import Mapping
from servobench.recordings.native.reader import read
from servobench.recordings.streams.base import Rows
from servobench.recordings.streams.line_table import LineTable
from servobench.recordings.streams.networktables import NetworkTables
from servobench.systems.signals.ramp import Ramp
from tests.recordings.streams.robot import robot

ENCODER = Mapping(counts_per_rev=2048.0)
NAMES = ("t", "u", "counts")


@cache
def driven(sample_time: float = 0.002, low: float = -2.0) -> Array:
    """Rows of the simulated motor under a square wave for 20 s."""
    signal = sb.Square(low=low, high=3, frequency=0.4)
    return rows_of(sb.Experiment(signal=signal, duration=20, sample_time=sample_time, seed=1))


@cache
def cruising() -> Array:
    """Rows of a motor that runs at one speed all the time: what comes after the step is over."""
    rows = rows_of(sb.Experiment(signal=sb.Step(final=3), duration=20, seed=1))
    return rows[1000:]


def rows_of(experiment: sb.Experiment) -> Array:
    with sb.connect("twin") as motor:
        recording = sb.run(experiment, motor)
    counts = recording["counts"]
    return np.column_stack([counts.t, recording["applied"].values, counts.values])


def give(watch: Watch, values: Array, names: tuple[str, ...] = NAMES, count: int = 97) -> None:
    for begin in range(0, len(values), count):
        watch.take(Rows(names=names, values=values[begin : begin + count]))


def watched(to: Path, values: Array, mapping: Mapping = ENCODER) -> Watch:
    watch = Watch(mapping, "test", to / "recording.mcap")
    OPEN.append(watch)
    give(watch, values)
    return watch


OPEN: list[Watch] = []


@pytest.fixture(autouse=True)
def close_what_is_open() -> Iterator[None]:
    yield
    while OPEN:
        OPEN.pop().abandon()


def test_every_row_is_recorded_as_it_came(tmp_path: Path) -> None:
    evidence = watched(tmp_path, driven()).end(stop_text("end"))

    (recording,) = read(tmp_path / "recording.mcap")
    assert recording == evidence[0].recording
    assert (recording.input, recording.output) == ("u", "counts")
    assert recording["counts"].channel.counts_per_rev == 2048
    np.testing.assert_array_equal(recording["counts"].values, driven()[:, 2])
    np.testing.assert_array_equal(recording["u"].t, driven()[:, 0])


def test_the_last_row_arrives_even_if_it_comes_alone(tmp_path: Path) -> None:
    watch = Watch(ENCODER, "test", tmp_path / "recording.mcap")
    for row in driven()[:300]:
        watch.take(Rows(names=NAMES, values=row[None]))
    (evidence,) = watch.end(stop_text("end"))

    assert len(evidence.recording["counts"].values) == watch.rows == 300


def test_the_live_intervals_agree_with_the_result_of_all_rows(tmp_path: Path) -> None:
    watch = watched(tmp_path, driven())
    message = watch.message()
    result = sb.identify([each.dataset() for each in watch.end(stop_text("end"))])

    assert message is not None
    assert watch.enough
    for name in ("gain", "time_constant"):
        low, high = message["parameters"][name]["interval"]
        # Two estimates of the same data: each is in the other's interval, or both are off.
        assert (
            low < result.fit[name].value < high
            or result.fit[name].interval[0] < low < result.fit[name].interval[1]
        )


def test_cruising_needs_a_faster_change_of_speed(tmp_path: Path) -> None:
    watch = watched(tmp_path, cruising())

    assert not watch.enough
    assert watch.sentence() == "needs a faster change of speed"


def test_a_doubt_that_no_motion_removes_is_said_while_the_motor_runs(tmp_path: Path) -> None:
    """Volts that are read as millivolts."""
    watch = watched(tmp_path, driven(), Mapping(counts_per_rev=2048.0, input="u:mV"))
    watch.judge(identify_evidence(watch.so_far()))

    assert not watch.known
    assert watch.sentence().startswith("doubtful: ")
    assert "V read as mV" in watch.sentence()


def test_a_slow_drift_of_the_voltage_is_no_faster_change_of_speed(tmp_path: Path) -> None:
    """From 3.0 to 3.3 V within 18 s: gain and friction can't be told apart either, as one speed is like the other."""
    signal = Ramp(initial=3.0, final=3.3, duration=20)
    rows = rows_of(sb.Experiment(signal=signal, duration=20, seed=1))[1000:]
    watch = watched(tmp_path, rows)

    assert not watch.enough
    assert "needs a faster change of speed" in watch.sentence()


def test_a_shaft_that_rests_needs_motion(tmp_path: Path) -> None:
    t = 0.002 * np.arange(2000)
    watch = watched(tmp_path, np.column_stack([t, 0.05 * (t > 2), np.zeros_like(t)]))

    assert watch.sentence() == "needs motion"


@pytest.mark.parametrize("seconds", [3, 12])
def test_one_step_from_rest_does_not_tell_gain_from_friction(tmp_path: Path, seconds: float) -> None:
    """Every gain with a friction to match gives the same motion, so nothing is known of the gain however long it runs."""
    rows = rows_of(sb.Experiment(signal=sb.Step(final=4, start=0.5), duration=seconds, seed=1))
    watch = watched(tmp_path, rows)

    assert not watch.enough
    assert "gain" not in (watch.message() or {"parameters": {}})["parameters"]
    assert watch.sentence() == "needs another speed, or coasting to standstill"


def test_times_that_may_be_milliseconds_are_said_while_there_is_time_to_begin_again(tmp_path: Path) -> None:
    rows = driven() * [1000, 1, 1]
    watch = Watch(ENCODER, "test", tmp_path / "recording.mcap")
    OPEN.append(watch)
    give(watch, rows[:200], ("time", "u", "counts"))

    assert "if the time column is in milliseconds" in watch.sentence()
    assert "`time=COL:ms`" in watch.sentence()


def test_times_that_may_be_microseconds_are_said_to_be_those(tmp_path: Path) -> None:
    watch = Watch(ENCODER, "test", tmp_path / "recording.mcap")
    OPEN.append(watch)
    give(watch, (driven() * [1e6, 1, 1])[:200], ("time", "u", "counts"))

    assert watch.sentence().startswith("the rows are 2000 s apart")
    assert "`time=COL:us`" in watch.sentence()


def test_one_way_is_enough_for_gain_and_says_what_both_directions_would_tell(tmp_path: Path) -> None:
    watch = watched(tmp_path, driven(low=1.0))
    watch.judge(identify_evidence(watch.so_far()))
    sentence = watch.sentence()

    assert sentence.startswith("enough is known: gain ± ")
    assert "both directions" in sentence


def test_enough_by_noise_alone_is_not_enough_where_the_model_may_be_wrong_by_more(tmp_path: Path) -> None:
    """Under a slow sine the time constant is known to 0.03 % by noise alone, and to no more than 0.2 % in all."""
    wish = {"time_constant": 1e-3}
    watch = Watch(ENCODER, "test", tmp_path / "recording.mcap", wish)
    OPEN.append(watch)
    give(watch, rows_of(sb.Experiment(signal=sb.Sine(amplitude=3, frequency=0.1), duration=20, seed=1)))

    assert watch.enough
    assert watch.sentence().startswith("by noise alone time constant ± ")

    result = identify_evidence(watch.so_far())
    watch.judge(result)

    assert half(result, "time_constant") > wish["time_constant"]
    assert not watch.known
    assert watch.sentence().startswith("needs more motion, and other motion")
    final = identify_evidence(watch.end(stop_text("end")))
    assert final["time_constant"].interval == result["time_constant"].interval


def test_a_wrapping_counter_is_followed_and_said(tmp_path: Path) -> None:
    rows = driven(low=1.0).copy()
    rows[:, 2] = (rows[:, 2] + 20_000) % 2**16
    watch = watched(tmp_path, rows)
    (tmp_path / "plain").mkdir()
    plain = watched(tmp_path / "plain", driven(low=1.0))
    wrapped, free = watch.message(), plain.message()

    assert wrapped is not None
    assert free is not None
    assert wrapped["parameters"]["gain"]["value"] == pytest.approx(
        free["parameters"]["gain"]["value"], rel=1e-9
    )
    (evidence,) = watch.end(stop_text("end"))
    plain.abandon()
    assert evidence.chain == "unwrap 16 bit"
    assert "stream-counter-wraps" in {each.code for each in evidence.recording.findings}
    assert sb.identify(evidence.dataset()).fit is not None


def test_a_wrong_count_is_no_wrap_and_hides_none(tmp_path: Path) -> None:
    """One count of 1e9 says nothing of how fast the shaft turns: a counter's wraps are still told from other jumps."""
    values = driven().copy()
    values[:, 2] = (values[:, 2] + 2**15) % 2**16 - 2**15
    jumps = int(np.count_nonzero(np.abs(np.diff(values[:, 2])) > 2**15))
    values[300, 2] = 1e9
    told = watched(tmp_path, values).end(stop_text("end"))[0].recording.findings

    assert jumps > 0
    assert [f.sentence for f in told if f.code == "stream-counter-wraps"] == [
        f"The counter wrapped {jumps} times at 16 bits; the wraps are removed."
    ]


def test_lost_rows_are_counted_and_the_estimate_goes_on(tmp_path: Path) -> None:
    rows = driven()
    kept = np.delete(rows, np.r_[3000:3100, 6000:6003], axis=0)
    watch = watched(tmp_path, kept)

    assert watch.rows == len(kept)
    assert watch.lost == 103
    assert watch.enough
    (evidence,) = watch.end(stop_text("end"))
    assert "stream-gaps" in {each.code for each in evidence.recording.findings}


def test_a_clock_that_begins_again_is_another_recording(tmp_path: Path) -> None:
    watch = watched(tmp_path, np.concatenate([driven()[:5000], driven()[:5000]]))
    evidence = watch.end(stop_text("end"))

    assert [each.recording.name for each in evidence] == ["stream", "stream 2"]
    assert sum(len(each.recording["u"].values) for each in evidence) == 10_000
    assert sb.identify([each.dataset() for each in evidence]).fit is not None


def test_another_rate_is_said_and_nothing_is_lost(tmp_path: Path) -> None:
    rows = np.concatenate([driven()[:5000], driven()[5000::5]])
    watch = watched(tmp_path, rows)

    assert watch.rows == len(rows)
    (evidence,) = watch.end(stop_text("end"))
    assert "stream-rate-changes" in {each.code for each in evidence.recording.findings}


def test_what_is_written_can_be_read_though_nobody_ended_it(tmp_path: Path) -> None:
    watch = watched(tmp_path, driven())
    watch.abandon()

    (recording,) = read(tmp_path / "recording.mcap.part")
    # Rows are given in blocks of 97; the last may wait for the next.
    assert len(recording["counts"].values) >= len(driven()) - 97
    assert (recording.input, recording.output) == ("u", "counts")


def test_what_the_columns_are_is_asked_for_and_nothing_is_recorded(tmp_path: Path) -> None:
    with pytest.raises(MissingInformation, match="which column is the input"):
        give(Watch(Mapping(), "test", tmp_path / "a.mcap"), driven(), ("a", "b", "c"))

    assert not list(tmp_path.iterdir())


def test_no_rows_are_no_recording(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no usable rows came"):
        Watch(ENCODER, "test", tmp_path / "a.mcap").end(stop_text("interrupted"))


def test_lines_that_are_no_rows_are_shown_where_no_row_came(tmp_path: Path) -> None:
    watch = Watch(ENCODER, "test", tmp_path / "a.mcap")
    watch.take(LineTable().take(b"booting\nmotor = off\n"))

    with pytest.raises(UsageError, match="the last line was 'motor = off', but rows like"):
        watch.end(stop_text("end"))


def test_what_was_left_out_is_said_by_its_reason(tmp_path: Path) -> None:
    """A clock that runs backwards is no damaged line, and what didn't happen isn't counted."""
    ahead = driven()[:2000]
    back = ahead[::-1][1:]
    watch = watched(tmp_path, np.concatenate([ahead, back]))
    (evidence,) = watch.end(stop_text("end"))
    said = {each.code: each.sentence for each in evidence.recording.findings}

    assert said["stream-damaged"].endswith(
        "rows of the stream with times that don't fit their neighbours', as from a clock that runs backwards or jumps."
    )
    assert said["stream-rows-left-out"] == "Left out: 499 rows that came too late."


def test_a_robots_gain_is_known_with_its_interval_within_twenty_seconds(tmp_path: Path) -> None:
    """Over a real NetworkTables server, at the 50 Hz of a robot's loop, the position in rotations."""
    rows = driven(sample_time=0.02)
    mapping = Mapping(time="time:s", input="voltage:V", output="position:rev")
    watch = Watch(mapping, "robot", tmp_path / "recording.mcap")
    OPEN.append(watch)
    with robot() as server, NetworkTables(f"127.0.0.1:{server.port}/drive/voltage,/drive/position") as stream:
        server.await_listener(stream)
        server.publish(rows[:, 0], rows[:, 1], (rows[:, 2] + 0.5) / 2048)
        take_all(watch, stream, len(rows))

    assert watch.enough, watch.sentence()
    assert watch.duration <= 20
    message = watch.message()
    assert message is not None
    truth = sb.identify(sb.measure(run_of_truth()))
    for name in ("gain", "time_constant"):
        low, high = message["parameters"][name]["interval"]
        assert low < truth.fit[name].value < high, name


def test_a_robot_that_cruises_needs_a_faster_change_of_speed(tmp_path: Path) -> None:
    rows = cruising()[::10]
    mapping = Mapping(time="time:s", input="voltage:V", output="position:rev")
    watch = Watch(mapping, "robot", tmp_path / "recording.mcap")
    OPEN.append(watch)
    with robot() as server, NetworkTables(f"127.0.0.1:{server.port}/drive/voltage,/drive/position") as stream:
        server.await_listener(stream)
        server.publish(rows[:, 0], rows[:, 1], (rows[:, 2] + 0.5) / 2048)
        take_all(watch, stream, len(rows))

    assert not watch.enough
    assert watch.sentence() == "needs a faster change of speed"


def take_all(watch: Watch, stream: NetworkTables, count: int) -> None:
    """Take rows until so many have come, or nothing has for a minute of looks."""
    came = 0
    for _ in range(600):
        rows = stream.read(0.1)
        assert rows is not None
        watch.take(rows)
        came += len(rows.values)
        if came >= count:
            return
    raise AssertionError(f"{came} of {count} rows came")


@cache
def run_of_truth() -> sb.Recording:
    """The same motor, sampled at 500 Hz by who drives it: an interval a tenth as wide."""
    with sb.connect("twin") as motor:
        signal = sb.Square(low=-2, high=3, frequency=0.4)
        return sb.run(sb.Experiment(signal=signal, duration=20, seed=1), motor)


def test_a_few_rows_after_a_restart_cost_no_result(tmp_path: Path) -> None:
    watch = watched(tmp_path, driven()[:4000])
    give(watch, driven()[:8])
    (evidence,) = watch.end(stop_text("end"))

    assert len(evidence.recording["counts"].values) == 4000
    assert {"stream-stub", "stream-restarts"} <= {each.code for each in evidence.recording.findings}
    assert sb.identify(evidence.dataset()).verdict == "trusted"


@pytest.mark.parametrize("lost", [2000, 200], ids=["4 s", "0.4 s"])
def test_a_pause_in_which_the_motor_is_driven_costs_no_result(tmp_path: Path, lost: int) -> None:
    """No row for a while, in which the square wave went on: the rows after it are a recording of their own."""
    (tmp_path / "whole").mkdir()
    watch = watched(tmp_path, np.concatenate([driven()[:3000], driven()[3000 + lost :][:3000]]))
    evidence = watch.end(stop_text("end"))
    result = sb.identify([each.dataset() for each in evidence])
    whole = sb.identify(
        [each.dataset() for each in watched(tmp_path / "whole", driven()).end(stop_text("end"))]
    )

    assert [len(each.recording["counts"].values) for each in evidence] == [3000, 3000]
    assert result.verdict == "trusted"
    for name in ("gain", "time_constant"):
        low, high = result.fit[name].interval
        assert low < whole.fit[name].value < high


@pytest.mark.parametrize("lost", [60, 4], ids=["0.12 s", "8 ms"])
def test_a_short_gap_in_which_the_voltage_changed_is_bridged_only_if_it_is_a_few_rows(
    tmp_path: Path, lost: int
) -> None:
    """The square wave changes in the middle of the gap, at row 3750: a bridge would hold the old voltage until its end."""
    rows = driven()
    watch = watched(tmp_path, np.delete(rows, np.s_[3750 - lost // 2 : 3750 + lost // 2], axis=0))
    evidence = watch.end(stop_text("end"))

    assert rows[3740, 1] != rows[3760, 1]
    assert len(evidence) == (2 if lost > 5 else 1)
    if lost > 5:
        (tmp_path / "whole").mkdir()
        whole = watched(tmp_path / "whole", rows).end(stop_text("end"))
        gain, known = (
            sb.identify([each.dataset() for each in seen]).fit["gain"] for seen in (evidence, whole)
        )
        assert np.ptp(gain.interval) < 1.2 * np.ptp(known.interval)


def test_a_shaft_that_rests_after_a_pause_costs_no_result(tmp_path: Path) -> None:
    rows, rest = driven(), np.column_stack([30 + 0.002 * np.arange(500), np.zeros(500), np.full(500, 7.0)])
    watch = watched(tmp_path, np.concatenate([rows[:6000], rest, np.add(rows, [31, 0, 7])]))
    live = watch.message()
    result = sb.identify([each.dataset() for each in watch.end(stop_text("end"))])
    (tmp_path / "whole").mkdir()
    whole = sb.identify([each.dataset() for each in watched(tmp_path / "whole", rows).end(stop_text("end"))])

    assert live is not None
    assert result.verdict == "trusted"
    for low, high in (live["parameters"]["gain"]["interval"], result.fit["gain"].interval):
        assert low < whole.fit["gain"].value < high


def test_rows_that_come_singly_after_a_pause_are_waited_for_until_they_tell_a_start(tmp_path: Path) -> None:
    """At 50 Hz the two time constants that a start is looked for in are fewer rows than it has unknowns."""
    rows = driven(sample_time=0.02)
    watch = watched(tmp_path, rows[:500])
    give(watch, rows[540:], count=1)

    assert watch.rows == len(rows) - 40
    assert len(watch.end(stop_text("end"))) == 2


def test_all_rows_at_once_and_no_more_tell_what_they_tell_in_turn(tmp_path: Path) -> None:
    """A growing file that doesn't grow: rows come in one block, and nothing calls for another look."""
    watch = Watch(ENCODER, "test", tmp_path / "recording.mcap")
    OPEN.append(watch)
    for block in Rows(names=NAMES, values=driven()[:4499]).blocks(200):
        watch.take(block)
    watch.look_again()

    assert watch.enough


@pytest.mark.parametrize(("times", "motion"), [(1.9, LONGER), (2.1, ANOTHER_SPEED)])
def test_an_interval_up_to_twice_as_wide_as_wished_needs_more_of_the_same_motion(
    times: float, motion: str
) -> None:
    """The gain would be known if friction were: its own interval is a tenth of what it has together with friction."""
    reference, covariance = np.full(7, 20.0), np.eye(7)
    sd = times * 0.05 * 20.0 / TWO_SIDED
    covariance[0, 0] = sd**2
    covariance[0, COULOMB] = covariance[COULOMB, 0] = np.sqrt(0.99) * sd

    assert _motion_for("gain", 0.05, reference, covariance) == motion
