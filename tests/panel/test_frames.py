"""Scopes show the measurement of the same rows, in whatever blocks they arrive."""

from __future__ import annotations

import struct
from dataclasses import replace

import numpy as np
import pytest

import servobench as sb
from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.panel.frames import COLUMNS, MAGIC, History, Scope, encode, speed_chain
from servobench.panel.replay import scope_rows, thin_rows
from servobench.recordings.measurement.base import Chain
from servobench.recordings.recording import Recording, Series

CHAIN = "derivative | lowpass 50 rad/s"


@pytest.fixture(scope="module")
def recording() -> Recording:
    """A run on the twin in which its narrow counter wraps."""
    experiment = sb.Experiment(signal=sb.Square(low=-8, high=8, frequency=0.4), duration=5, sample_time=0.002)
    with sb.connect("twin", counter_bits=16) as motor:
        return sb.run(experiment, motor)


def rows_of(recording: Recording) -> Array:
    return np.column_stack([recording.series[0].t, *(each.values for each in recording.series)])  # type: ignore[list-item]


def column(values: Array, name: str) -> Array:
    return values[:, COLUMNS.index(name)]


def in_blocks(scope: Scope, rows: Array, size: int) -> Array:
    return np.concatenate([scope.take(rows[k : k + size]) for k in range(0, len(rows), size)])


@pytest.mark.parametrize("size", [1, 33, 10_000])
def test_the_speed_is_what_measure_makes_of_the_recording(recording: Recording, size: int) -> None:
    values = in_blocks(Scope(recording, CHAIN), rows_of(recording), size)

    measured = sb.measure(recording, CHAIN)
    # By the trapezoid rule each step of 2 ms leaves (1 - 0.05)/(1 + 0.05) of the start state, and 47 steps less than 1 %.
    known = 47
    np.testing.assert_allclose(column(values, "speed")[known:], measured.y[known:], rtol=1e-9, atol=1e-9)
    raw = sb.measure(recording, "derivative")
    np.testing.assert_allclose(column(values, "speed_raw")[1:], raw.y[1:], rtol=1e-9, atol=1e-9)
    # What isn't known is no zero: nobody was there a sample before the first, and a filter that starts from zero is a guess.
    assert np.isnan(column(values, "speed")[:known]).all()
    assert np.isnan(column(values, "speed_raw")[0])
    # The middle of a bin is half a count further than its edge, which is what the counter says.
    position = sb.measure(recording, "").y
    np.testing.assert_allclose(np.diff(column(values, "position")), np.diff(position), rtol=0, atol=1e-9)


def test_columns_are_those_of_the_recording_and_what_is_not_there_is_nan(recording: Recording) -> None:
    values = Scope(recording, CHAIN).take(rows_of(recording))

    for name in ("commanded", "applied", "counts", "current", "late", "saturated"):
        np.testing.assert_array_equal(column(values, name), recording[name].values)
    np.testing.assert_array_equal(column(values, "t"), recording.series[0].t)
    assert np.isnan(column(values, "reference")).all()  # in open loop it is the voltage commanded
    assert np.isnan(column(values, "residual")).all()


def test_without_the_encoders_counts_in_a_turn_there_is_no_position(recording: Recording) -> None:
    series = tuple(
        replace(each, channel=replace(each.channel, counts_per_rev=None))
        if each.channel.name == "counts"
        else each
        for each in recording.series
    )
    values = Scope(replace(recording, series=series), CHAIN).take(rows_of(recording))

    assert np.isnan(column(values, "position")).all()
    assert np.isnan(column(values, "speed")).all()
    assert np.isfinite(column(values, "counts")).all()


def test_another_chain_shows_what_it_would_had_it_been_there(recording: Recording) -> None:
    rows = rows_of(recording)
    scope = Scope(recording, CHAIN)
    in_blocks(scope, rows[:1500], 50)
    scope.change_chain("derivative | lowpass 20 rad/s")
    values = in_blocks(scope, rows[1500:], 50)

    always = sb.measure(recording, "derivative | lowpass 20 rad/s").y[1500:]
    # Two seconds before, the filter starts from rest in place of up to 220 rad/s: e^(-20·2) of that is left.
    np.testing.assert_allclose(column(values, "speed"), always, rtol=0, atol=220 * np.exp(-38.0) + 1e-9)


@pytest.mark.parametrize(
    ("text", "chain"),
    [
        ("derivative | lowpass 50 rad/s", "derivative | lowpass 50 rad/s"),
        ("lowpass 50 rad/s", "lowpass 50 rad/s | derivative"),
        ("", "derivative"),
        ("none", "derivative"),
        ("unwrap 16 bit | derivative", "derivative"),
        ("scale 0.17578125 deg/count | derivative", "derivative"),
    ],
)
def test_the_chain_leads_from_the_position_to_the_speed(text: str, chain: str) -> None:
    assert speed_chain(text) == Chain.parse(chain)


