"""The inputs of the benches: three voltages of 10 s at 500 Hz, each drawn anew for each run."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SAMPLES = 5000
SAMPLE_TIME = 0.002
_BIT = 50  # samples, 0.1 s


def one_way(random: np.random.Generator) -> Array:
    """3 V and 1 V in turns, 0.4 Hz, any phase."""
    return _square(random, 1.0, 3.0)


def square(random: np.random.Generator) -> Array:
    """2 V and -2 V in turns, 0.4 Hz, any phase."""
    return _square(random, -2.0, 2.0)


def prbs(random: np.random.Generator) -> Array:
    """±3 V from a shift register of 10 bits (x¹⁰ + x⁷ + 1) that starts anywhere, bits of 0.1 s."""
    register = [int(bit) for bit in random.integers(0, 2, 10)]
    if not any(register):
        register[0] = 1
    bits = []
    while len(bits) * _BIT < SAMPLES:
        bits.append(register[9])
        register = [register[9] ^ register[6], *register[:9]]
    return np.repeat(np.where(np.array(bits) == 1, 3.0, -3.0), _BIT)[:SAMPLES]


INPUTS: dict[str, Callable[[np.random.Generator], Array]] = {
    "square ±2 V": square,
    "PRBS ±3 V": prbs,
    "square 1-3 V": one_way,
}


def _square(random: np.random.Generator, low: float, high: float) -> Array:
    t = np.arange(SAMPLES) * SAMPLE_TIME
    return np.where((0.4 * t + random.random()) % 1.0 < 0.5, high, low)


def delayed(u: Array, before: float, delay: float) -> tuple[Array, Array, float]:
    """Return what acts first in each tick, what acts then, and for how long [s] the first does; both inputs (N,)."""
    whole = int(delay / SAMPLE_TIME + 1e-9)
    first = max(delay - whole * SAMPLE_TIME, 0.0)
    padded = np.concatenate([np.full(whole + 1, before), u])
    return padded[: len(u)], padded[1 : len(u) + 1], first
