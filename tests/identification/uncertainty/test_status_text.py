"""The words for what a record says of a parameter, and for what its figures are good for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servobench.core.estimate import Estimate
from servobench.identification.identify import identify
from servobench.identification.uncertainty.cautions import cautions
from servobench.identification.uncertainty.identifiability import Combination, ParameterStatus, State
from servobench.identification.uncertainty.purpose import good_for
from servobench.identification.uncertainty.status_text import in_words
from tests.datasets import dataset
from tests.rig.motor.reference import Truth


def answer(
    name: str, value: float, interval: tuple[float, float], unit: str, state: State
) -> ParameterStatus:
    estimate = Estimate(
        value=value, sd=(interval[1] - interval[0]) / 3.92, interval=interval, level=0.95, unit=unit
    )
    return ParameterStatus(name=name, state=state, estimate=estimate)


@pytest.mark.parametrize(
    ("interval", "text"),
    [
        ((-31.0, 0.18001), "at most 0.18 s"),
        ((-0.0007, 0.0246), "at most 25 ms"),
        ((-5.5, 5.5), "at most 5.5 s"),
    ],
)
def test_an_upper_end_has_the_digits_of_its_own_distance_and_none_of_the_lower_end(
    interval: tuple[float, float], text: str
) -> None:
    assert in_words(answer("delay", 0.00034, interval, "s", State.BOUNDED)) == text


def test_a_value_at_its_upper_end_has_one_all_the_same() -> None:
    """A delay may end at the longest that the first motion allows."""
    assert in_words(answer("delay", 0.180012, (-0.02, 0.180012), "s", State.BOUNDED)) == "at most 0.18 s"


def test_motors_are_told_apart_by_a_hundredth_of_a_percent_at_best() -> None:
    """A file without noise leaves a millionth; no motor is the same an hour later by so little."""
    gain = answer("gain", 50.0, (50.0 - 1e-6, 50.0 + 1e-6), "rad/(s·V)", State.KNOWN)

    assert good_for({"gain": gain}, (), float("nan"), 0.002) == (
        "Good enough to tell two motors apart whose gains differ by more than 0.01 %."
    )


@pytest.mark.parametrize(
    ("state", "expected"),
    [(State.KNOWN, "to simulate (it"), (State.COMBINATION, "to simulate motion like this record's (it")],
)
def test_a_model_without_a_gain_of_its_own_simulates_what_it_saw(state: State, expected: str) -> None:
    gain = answer("gain", 50.0, (40.0, 60.0), "rad/(s·V)", state)

    assert expected in good_for({"gain": gain}, (), 76.9, 0.002)
    assert "to simulate" not in good_for({"gain": gain}, (), 65.0, 0.002)


@pytest.mark.parametrize(("interval", "tunes"), [((0.02, 0.04), True), ((-0.04, -0.02), False)])
def test_no_loop_is_tuned_with_a_motor_that_moves_before_its_input(
    interval: tuple[float, float], tunes: bool
) -> None:
    gain = answer("gain", 50.0, (45.0, 55.0), "rad/(s·V)", State.KNOWN)
    estimate = answer("lag", 0.5 * sum(interval), interval, "s", State.KNOWN).estimate
    lag = Combination(
        name="lag", meaning="time constant + delay", parameters=("time_constant", "delay"), estimate=estimate
    )

    assert ("to tune a position loop" in good_for({"gain": gain}, (lag,), 90.0, 0.002)) is tunes


def test_what_a_motor_loses_that_turns_backwards_has_a_lower_end() -> None:
    """The constant that stands for friction then is below zero: it may be as much as 0.33 V."""
    given = answer("coulomb_voltage", -0.161, (-0.331, 0.0087), "V", State.BOUNDED)
    assert in_words(replace(given, mirrored=True)) == "at least −0.33 V"


@pytest.mark.parametrize(("sense", "words"), [(1, "at most"), (-1, "at least")])
def test_a_bound_is_the_end_on_the_side_to_which_the_motor_turned(sense: int, words: str) -> None:
    """Two levels for 80 ms each: the friction of 0.16 V may be none. An export's file says the same as the table."""
    u = sense * np.repeat([2.0, 1.5], 40)
    found = identify(dataset(seed=1, samples=80, u=u, truth=Truth(coulomb_torque=8e-4)))

    friction = found.answers["coulomb_voltage"]

    assert friction.state is State.BOUNDED
    low, high = friction.estimate.interval
    assert low < sense * 0.16 < high
    assert in_words(friction).startswith(words)
    assert any(in_words(friction) in sentence for sentence in cautions(found.to_dict(derived=False)))