def test_two_derivatives_are_no_speed() -> None:
    with pytest.raises(UsageError, match="derivative"):
        speed_chain("derivative | derivative")


def test_where_a_filter_diverges_over_a_gap_there_is_no_speed_and_then_there_is_again(
    recording: Recording,
) -> None:
    rows = rows_of(recording)[:600]
    rows[300:, 0] += 1.0
    scope = Scope(recording, "derivative | lowpass 50 rad/s euler")

    speed = column(in_blocks(scope, rows, 100), "speed")

    assert np.isnan(speed[300:400]).all()
    # Forward Euler leaves 0.9 of the start state in a step of 2 ms: 0.9^44 is below 1 %, before and after.
    assert np.isnan(speed[:44]).all()
    assert np.isfinite(speed[44:300]).all()
    assert np.isfinite(speed[444:]).all()


def test_a_frame_is_what_the_page_expects() -> None:
    values = np.arange(39.0).reshape(3, 13) / 8
    values[1, 8] = np.nan

    frame = encode(7, values)

    magic, n, columns, zero, first = struct.unpack_from("<IIIId", frame)
    assert (magic, n, columns, zero, first) == (MAGIC, 3, 13, 0, 7.0)
    assert frame[:4] == b"SVB1"
    np.testing.assert_array_equal(np.frombuffer(frame, "<f8", 3, 24), values[:, 0])
    rest = np.frombuffer(frame, "<f4", 36, 24 + 24).reshape(12, 3)
    np.testing.assert_array_equal(rest.T, values[:, 1:].astype(np.float32))
    assert len(frame) == 24 + 3 * 8 + 36 * 4


def block(first: int, rows: int) -> Array:
    values = np.zeros((rows, 13))
    values[:, 0] = 0.01 * (first + np.arange(rows))
    return values


def test_viewers_who_are_as_far_get_the_same_bytes_and_who_is_behind_gets_all_at_once() -> None:
    history = History()
    for first in (0, 30, 60):
        history.add(first, block(first, 30))

    assert history.next == 90
    assert history.since(60)[0] is history.since(60)[0]
    (late,) = history.since(30)
    assert struct.unpack_from("<IIIId", late) == (MAGIC, 60, 13, 0, 30.0)
    assert history.since(90) == []


def test_rows_that_were_lost_part_frames() -> None:
    history = History()
    for first in (0, 30, 100):
        history.add(first, block(first, 30))

    heads = [struct.unpack_from("<IIIId", frame) for frame in history.since(0)]

    assert [(head[4], head[1]) for head in heads] == [(0.0, 60), (100.0, 30)]


def test_ten_seconds_are_kept() -> None:
    history = History()
    for first in range(0, 3000, 30):
        history.add(first, block(first, 30))

    heads = [struct.unpack_from("<IIIId", frame) for frame in history.since(0)]
    (head,) = heads
    assert head[4] + head[1] == 3000
    assert 1000 <= head[1] < 1060  # 10 s of 100 rows, to the block


def test_a_long_recording_is_thinned_and_keeps_its_extremes() -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=(50_001, 13))
    values[:, 0] = np.arange(50_001)
    values[:, 8] = np.nan
    values[12_345, 6] = 99.0
    values[40_000, 7] = -99.0

    out = thin_rows(values)

    assert len(out) == 20_000
    np.testing.assert_array_equal(np.nanmax(out[:, 6]), 99.0)
    np.testing.assert_array_equal(np.nanmin(out[:, 7]), -99.0)
    assert np.all(np.diff(out[:, 0]) > 0)
    assert (out[0, 0], out[-1, 0]) == (0.0, 50_000.0)
    assert np.isnan(out[:, 8]).all()
    np.testing.assert_array_equal(thin_rows(values[:100]), values[:100])


def test_somebody_elses_recording_shows_what_it_has(recording: Recording) -> None:
    speed = sb.measure(recording, CHAIN)
    theirs = Recording(
        name="theirs",
        series=(
            replace(recording["applied"]),
            Series(
                channel=replace(recording["counts"].channel, name="w", unit="rpm"),
                values=speed.y,
                t=speed.t_output,
            ),
        ),
        source=recording.source,
        input="applied",
        output="w",
    )

    values = scope_rows(theirs)

    np.testing.assert_array_equal(column(values, "applied"), recording["applied"].values)
    np.testing.assert_allclose(column(values, "speed"), speed.y * np.pi / 30)
    assert np.isnan(column(values, "position")).all()


def test_a_filter_that_forgets_too_slowly_is_shown_after_two_seconds(recording: Recording) -> None:
    speed = column(
        in_blocks(Scope(recording, "derivative | lowpass 0.1 rad/s"), rows_of(recording), 50), "speed"
    )

    assert np.isnan(speed[:1000]).all()
    assert np.isfinite(speed[1001:]).all()
