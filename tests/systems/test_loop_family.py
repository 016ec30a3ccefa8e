"""A family of sampled loops beside the same loops one by one, over motors, controllers and delays drawn at random."""

import math
from dataclasses import astuple, replace

import numpy as np
import pytest

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.systems.margins import Margins
from servobench.systems.responses import positive_roots_of_each, roots
from servobench.systems.sampled_loop import (
    SampledLoop,
    margins_and_gain_range,
    sampled_series,
    sampled_series_of_each,
)
from servobench.systems.stability.loop_family import margins_and_gain_ranges, margins_of_family
from servobench.systems.transfer_function import TransferFunction

H = 0.002  # s
CONTROLLERS = {
    "unit feedback": TransferFunction(numerator=(1.0,), denominator=(1.0,)),
    "negative": TransferFunction(numerator=(-1.0,), denominator=(1.0,)),
    "PI": TransferFunction(numerator=(0.5, 3.0), denominator=(1.0, 0.0)),
    "PD": TransferFunction(numerator=(0.1, 1.0), denominator=(1.0,)),
    "late lead": TransferFunction(numerator=(0.1, 1.0), denominator=(0.002, 1.0), delay=0.0007),
    "second order": TransferFunction(numerator=(1e-3, 0.2, 1.0), denominator=(2e-6, 0.003, 1.0)),
}


def system(rng: np.random.Generator) -> TransferFunction:
    """A motor: its speed, its angle, with a winding, with a spring, or one that runs away; one in four wired the wrong way."""
    tau = 10 ** rng.uniform(-3, 0)
    denominators = (
        (tau, 1.0), (tau, 1.0, 0.0), (0.1 * tau**2, 1.1 * tau, 1.0, 0.0), (tau**2, 0.1 * tau, 1.0), (tau, -1.0, 0.0)
    )  # fmt: skip
    return TransferFunction(
        numerator=(10 ** rng.uniform(-1, 2.5) * rng.choice([1.0, 1.0, 1.0, -1.0]),),
        denominator=denominators[rng.integers(len(denominators))],
        delay=float(
            rng.choice([0.0, -1e-4, H, H * rng.uniform(), 5 * H * rng.uniform(), 40 * H * rng.uniform()])
        ),
    )


def family(controller: TransferFunction, seed: int, count: int = 150) -> list[SampledLoop]:
    rng = np.random.default_rng(seed)
    return sampled_series_of_each(controller, [system(rng) for _ in range(count)], H)


def numbers(margins: Margins, gain_range: tuple[float, float]) -> Array:
    return np.array([*astuple(margins), *gain_range])


@pytest.mark.parametrize("name", CONTROLLERS)
def test_each_loop_of_a_family_has_the_margins_that_it_has_alone(name: str) -> None:
    loops = family(CONTROLLERS[name], seed=4)

    for loop, (margins, gain_range) in zip(loops, margins_and_gain_ranges(loops), strict=True):
        # Both find a crossing to the last digits of α; a margin near zero is off by those of a turn.
        np.testing.assert_allclose(
            numbers(margins, gain_range), numbers(*margins_and_gain_range(loop)), rtol=1e-9, atol=1e-12
        )


@pytest.mark.parametrize("name", CONTROLLERS)
def test_a_system_is_sampled_among_others_as_it_is_alone(name: str) -> None:
    rng = np.random.default_rng(5)
    systems = [system(rng) for _ in range(100)]

    for loop, each in zip(sampled_series_of_each(CONTROLLERS[name], systems, H), systems, strict=True):
        alone = sampled_series(CONTROLLERS[name], each, H)
        assert loop == replace(alone, numerator=loop.numerator, denominator=loop.denominator)
        np.testing.assert_allclose(loop.numerator, alone.numerator, rtol=1e-12)
        np.testing.assert_allclose(loop.denominator, alone.denominator, rtol=1e-12)


@pytest.mark.parametrize("count", [1, 8])
def test_the_order_of_the_loops_is_kept_and_a_loop_without_gain_limits_nothing(count: int) -> None:
    loops = family(CONTROLLERS["PI"], seed=6, count=40)
    still = replace(loops[0], numerator=(0.0, 0.0))
    result = margins_of_family([*[still] * count, *loops[::-1], still])

    assert result[0].gain_margin == result[-1].delay_margin == math.inf
    np.testing.assert_allclose(
        [astuple(each) for each in result[count:-1]],
        [astuple(each) for each in margins_of_family(loops)[::-1]],
        rtol=1e-12,
    )


def test_one_system_with_a_delay_beyond_all_sample_times_is_refused_for_all() -> None:
    motor = TransferFunction(numerator=(20.0,), denominator=(0.1, 1.0, 0.0))
    with pytest.raises(UsageError, match="sample times"):
        sampled_series_of_each(CONTROLLERS["PI"], [motor, replace(motor, delay=1e9)], H)


def test_no_loops_have_no_margins() -> None:
    assert margins_of_family(sampled_series_of_each(CONTROLLERS["PI"], [], H)) == []


def test_roots_are_those_of_numpy_whatever_coefficients_are_zero() -> None:
    polynomials = np.array(
        [[1.0, -6.0, 11.0, -6.0], [0.0, 2.0, 0.0, 8.0], [3.0, 6.0, 0.0, 0.0], [0.0, 0.0, 0.0, 5.0], [0.0] * 4]
    )

    for polynomial, each in zip(polynomials, roots(polynomials), strict=True):
        own = each[~np.isnan(each)]
        np.testing.assert_allclose(np.sort_complex(own), np.sort_complex(np.roots(polynomial)), atol=1e-12)
    expected = [[1.0, 2.0, 3.0], *[[math.nan] * 3] * 4]
    np.testing.assert_allclose(positive_roots_of_each(polynomials), expected, rtol=1e-12)


@pytest.mark.parametrize(("delay", "whole"), [(0.0, 0), (0.5 * H, 1), (2 * H, 2)])
def test_a_mere_gain_acts_at_ticks_only(delay: float, whole: int) -> None:
    gain = TransferFunction(numerator=(3.0,), denominator=(1.0,), delay=delay)

    loop = sampled_series(CONTROLLERS["unit feedback"], gain, H)

    assert (loop.numerator, loop.denominator, loop.whole) == ((3.0,), (1.0,), whole)
