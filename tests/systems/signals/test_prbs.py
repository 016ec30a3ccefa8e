"""A PRBS is of maximum length: proved for each order, not believed of a table."""

import math

import numpy as np
import pytest

from servobench.core.errors import UsageError
from servobench.systems.signals.prbs import _LAGS, PRBS

ORDERS = sorted(_LAGS)


def bits(order: int, seed: int = 1) -> np.ndarray:
    """Return one period of the sequence as 0 and 1."""
    signal = PRBS(low=0, high=1, order=order, seed=seed, bit_time=1)
    return signal(np.arange(2**order - 1, dtype=float)).astype(int)


def prime_factors(n: int) -> set[int]:
    factors = set()
    for p in range(2, math.isqrt(n) + 1):
        while n % p == 0:
            factors.add(p)
            n //= p
    return factors | ({n} if n > 1 else set())


def power_of_x(exponent: int, polynomial: int) -> int:
    """Return x^exponent modulo a polynomial over GF(2); bit i of a number is the coefficient of x^i."""
    degree = polynomial.bit_length() - 1

    def product(a: int, b: int) -> int:
        result = 0
        while b:
            result ^= a if b & 1 else 0
            b >>= 1
            a <<= 1
            a ^= polynomial if a >> degree & 1 else 0
        return result

    result, square = 1, 2
    while exponent:
        result = product(result, square) if exponent & 1 else result
        square = product(square, square)
        exponent >>= 1
    return result


def test_orders_2_to_20_are_there() -> None:
    assert list(range(2, 21)) == ORDERS


@pytest.mark.parametrize("order", ORDERS)
def test_the_polynomial_is_primitive(order: int) -> None:
    # x[k] = sum of x[k - lag] has the characteristic polynomial x^n + sum of x^(n - lag). It is primitive where the order of x
    # is 2^n - 1, so that x to that power is 1 and x to that power over any of its prime factors isn't.
    lags = _LAGS[order]
    polynomial = (1 << order) | sum(1 << (order - lag) for lag in lags)

    assert lags[0] == order
    assert power_of_x(2**order - 1, polynomial) == 1
    assert all(power_of_x((2**order - 1) // p, polynomial) != 1 for p in prime_factors(2**order - 1))


@pytest.mark.parametrize("order", ORDERS)
def test_each_state_of_the_register_but_zero_occurs_once_in_a_period(order: int) -> None:
    sequence = bits(order)
    windows = sum(np.roll(sequence, -i) << (order - 1 - i) for i in range(order))

    np.testing.assert_array_equal(np.sort(windows), np.arange(1, 2**order))


@pytest.mark.parametrize("order", [2, 3, 7, 12, 16])
def test_the_autocorrelation_has_two_values(order: int) -> None:
    x = 2.0 * bits(order) - 1
    n = len(x)

    correlation = np.fft.irfft(np.abs(np.fft.rfft(x)) ** 2, n) / n

    # The transform of n values of size 1 is rounded by some eps · log2(n) of n.
    np.testing.assert_allclose(correlation[0], 1, rtol=0, atol=1e-12)
    np.testing.assert_allclose(correlation[1:], -1 / n, rtol=0, atol=1e-12)


@pytest.mark.parametrize("order", [2, 5, 8, 13, 19])
def test_the_sequence_is_what_a_register_shifts_out_bit_by_bit(order: int) -> None:
    seed = 2**order - 2
    register = [int(digit) for digit in f"{seed:b}"]  # the oldest bit first
    expected = []
    for _ in range(min(2**order - 1, 3000)):
        expected.append(register[0])
        register = [*register[1:], sum(register[-lag] for lag in _LAGS[order]) % 2]

    np.testing.assert_array_equal(bits(order, seed)[: len(expected)], expected)


def test_another_seed_begins_elsewhere_in_the_same_sequence() -> None:
    one, other = bits(8, 1), bits(8, 77)

    assert any(np.array_equal(np.roll(one, shift), other) for shift in range(1, 255))


def test_every_bit_has_the_same_number_of_samples_for_hours() -> None:
    signal = PRBS(bit_time="40 ms", order=10)
    k = np.arange(10**8, 10**8 + 20 * 5000)  # 55 hours after the start, at 500 Hz

    u = signal(k * 0.002).reshape(-1, 20)

    assert (u == u[:, :1]).all()


def test_it_begins_at_its_start_with_its_seed_and_is_low_before() -> None:
    signal = PRBS(low=-1, high=2, order=4, seed=0b1011, bit_time=0.1, start=0.3)

    np.testing.assert_array_equal(signal(np.arange(7) * 0.1), [-1, -1, -1, 2, -1, 2, 2])


@pytest.mark.parametrize(("order", "seed"), [(4, 16), (4, 0), (4, -1), (21, 1), (1, 1), (8, 1.0), (8, True)])
def test_an_impossible_register_is_refused(order: int, seed: int) -> None:
    with pytest.raises(UsageError):
        PRBS(order=order, seed=seed)


def test_its_sequence_can_not_be_overwritten() -> None:
    from servobench.systems.signals.prbs import _bits

    with pytest.raises(ValueError, match="read-only"):
        _bits(5, 1)[0] = True
