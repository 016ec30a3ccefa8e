"""The chain: its text, what goes in and comes out, and where it is applied."""

import numpy as np
import pytest

from servobench.core.errors import UnknownName, UsageError
from servobench.recordings.measurement.base import Chain, fold
from servobench.recordings.measurement.derivative import Derivative
from servobench.recordings.measurement.lowpass import Lowpass


def test_a_chain_is_read_from_its_text_and_written_as_it_was() -> None:
    chain = Chain.parse("derivative | lowpass 50 rad/s")

    assert chain.stages == (Derivative(), Lowpass(cutoff=50.0))
    assert str(chain) == "derivative | lowpass 50 rad/s"
    assert Chain.parse(str(chain)) == chain


def test_an_empty_text_is_an_empty_chain_and_changes_nothing() -> None:
    t, x = np.arange(3.0), np.array([1.0, 5.0, 2.0])

    assert Chain.parse("  ") == Chain()
    assert not Chain()
    assert str(Chain()) == ""
    np.testing.assert_array_equal(Chain()(x, t), x)
    assert Chain().valid(t).all()
    assert Chain().takes is None


@pytest.mark.parametrize("text", ["|", "derivative |", "| derivative", "derivative || lowpass 50 rad/s"])
def test_a_bar_with_nothing_beside_it_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="between two bars"):
        Chain.parse(text)


def test_a_misspelt_stage_is_reported_with_the_nearest_one() -> None:
    with pytest.raises(UnknownName, match="did you mean 'lowpass'"):
        Chain.parse("derivative | lowpas 50 rad/s")


@pytest.mark.parametrize(
    "text", ["derivative | derivative", "tachometer 10 ms | derivative", "derivative | unwrap 16 bit"]
)
def test_a_chain_that_nothing_can_pass_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="speed"):
        Chain.parse(text)


@pytest.mark.parametrize(
    ("text", "takes", "yields"),
    [
        ("derivative", "position", "speed"),
        ("lowpass 8 Hz | tachometer 10 ms", "position", "speed"),
        ("unwrap 16 bit", "position", "position"),
        ("unwrap 16 bit | derivative", "position", "speed"),
        ("lowpass 8 Hz | average 1 s | scale 2", None, "position"),
    ],
)
def test_a_chain_knows_what_it_takes_and_yields(text: str, takes: str | None, yields: str) -> None:
    assert Chain.parse(text).takes == takes
    assert Chain.parse(text).yields("position") == yields


def test_the_linear_part_leaves_out_the_unwrapping_only() -> None:
    assert (
        str(Chain.parse("unwrap 16 bit | derivative | lowpass 50 rad/s").linear)
        == "derivative | lowpass 50 rad/s"
    )


def test_a_chain_steps_live_as_it_runs_over_a_record() -> None:
    chain = Chain.parse("unwrap 8 bit | derivative | lowpass 50 rad/s euler | average 30 ms")
    t = 0.002 * np.arange(500)
    x = np.floor(900.0 * t) % 256

    np.testing.assert_allclose(fold(chain, x, t), chain(x, t), rtol=0, atol=1e-12 * 900)


def test_two_filters_have_two_start_states_a_position_and_a_speed() -> None:
    chain = Chain.parse("lowpass 20 rad/s | derivative | lowpass 50 rad/s")
    t = 0.002 * np.arange(100)

    states = chain.start_states("position")

    assert [(str(state.stage), state.kind) for state in states] == [
        ("lowpass 20 rad/s", "position"),
        ("lowpass 50 rad/s", "speed"),
    ]
    assert chain.start_responses(t).shape == (100, 2)


@pytest.mark.parametrize(
    ("x", "t", "why"),
    [
        (np.ones(3), np.arange(4.0), "shape"),
        (np.ones((2, 3)), np.arange(3.0), "shape"),
        (np.ones(()), np.arange(1.0), "shape"),
        (np.ones(3), np.array([0.0, 1.0, 1.0]), "increase"),
        (np.ones(3), np.array([0.0, 2.0, 1.0]), "increase"),
    ],
)
def test_samples_without_their_times_are_refused(x: np.ndarray, t: np.ndarray, why: str) -> None:
    with pytest.raises(UsageError, match=why):
        Chain.parse("derivative")(x, t)


def test_whole_numbers_are_differentiated_as_numbers() -> None:
    speed = Chain.parse("derivative")(np.array([0, 1, 3]), np.array([0.0, 2.0, 4.0]))

    np.testing.assert_array_equal(speed, [0.0, 0.5, 1.0])


@pytest.mark.parametrize("text", ["average 128", "average 128 samples"])
def test_an_average_over_a_number_of_samples_says_how_to_write_it_as_a_time(text: str) -> None:
    with pytest.raises(UsageError, match="128 samples of 1 ms are `average 128 ms`"):
        Chain.parse(text)
