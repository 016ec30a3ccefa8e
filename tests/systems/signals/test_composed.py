"""Signals made of signals: sum and sequence."""

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.systems.signals.constant import Constant
from servobench.systems.signals.prbs import PRBS
from servobench.systems.signals.ramp import Ramp
from servobench.systems.signals.sequence import Sequence
from servobench.systems.signals.sine import Sine
from servobench.systems.signals.square import Square
from servobench.systems.signals.step import Step
from servobench.systems.signals.sum import Sum


def test_a_sum_is_the_sum_of_its_parts() -> None:
    t = np.arange(1000) * 0.01
    parts = (Square(), Sine(frequency=2), Constant(value=-1))

    np.testing.assert_array_equal(Sum(parts=parts)(t), parts[0](t) + parts[1](t) + parts[2](t))


@pytest.mark.parametrize(
    ("parts", "expected"),
    [
        ((Sine(frequency=0.4), Sine(frequency=1)), 5.0),
        ((Sine(frequency=0.3), Sine(frequency=0.7)), 10.0),
        ((Sine(frequency=1 / 3), Sine(frequency=1 / 7)), 21.0),
        ((Square(), Constant()), 2.5),
        ((Sum(parts=(Sine(frequency=2), Sine(frequency=3))), Sine(frequency=5)), 1.0),
        ((Constant(), Constant()), None),
        ((Square(), Ramp()), None),
        ((Square(), Step()), None),
        ((Sine(frequency=1), Sine(frequency=2**0.5)), None),
    ],
)
def test_a_sum_repeats_after_the_least_common_multiple_of_its_periods(
    parts: tuple, expected: float | None
) -> None:
    period = Sum(parts=parts).period

    assert period == (None if expected is None else pytest.approx(expected, rel=1e-12))


def test_a_sum_changes_as_fast_as_its_fastest_part() -> None:
    assert Sum(parts=(Square(), PRBS(bit_time="20 ms"), Constant())).shortest_change == 0.02
    assert Sum(parts=(Constant(), Step())).shortest_change is None


def test_a_sequence_gives_each_segment_its_own_time_and_is_zero_outside() -> None:
    sequence = Sequence(
        start=0.1,
        segments=[
            {"duration": 0.3, "signal": {"type": "constant", "value": 5}},
            {"duration": "200 ms", "signal": Ramp(initial=1, final=2, duration=0.1)},
        ],
    )

    u = sequence(np.arange(8) * 0.1)

    np.testing.assert_allclose(u, [0, 5, 5, 5, 1, 2, 0, 0], rtol=0, atol=1e-12)


def test_a_signal_in_a_sequence_begins_at_the_very_sample_of_its_segment() -> None:
    sequence = Sequence(
        segments=[
            {"duration": 0.7, "signal": Constant(value=9)},
            {"duration": 100, "signal": Square(frequency=0.4)},
        ]
    )

    u = sequence(np.arange(50_000) * 0.002)

    assert u[349] == 9
    np.testing.assert_array_equal(u[350:], Square(frequency=0.4)(np.arange(50_000 - 350) * 0.002))


def test_a_sequence_changes_as_fast_as_its_shortest_segment_or_its_fastest_signal() -> None:
    def sequence(bit_time: float) -> Sequence:
        segments = [
            {"duration": 0.5, "signal": Constant()},
            {"duration": 9, "signal": PRBS(bit_time=bit_time)},
        ]
        return Sequence(segments=segments)

    assert sequence(0.02).shortest_change == 0.02
    assert sequence(3).shortest_change == 0.5


def test_a_deep_nest_of_sums_is_looked_at_once() -> None:
    signal = Sine(frequency=5)
    for _ in range(60):  # looking twice at each level would take 2^60 steps
        signal = Sum(parts=(signal,))

    assert (signal.period, signal.shortest_change) == (0.2, 0.1)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Sum(parts=()), "is empty; expected one at least"),
        (lambda: Sequence(segments=()), "is empty; expected one at least"),
        (
            lambda: Sum(parts=(Square(), 3)),
            "3 isn't a signal; expected a table with a type, one of chirp, constant",
        ),
        (
            lambda: Sum(parts=({"low": 1},)),
            "is missing; expected the name of a signal; known: chirp, constant",
        ),
        (lambda: Sum(parts=({"type": "sinus"},)), r"no signal called 'sinus' \(did you mean 'sine'\?\)"),
        (lambda: Sum(parts=({"type": 1},)), "1 isn't the name of a signal"),
    ],
)
def test_what_is_no_signal_is_no_part(make, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        make()
