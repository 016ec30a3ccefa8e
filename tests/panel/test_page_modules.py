"""The page's modules that reckon, each held against NumPy or algebra; run in the browser that they are for."""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from tests.panel.browser import chromium, served

pytest.importorskip("starlette", reason="the panel's extra is absent: starlette")
pytest.importorskip("uvicorn", reason="the panel's extra is absent: uvicorn")

import itertools

from tests.panel.fake import COLUMNS, app, frame  # after the look whether it can be imported

Call = Callable[..., Any]


@pytest.fixture(scope="module")
def call() -> Iterator[Call]:
    """Runs a function of JavaScript whose first argument is the module named; arguments go as JSON."""
    with chromium() as browser, served(app()) as address:
        page = browser.new_page()
        page.goto(f"{address}/static/icon.svg")  # the same origin, and nothing that runs

        def run(module: str, body: str, argument: Any = None) -> Any:
            code = f"async (given) => {{ const m = await import('/static/{module}.js'); return ({body})(m, given); }}"
            return page.evaluate(code, argument)

        yield run


def rows(first: int, count: int) -> np.ndarray:
    """Rows whose every value tells where it stands."""
    k = np.arange(first, first + count)
    return np.column_stack([k * 1e-3, *(100 * column + 0.25 * k for column in range(1, len(COLUMNS)))])


def text(data: bytes) -> str:
    return base64.b64encode(data).decode()


COLUMNS_OF_F = "m.COLUMNS.map((name) => [...f.columns[name]])"
BYTES = "const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;"


def test_a_frame_is_decoded_as_numpy_wrote_it(call: Call) -> None:
    given = rows(7, 33)
    body = f"(m, g) => {{ {BYTES} const f = m.decode(bytes(g)); return [f.first, f.count, {COLUMNS_OF_F}]; }}"
    first, count, columns = call("frames", body, text(frame(7, given)))
    assert (first, count) == (7, 33)
    np.testing.assert_array_equal(columns[0], given[:, 0])
    np.testing.assert_array_equal(np.array(columns[1:]), given[:, 1:].T.astype(np.float32))


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda data: data[:10], "shorter than its header"),
        (lambda data: b"X" + data[1:], "begin with SVB1"),
        (lambda data: data[:-4], "expected"),
        (lambda data: data[:8] + b"\x05\0\0\0" + data[12:], "5 columns; expected 13"),
    ],
)
def test_what_is_no_frame_is_refused_with_a_reason(call: Call, spoil: Any, sentence: str) -> None:
    body = (
        f"(m, g) => {{ {BYTES} try {{ m.decode(bytes(g)); return ''; }} catch (e) {{ return e.message; }} }}"
    )
    assert sentence in call("frames", body, text(spoil(frame(0, rows(0, 4)))))


RING = (
    BYTES + "const ring = new m.Ring(g.capacity); for (const f of g.frames) ring.append(m.decode(bytes(f)));"
)


def test_the_ring_keeps_the_last_rows_whatever_pieces_they_come_in(call: Call) -> None:
    sizes = np.random.default_rng(4).integers(0, 90, 60)  # more than the capacity in one piece, too
    starts = np.concatenate([[0], np.cumsum(sizes)])
    frames = [text(frame(a, rows(a, b - a))) for a, b in itertools.pairwise(starts)]
    body = f"(m, g) => {{ {RING} const v = ring.view(); return [v.gaps.length, m.COLUMNS.map((n) => [...v[n]])]; }}"
    gaps, columns = call("frames", body, {"capacity": 64, "frames": frames})
    last = rows(int(starts[-1]) - 64, 64)
    assert gaps == 0
    np.testing.assert_array_equal(columns[0], last[:, 0])
    np.testing.assert_array_equal(np.array(columns[1:]), last[:, 1:].T.astype(np.float32))


def test_missing_rows_leave_a_gap_until_they_are_out_of_the_ring(call: Call) -> None:
    frames = [text(frame(0, rows(0, 10))), text(frame(15, rows(15, 10)))]
    body = f"(m, g) => {{ {RING} const was = [...ring.gaps]; ring.append(m.decode(bytes(g.more))); return [was, ring.gaps]; }}"
    before, after = call(
        "frames", body, {"capacity": 20, "frames": frames, "more": text(frame(25, rows(25, 15)))}
    )
    assert before == [[9 * 1e-3, 15 * 1e-3]]
    assert after == []


