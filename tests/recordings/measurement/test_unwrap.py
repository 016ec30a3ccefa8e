"""The inverse modulus: exact over many wraps, both ways, at every width."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servobench.core.errors import UsageError
from servobench.recordings.measurement.unwrap import Unwrap, unwrap


def shown(counts: np.ndarray, bits: int) -> np.ndarray:
    """The values of a signed counter of so many bits."""
    half = 2 ** (bits - 1)
    return ((counts + half) % 2**bits - half).astype(np.float64)


@pytest.mark.parametrize("bits", [8, 16, 24, 32])
@pytest.mark.parametrize("sign", [1, -1])
def test_no_count_is_lost_over_many_wraps_one_way_and_back(bits: int, sign: int) -> None:
    largest = 2 ** (bits - 1) - 1  # the largest step that a counter can't mistake
    there = np.cumsum(np.full(1000, largest))
    counts = sign * np.concatenate([[5], 5 + there, 5 + there[::-1], [5]]).astype(np.int64)

    found = unwrap(shown(counts, bits), 2.0**bits)

    np.testing.assert_array_equal(found.count, counts.astype(float))
    np.testing.assert_array_equal(found.delta[1:], np.diff(counts))
    assert not found.ambiguous.any()
    assert np.abs(found.wrap).sum() > 900


@given(st.lists(st.integers(-127, 127), min_size=1, max_size=200), st.integers(-128, 127))
def test_any_travel_in_steps_below_half_the_modulus_comes_back(steps: list[int], first: int) -> None:
    counts = first + np.cumsum([0, *steps])

    found = unwrap(shown(counts, 8), 256.0)

    np.testing.assert_array_equal(found.count, counts)


def test_a_wrap_counts_up_when_the_counter_falls_from_its_largest_to_its_smallest_value() -> None:
    found = unwrap(np.array([32766.0, 32767.0, -32768.0, 32767.0]), 65536.0)

    assert found.wrap.tolist() == [0, 0, 1, -1]
    assert found.delta.tolist() == [0.0, 1.0, 1.0, -1.0]
    assert found.count.tolist() == [32766.0, 32767.0, 32768.0, 32767.0]


@pytest.mark.parametrize("step", [32768.0, -32768.0])
def test_half_the_modulus_is_reported_as_ambiguous(step: float) -> None:
    assert unwrap(np.array([0.0, 1.0, 1.0 + step, 2.0 + step]), 65536.0).ambiguous.tolist() == [
        False,
        False,
        True,
        False,
    ]


@pytest.mark.parametrize("step", [32767.0, -32767.0, 32769.0])
def test_one_count_off_half_the_modulus_is_not_ambiguous(step: float) -> None:
    assert not unwrap(np.array([0.0, step]), 65536.0).ambiguous.any()


def test_it_is_not_linear_and_says_so() -> None:
    stage, t = Unwrap(modulus=256.0, unit="counts"), np.arange(2.0)
    x = np.array([0.0, 100.0])

    assert not Unwrap.linear
    assert stage(2 * x, t)[1] != 2 * stage(x, t)[1]


def test_a_width_in_bits_is_a_number_of_counts() -> None:
    assert (
        Unwrap.parse(("16", "bit"))
        == Unwrap.parse(("65536", "counts"))
        == Unwrap(modulus=65536.0, unit="counts")
    )
    assert str(Unwrap.parse(("16", "bit"))) == "unwrap 65536 counts"


def test_an_angle_in_degrees_is_unwrapped_in_radians() -> None:
    angle = np.linspace(0.0, 30.0, 200)

    unwrapped_angle = Unwrap(modulus=360.0, unit="deg")(np.angle(np.exp(1j * angle)), angle)

    np.testing.assert_allclose(unwrapped_angle, angle, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "words",
    [
        (),
        ("16",),
        ("bit",),
        ("16.5", "bit"),
        ("0", "bit"),
        ("54", "bit"),
        ("360", "deg/s"),
        ("-1", "rev"),
        ("1", "foo"),
    ],
)
def test_a_modulus_that_is_none_is_refused(words: tuple[str, ...]) -> None:
    with pytest.raises(UsageError, match="unwrap"):
        Unwrap.parse(words)
