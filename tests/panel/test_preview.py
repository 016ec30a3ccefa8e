"""A signal is drawn as the loop would put it out: nothing is too fast or too short to be seen, and what is left out is said."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.panel import preview
from servobench.panel.preview import COLUMNS, extremes, preview_signal, work_of
from servobench.rig.experiment import Experiment
from servobench.systems.signals.multisine import Multisine
from servobench.systems.signals.sequence import Sequence
from servobench.systems.signals.sine import Sine
from servobench.systems.signals.square import Square
from servobench.systems.signals.sum import Sum


def drawn(signal: dict[str, Any], duration: float, sample_time: float = 0.001) -> dict[str, Any]:
    return preview_signal({"signal": signal, "duration": duration}, Experiment(sample_time=sample_time))


def sequence(*segments: tuple[float, dict[str, Any]]) -> dict[str, Any]:
    return {"type": "sequence", "segments": [{"duration": d, "signal": signal} for d, signal in segments]}


def constant(value: float) -> dict[str, Any]:
    return {"type": "constant", "value": value}


@pytest.mark.parametrize("frequency", [150, 350, 450])
def test_a_fast_sine_fills_every_column(frequency: int) -> None:
    found = drawn({"type": "sum", "parts": [constant(2.0), {"type": "sine", "frequency": frequency}]}, 10.0)

    # At 1 ms the samples are sin(2π m k / 20) with m = f/50 odd and no multiple of 5: 20 samples have each angle of 18° once. Of
    # 17 of them in a row, a column's least number, 3 are missing; one of the peak and its two neighbours, which are 3, 7 or 9
    # samples apart, is there, and that is cos(18°) at least.
    assert len(found["low"]) == COLUMNS
    assert min(np.diff(np.round(np.array(found["t"]) / 0.001))) == 17
    least = math.cos(math.radians(18)) - 1e-9
    assert min(found["high"]) >= 2 + least
    assert max(found["low"]) <= 2 - least
    assert max(found["high"]) == pytest.approx(3)
    assert (found["duration"], found["length"], found["later"]) == (10.0, 10.0, None)


def test_a_sine_that_each_sample_is_drawn_of_has_its_extremes() -> None:
    found = drawn({"type": "sine", "frequency": 50}, 0.4)

    assert len(found["low"]) == 400  # a column for each sample: nothing is put together
    assert found["low"] == found["high"]
    value = np.array(found["low"])
    # 20 periods of 20 samples, which have the peaks among them.
    assert np.count_nonzero(np.isclose(value, 1)) == np.count_nonzero(np.isclose(value, -1)) == 20
    # 50 · 0.001 · k is whole or half at every tenth sample: 40 zeros, between which the sign changes.
    assert np.count_nonzero(np.isclose(value, 0)) == 40


def test_one_short_pulse_is_in_the_column_that_it_is_in() -> None:
    pulse = sequence((1234.567, constant(0)), (0.001, constant(5)), (1000, constant(0)))
    found = drawn(pulse, 2234.568)

    (k,) = np.flatnonzero(np.array(found["high"]) == 5.0)
    assert found["t"][k] <= 1234.567 < found["t"][k + 1]
    assert sum(found["high"]) == 5.0
    assert not any(found["low"])


def test_as_many_edges_are_drawn_as_there_are() -> None:
    found = drawn({"type": "square", "low": -1, "high": 1, "frequency": 10}, 3.003)

    # 30 periods: each column is shorter than a half one, so that an edge is a column with both values or a change between two.
    low, high = np.array(found["low"]), np.array(found["high"])
    both = np.count_nonzero(low != high)
    between = np.count_nonzero((low[1:] > high[:-1]) | (high[1:] < low[:-1]))
    assert both + between == 60


def test_columns_are_the_same_whatever_the_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    signal = Sum(parts=[Square(frequency=7), Sine(frequency=33)])
    edges = np.linspace(0, 4000, 61).astype(np.int64)
    values = signal(np.arange(4000) * 0.002)
    wanted = [(values[a:b].min(), values[a:b].max()) for a, b in itertools.pairwise(edges)]
    for block in (1, 70, 500, 10_000):
        monkeypatch.setattr(preview, "_BLOCK", block)
        np.testing.assert_array_equal(np.transpose(extremes(signal, 0.002, edges)), wanted)


def test_what_is_not_finite_is_left_out() -> None:
    edges = np.array([0, 2, 4, 6])

    def signal(t: np.ndarray) -> np.ndarray:
        return np.array([1.0, np.inf, np.nan, -np.inf, 3.0, -2.0])

    low, high = extremes(signal, 1.0, edges)  # type: ignore[arg-type]
    np.testing.assert_array_equal(low, [1, np.nan, -2])
    np.testing.assert_array_equal(high, [1, np.nan, 3])


def test_what_is_too_much_work_is_shortened_and_what_comes_later_is_said_where_it_can_be(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    signal = sequence((40.0, constant(1)), (1.5, {"type": "square", "low": -3, "high": 3, "frequency": 2}))
    whole = drawn(signal, 41.5)
    assert (whole["duration"], whole["later"]) == (41.5, None)
    assert (min(whole["low"]), max(whole["high"])) == (-3.0, 3.0)

    monkeypatch.setattr(
        preview, "MOST_WORK", 45_000
    )  # 30,000 samples: a plain signal's 1, and 0.25 for each segment
    first = drawn(signal, 41.5)
    assert (first["duration"], first["length"], first["later"]) == (30.0, 41.5, [-3.0, 3.0])
    assert set(first["low"]) == set(first["high"]) == {1.0}
    assert first["t"][-1] == pytest.approx(30.0)
    assert drawn(signal, 61.0)["later"] is None  # 31,000 samples more are too many again
    assert drawn(signal, 1e300)["duration"] == 30.0


def test_the_work_of_a_signal_is_that_of_its_parts() -> None:
    assert work_of(Sine()) == 1
    assert work_of(Sum(parts=[Sine(), Square(), Sine()])) == 3
    segments = [{"duration": 1, "signal": Sum(parts=[Sine(), Sine()])}, {"duration": 2, "signal": Sine()}]
    assert work_of(Sequence(segments=segments)) == 2.5
    assert work_of(Multisine(frequency=0.1, highest=5)) == 76


def test_a_short_time_is_long_enough_to_see_what_is_put_out() -> None:
    found = drawn({"type": "sine", "frequency": 400}, 0.005)

    assert (found["duration"], found["length"]) == (0.02, 0.02)
    # sin(2π · 0.4 k): five angles, of which the largest is 72°.
    assert max(found["high"]) == pytest.approx(math.sin(math.radians(72)))


@pytest.mark.parametrize("duration", [0, -1, "ten", None, math.inf, math.nan])
def test_a_duration_that_cannot_be_is_reported(duration: object) -> None:
    with pytest.raises(UsageError, match="expected a number above 0"):
        preview_signal({"signal": {"type": "sine"}, "duration": duration}, Experiment())