def test_a_run_that_begins_anew_takes_the_place_of_the_one_before(call: Call) -> None:
    frames = [text(frame(500, rows(500, 10))), text(frame(0, rows(0, 5)))]
    body = f"(m, g) => {{ {RING} return [ring.count, ring.gaps.length, ring.last]; }}"
    assert call("frames", body, {"capacity": 20, "frames": frames}) == [5, 0, 4 * 1e-3]


def test_the_trigger_finds_where_a_sine_crosses_zero(call: Call) -> None:
    t = np.arange(0, 3.3, 1e-3) + 0.37e-3
    y = np.sin(2 * np.pi * t)
    body = "(m, g) => [true, false].map((rising) => m.lastCrossing(g.t, g.y, {level: 0, rising, hysteresis: 0.1}))"
    rising, falling = call("trigger", body, {"t": t.tolist(), "y": y.tolist()})
    # A chord's distance from the sine is at most h²/8 |y''|, with |y''| ≤ (2π)³ h beside the zero; over the slope 2π: 5e-9 s.
    assert rising == pytest.approx(3.0, abs=1e-8)
    assert falling == pytest.approx(2.5, abs=1e-8)


def test_noise_about_the_level_is_no_crossing(call: Call) -> None:
    t = np.arange(1000) * 1e-3
    # Up at 0.2 s, about the level with noise until the end: the last crossing is that rise, if noise triggers nothing.
    y = np.where(t < 0.2, -1.0, 0.02 * (-1.0) ** np.arange(1000))
    body = "(m, g) => [0, 0.1].map((hysteresis) => m.lastCrossing(g.t, g.y, {level: 0, rising: true, hysteresis}))"
    without, with_it = call("trigger", body, {"t": t.tolist(), "y": y.tolist()})
    assert without > 0.9
    assert 0.199 <= with_it <= 0.201


def test_a_sweep_is_shown_only_when_all_of_it_is_there(call: Call) -> None:
    t = np.arange(0, 2.1, 1e-3)
    y = np.where(t % 1.0 >= 0.5, 1.0, -1.0)  # up at 0.5 and 1.5
    body = "(m, g) => g.spans.map((span) => m.lastSweep({t: g.t, y: g.y}, 'y', {level: 0, rising: true, span, pre: 0.2}))"
    short, longer, none = call("trigger", body, {"t": t.tolist(), "y": y.tolist(), "spans": [0.7, 1.0, 3.0]})
    assert short == pytest.approx(1.4995)  # halfway between the rows beside the edge
    assert longer == pytest.approx(0.4995)  # 0.8 s after 1.5 s are not there yet
    assert none is None or math.isnan(none)


def test_cursors_on_a_straight_line_tell_its_slope(call: Call) -> None:
    t = np.arange(0, 2, 0.1)
    body = "(m, g) => m.differences(g.t, [g.t.map((t) => 3 + 2 * t)], 0.25, 1.75)"
    found = call("cursors", body, {"t": t.tolist()})
    (row,) = found["rows"]
    assert found["span"] == 1.5
    assert found["rate"] == pytest.approx(1 / 1.5)
    assert [row["a"], row["b"], row["difference"], row["slope"]] == pytest.approx([3.5, 6.5, 3.0, 2.0])


def test_a_cursor_beside_the_data_reads_nothing(call: Call) -> None:
    assert call(
        "cursors", "(m, g) => [-1, 5].map((at) => Number.isNaN(m.valueAt(g, g, at)))", [0.0, 1.0]
    ) == [True, True]


