"""A dataset: what it refuses, what lies before it, and which start states nobody knows."""

from typing import Any

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.measurement.shared_samples import share_samples
from servobench.recordings.recording import Source

T = 0.002 * np.arange(1000)
X = np.cumsum(np.random.default_rng(7).normal(size=1000))


def dataset(**changes: Any) -> Dataset:
    given: dict[str, Any] = {
        "name": "test",
        "t_input": T,
        "u": np.sign(np.sin(20.0 * T)),
        "input_unit": "V",
        "input_before": -5.0,
        "t_output": T,
        "y": X,
        "output_unit": "rad",
        "kind": "position",
        "source": Source(name="test"),
    }
    return Dataset(**{**given, **changes})


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"y": X[:-1]}, "output has values of shape"),
        ({"u": np.full(1000, np.nan)}, "input has values that are not finite"),
        ({"t_output": T[::-1]}, "times of the output don't increase"),
        ({"rows": np.arange(999)}, "the rows have shape"),
    ],
)
def test_what_makes_no_dataset_is_refused(changes: dict[str, Any], why: str) -> None:
    with pytest.raises(UsageError, match=why):
        dataset(**changes)


def test_a_part_knows_the_input_that_held_before_it() -> None:
    part = dataset(t_input=np.array([0.0, 0.5, 1.5]), u=np.array([1.0, 2.0, 3.0])).part(0.6, 1.4)

    assert part.t_input.tolist() == [0.6]
    assert part.u.tolist() == [2.0]
    assert part.input_before == 2.0
    assert part.duration == pytest.approx(0.798)


def test_samples_of_a_part_keep_the_numbers_of_their_rows() -> None:
    part = dataset().part(0.6, 1.4)

    assert part.row_span(0, 2) == (301, 303)
    assert part.part(1.0, 1.4).row_span(0, 1) == (501, 502)


@pytest.mark.parametrize(
    ("t", "step", "text"),
    [
        (1.98, 0.02, "1.98 s"),
        (0.1 + 0.2, 0.002, "0.3 s"),
        (1746445283.2, 0.02, "1746445283.2 s"),
        (100.0, 1.0, "100 s"),
    ],
)
def test_a_time_is_told_to_less_than_a_sample(t: float, step: float, text: str) -> None:
    assert dataset(t_output=step * np.arange(1000)).in_seconds(t) == text


def test_a_part_of_less_than_two_samples_is_refused() -> None:
    with pytest.raises(UsageError, match="fewer than two samples"):
        dataset().part(5.0, 6.0)


def test_stages_that_start_with_the_record_have_no_unknown_state() -> None:
    data = dataset(applied=Chain.parse("derivative | lowpass 50 rad/s"), kind="speed", output_unit="rad/s")

    assert data.start_states == ()
    assert data.start_responses.shape == (1000, 0)
    assert data.shaft_kind == "position"
    assert np.argmax(data.valid) == 1


def test_in_a_later_part_they_have_one() -> None:
    data = dataset(applied=Chain.parse("derivative | lowpass 50 rad/s"), kind="speed", output_unit="rad/s")

    assert data.part(0.0, 1.0).start_states == ()
    later = data.part(0.5, 1.0)
    assert [(str(state.stage), state.kind) for state in later.start_states] == [("lowpass 50 rad/s", "speed")]
    assert later.chain == data.chain
    assert later.start_responses.shape == (len(later.y), 1)


@pytest.mark.parametrize(
    ("declared", "applied"),
    [
        ("derivative | lowpass 50 rad/s", ""),
        ("lowpass 50 rad/s", "derivative | lowpass 20 rad/s"),
        ("derivative", "lowpass 50 rad/s"),
        ("tachometer 10 ms", "average 20 ms | lowpass 50 rad/s euler"),
        ("derivative | average 30 ms | lowpass 10 rad/s", "lowpass 30 rad/s zoh"),
        ("average 30 ms | lowpass 10 rad/s", "tachometer 10 ms"),
    ],
)
def test_a_prediction_from_the_true_position_misses_the_data_by_its_start_states_only(
    declared: str, applied: str
) -> None:
    """Data: declared stages long at work when the record begins, applied stages started with it."""
    before, after = Chain.parse(declared), Chain.parse(applied)
    record = slice(300, None)
    y = after(before(X, T)[record], T[record])
    data = dataset(
        t_output=T[record], y=y, declared=before, applied=after, kind=(before + after).yields("position")
    )

    missed = (y - data.chain.linear(X[record], T[record]))[data.valid]

    responses = data.start_responses[data.valid]
    assert responses.shape[1] == len(data.start_states)
    explained = responses @ np.linalg.lstsq(responses, missed)[0] if responses.shape[1] else 0.0 * missed
    # Speeds of random steps are some 1000; sums of a few decays, conditioned by some hundred.
    np.testing.assert_allclose(missed, explained, rtol=0, atol=1e-11 * np.abs(y).max() + 1e-11)
    assert data.valid.mean() > 0.9


@pytest.mark.parametrize(("y", "same"), [(X, True), (np.zeros(1000), False), (np.full(1000, 5.0), False)])
def test_a_shaft_that_stood_says_nothing_of_whether_two_records_are_the_same(y: Any, same: bool) -> None:
    whole = dataset(y=y)
    cut = dataset(t_input=T[:900], u=whole.u[:900], t_output=T[:900], y=y[:900])

    assert share_samples(whole, cut) == same