@pytest.mark.parametrize(
    ("chain", "cutoff", "changed"),
    [
        ("derivative | lowpass 50 rad/s", 50, "derivative | lowpass 75 rad/s"),
        ("unwrap | derivative | lowpass 10 Hz", 20 * math.pi, "unwrap | derivative | lowpass 75 rad/s"),
        ("derivative", None, "derivative | lowpass 75 rad/s"),
        ("", None, "derivative | lowpass 75 rad/s"),
    ],
)
def test_the_cut_off_of_a_chain_is_read_and_replaced(
    call: Call, chain: str, cutoff: float | None, changed: str
) -> None:
    found, made = call("controls", "(m, g) => [m.cutoffOf(g), m.withCutoff(g, 75)]", chain)
    assert found == (None if cutoff is None else pytest.approx(cutoff))
    assert made == changed


def test_figures_have_the_digits_asked_for(call: Call) -> None:
    given = [0, 0.0898123, -22.0456, 123456, 3.2e-7, None]
    found = call("format", "(m, g) => g.map((v) => m.significant(v ?? NaN, 3))", given)
    assert found == ["0", "0.0898", "\u221222.0", "123456", "3.20e\u22127", "–"]


def test_the_range_of_a_scope_grows_at_once_and_shrinks_when_most_of_it_is_empty(call: Call) -> None:
    body = "(m, g) => { const s = new m.Span(); return g.map(([a, b]) => [...s.holding(a, b)]); }"
    one, same, grown, shrunk = call("span", body, [[0, 10], [1, 9], [0, 20], [0, 5]])
    assert one == same == pytest.approx([-1.2, 11.2])
    assert grown == pytest.approx([-2.4, 22.4])
    assert shrunk == pytest.approx([-0.6, 5.6])


def test_two_recordings_of_different_rates_share_an_axis(call: Call) -> None:
    body = "(m, g) => m.aligned(g, 'y')"
    t, a, b = call(
        "compare", body, [{"t": [5.0, 6.0, 7.0], "y": [1, 2, 3]}, {"t": [0.0, 0.5, 1.0], "y": [7, 8, 9]}]
    )
    assert t == [0.0, 0.5, 1.0, 2.0]
    assert a == [1, None, 2, 3]
    assert b == [7, 8, 9, None]


def test_what_is_not_known_of_a_recording_is_left_out_and_positions_begin_at_its_first(call: Call) -> None:
    body = (
        "(m, g) => m.aligned(g.map(({t, y}) => ({t, y: Float32Array.from(y, (v) => v ?? NaN)})), 'y', true)"
    )
    recordings = [{"t": [1.0, 2.0, 3.0], "y": [None, 70, 71]}, {"t": [0.0, 1.0, 2.0], "y": [5, None, 8]}]
    t, a, b = call("compare", body, recordings)
    assert t == [0.0, 1.0, 2.0]
    assert a == [None, 0, 1]
    assert b == [0, None, 3]


def test_short_times_are_reported_in_milliseconds(call: Call) -> None:
    given = [
        {"value": 0.00025, "interval": [0.0, 0.0005], "unit": "s"},
        {"value": 0.09, "interval": [0.08, 0.1], "unit": "s"},
        {"value": 0.001, "interval": None, "unit": "V"},
    ]
    short, *others = call("format", "(m, g) => g.map(m.readable)", given)
    assert short == {"value": 0.25, "interval": [0.0, 0.5], "unit": "ms"}
    assert others == given[1:]


def test_the_time_that_is_left_is_reported_as_far_as_it_is_known(call: Call) -> None:
    known = {"doing": "identifying", "seconds": 30.0, "left": 90.0}
    unknown = {"doing": "identifying", "seconds": 61.0, "left": None}
    told = call("progress", "(m, g) => g.map(m.workProgress)", [known, unknown])
    assert told[0] == {"share": 0.25, "sentence": "identifying  ·  about 1:30 left"}
    assert told[1] == {"share": None, "sentence": "identifying  ·  1:01 so far"}


def test_why_nothing_can_be_set_is_reported_in_a_sentence(call: Call) -> None:
    states = [
        None,
        {"opening": {"device": "twin"}, "operator": True},
        {"operator": False, "taken": True},
        {"operator": False, "taken": False},
        {"operator": True, "taken": True},
    ]
    told = call("permit", "(m, g) => g.map(m.whyNot)", states)
    assert [bool(each) for each in told] == [True, True, True, True, False]
    assert len(set(told)) == len(told)


def test_steps_of_an_axis_are_written_in_full(call: Call) -> None:
    steps = [100, 5, 2.5, 1, 0.5, 0.25, 0.1, 0.002, 0.1 + 0.2]
    assert call("format", "(m, g) => g.map(m.decimals)", steps) == [0, 0, 1, 0, 1, 2, 1, 3, 1]


@pytest.mark.parametrize(
    ("text", "what", "fitting"),
    [
        ("first run", "can't have a space in it", "first-run"),
        ("ünï 日本.1", "can't have “ü”, “ï”, a space, “日”, “本” in it", "uni-.1"),
        ("_a", "can't begin with “_”", "a"),
    ],
)
def test_what_keeps_a_text_from_being_a_name_is_said_and_one_like_it_offered(
    call: Call, text: str, what: str, fitting: str
) -> None:
    trouble = call("lights", "(m, text) => m.nameTrouble(text)", text)
    assert what in trouble["sentence"]
    assert trouble["fitting"] == fitting
    assert call("lights", "(m, text) => m.nameTrouble(text)", fitting) is None
    assert call("lights", "(m, text) => m.nameTrouble(text)", "") is None


def test_recordings_that_begin_where_the_voltage_changes_keep_one_row_before_it(call: Call) -> None:
    cut = """(m) => {
        const found = m.fromFirstChange({ t: Float64Array.of(0, 1, 2, 3), applied: Float32Array.of(0, 0, 3, 3) });
        return [[...found.t], [...found.applied]];
    }"""
    assert call("compare", cut) == [[1, 2, 3], [0, 3, 3]]
    still = "(m) => [...m.fromFirstChange({ t: Float64Array.of(0, 1), applied: Float32Array.of(2, 2) }).t]"
    assert call("compare", still) == [0, 1]


SQUARE = {"type": "square", "frequency": 0.4, "start": 1}  # until 1 s + 2 periods of 2.5 s
STEP = {"type": "step", "start": 3}  # 10 s, as nothing of it says when it's over
SEGMENTS = [{"duration": 2.5, "signal": STEP}, {"duration": 1.5, "signal": SQUARE}]


@pytest.mark.parametrize(
    ("signal", "seconds"),
    [
        (SQUARE, 6),
        (STEP, 10),
        (
            {"type": "sequence", "segments": SEGMENTS, "start": 1},
            1 + 1.04 * 4,
        ),  # and a little of what comes then
        ({"type": "sum", "parts": [SQUARE, STEP]}, 10),
        ({"type": "sum", "parts": [SQUARE, {"type": "sequence", "segments": SEGMENTS}]}, 6),
        (
            {"type": "sequence", "segments": [{"duration": 1e6, "signal": STEP}]},
            1.04e6,
        ),  # of which the server draws as much as it can, and says so
        ({"type": "sequence", "segments": [{"duration": "2 s", "signal": STEP}]}, 10),  # a text of a form
        ({"type": "sequence", "segments": [{}]}, 10),
        ({"type": "sum", "parts": []}, 10),
    ],
)
def test_a_signal_is_drawn_over_all_its_parts(call: Call, signal: dict[str, Any], seconds: float) -> None:
    assert call("generator", "(m, g) => m.spanOf(g)", signal) == pytest.approx(seconds)


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (3.09e-7, 2, "0.00 to 2.00"),
        (-2, 4, "−2.00 to 4.00"),
        (1, 1, "1.00 to 1.00"),
        (-3e-13, 3e-13, "0 to 0"),
        (100.25, 100.5, "100.250 to 100.500"),
        (0, 100, "0 to 100"),
        (-1e-9, 2e7, "0 to 2.00e+7"),
        (0, 0, "0 to 0"),
        (None, None, "not a number that can be drawn"),
    ],
)
def test_a_range_is_reported_in_the_digits_that_it_has_use_for(
    call: Call, low: Any, high: Any, words: str
) -> None:
    assert (
        call("preview", "(m, [low, high]) => m.rangeWords(low ?? Infinity, high ?? -Infinity)", [low, high])
        == words
    )


def test_what_a_preview_leaves_out_is_said(call: Call) -> None:
    found = {
        "low": [1, None],
        "high": [1, None],
        "unit": "V",
        "duration": 3600,
        "length": 4060,
        "later": [-3, 3],
    }
    said = "1.00 to 1.00 V over the first 3600 s of 4060 s; "
    assert call("preview", "(m, g) => m.caption(g)", found) == said + "later it goes from −3.00 to 3.00 V"
    untold = {**found, "later": None}
    assert call("preview", "(m, g) => m.caption(g)", untold) == said + "what comes later isn't shown"
    whole = {**found, "duration": 4060, "later": None}
    assert call("preview", "(m, g) => m.caption(g)", whole) == "1.00 to 1.00 V over 4060 s"


def test_a_line_goes_through_all_extremes(call: Call) -> None:
    rng = np.random.default_rng(5)
    low = rng.normal(size=200)
    high = low + rng.exponential(size=200)
    given = {"t": list(range(201)), "low": low.tolist(), "high": high.tolist()}
    line = np.array(call("preview", "(m, g) => m.outline(g)", given)).reshape(200, 2, 2)
    np.testing.assert_array_equal(line[:, :, 0], [[k, k + 1] for k in range(200)])
    np.testing.assert_array_equal(np.sort(line[:, :, 1]), np.column_stack([low, high]))
    # It turns back no farther than it has to: the way to each column is the shorter one of the two.
    begins, ends = line[1:, 0, 1], line[:-1, 1, 1]
    np.testing.assert_allclose(
        np.abs(begins - ends), np.minimum(np.abs(low[1:] - ends), np.abs(high[1:] - ends))
    )

    gap = {"t": [0, 1, 2, 3], "low": [1, None, 2], "high": [1, None, 2]}
    assert call("preview", "(m, g) => m.outline(g)", gap) == [[0, 1], [1, 1], None, [2, 2], [3, 2]]


def test_a_scope_shows_what_a_filter_has_left_at_rest_as_nothing(call: Call) -> None:
    # 60 rad/s through e^(-50 t): in 2.1 s it is below what a float32 can hold, and it was a scope of 1e-30 rad/s until then.
    t = np.arange(0, 3, 0.05)
    lows_and_highs = [[0.0, float(v)] for v in np.float32(60 * np.exp(-50 * t))]
    body = "(m, g) => { const s = new m.Span(1e-3); return g.map(([low, high]) => s.holding(low, high)); }"
    ranges = call("span", body, lows_and_highs)

    for (low, high), (bottom, top) in zip(lows_and_highs, ranges, strict=True):
        assert bottom < low <= high < top
        assert top - bottom > 1e-3


def test_half_an_interval_is_reported_in_percent_unless_it_is_wider_than_its_value(call: Call) -> None:
    half = (
        "(live, { value, low, high, unit }) => live.halfWidth(value, low === null ? null : [low, high], unit)"
    )
    assert call("live", half, {"value": 2.0, "low": 1.9, "high": 2.1, "unit": "V"}) == "±5.0 %"
    assert call("live", half, {"value": -2.0, "low": -2.1, "high": -1.9, "unit": "V"}) == "±5.0 %"
    # 0.01577 V over 0.001 V would be 1577 %.
    near_zero = {"value": 0.001, "low": -0.01477, "high": 0.01677, "unit": "V"}
    assert call("live", half, near_zero) == "±0.016 V"
    assert call("live", half, {"value": 0.0, "low": -0.01, "high": 0.01, "unit": "V"}) == "±0.010 V"
    assert call("live", half, {"value": 1.0, "low": None, "high": None, "unit": "V"}) == ""


def test_a_silence_is_no_refusal(call: Call) -> None:
    outcome = call("commands", "(commands) => new commands.Commands(() => true, 20).ask({ do: 'set' })")
    assert outcome["silent"]
    said = call("status", "(status, outcome) => status.failed(outcome)", outcome)
    assert said.startswith("No answer in 0.02 s")
    assert "STOP" in said
    assert call("status", "(status, outcome) => status.failed(outcome)", {"why": "no"}) == "Refused: no"
