"""The inputs of the random motors: what people drive a motor with, one way and both ways."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Draw = Callable[[Array, float, float, np.random.Generator], Array]


def step(t: Array, amplitude: float, tau: float, random: np.random.Generator) -> Array:
    """The amplitude from the start on."""
    return np.full(len(t), amplitude)


def steps(t: Array, amplitude: float, tau: float, random: np.random.Generator) -> Array:
    """Levels both ways, each held for 1 to 8 time constants, the first the whole amplitude."""
    changes = np.cumsum(random.uniform(1.0, 8.0, 200)) * tau
    levels = amplitude * random.choice([-1.0, -0.5, 0.0, 0.5, 1.0], 201)
    levels[0], levels[1] = amplitude, -amplitude
    return levels[_held(t, changes)]


def square_two(t: Array, amplitude: float, tau: float, random: np.random.Generator) -> Array:
    """Both signs of the amplitude in turns, 1 to 8 time constants each."""
    return np.where(_half_periods(t, tau, random) % 2 == 0, amplitude, -amplitude)


def square_one(t: Array, amplitude: float, tau: float, random: np.random.Generator) -> Array:
    """The amplitude and 15 to 60 % of it in turns, 1 to 8 time constants each."""
    low = amplitude * random.uniform(0.15, 0.6)
    return np.where(_half_periods(t, tau, random) % 2 == 0, amplitude, low)


def stair_two(t: Array, amplitude: float, tau: float, random: np.random.Generator) -> Array:
    """Up to the amplitude in 2 to 5 stairs, down to its opposite, and so on."""
    count = int(random.integers(2, 6))
    up = np.arange(1, count + 1)
    round_trip = np.concatenate([up, up[::-1][1:], [0], -up, -up[::-1][1:], [0]])
    return amplitude / count * round_trip[_half_periods(t, tau, random) % len(round_trip)]


def stair_one(t: Array, amplitude: float, tau: float, random: np.random.Generator) -> Array:
    """Up to the amplitude in 2 to 5 stairs, and down again."""
    count = int(random.integers(2, 6))
    up = np.arange(1, count + 1)
    round_trip = np.concatenate([up, up[::-1][1:-1]])
    return amplitude / count * round_trip[_half_periods(t, tau, random) % len(round_trip)]


def prbs_two(t: Array, amplitude: float, tau: float, random: np.random.Generator) -> Array:
    """Random bits, both signs of the amplitude, each held for 0.3 to 3 time constants."""
    return np.where(_bits(t, tau, random), amplitude, -amplitude)


def prbs_one(t: Array, amplitude: float, tau: float, random: np.random.Generator) -> Array:
    """Random bits, the amplitude and 15 to 60 % of it, each held for 0.3 to 3 time constants."""
    low = amplitude * random.uniform(0.15, 0.6)
    return np.where(_bits(t, tau, random), amplitude, low)


def chirp(t: Array, amplitude: float, tau: float, random: np.random.Generator) -> Array:
    """A sine whose frequency rises linearly from 0.1/τ to 1/τ ... 5/τ rad/s."""
    low, high = 0.1 / tau, random.uniform(1.0, 5.0) / tau
    return amplitude * np.sin(low * t + 0.5 * (high - low) * t**2 / t[-1])


def multisine(t: Array, amplitude: float, tau: float, random: np.random.Generator) -> Array:
    """Five to ten sines between 0.1/τ and 3/τ rad/s, random phases, with the amplitude as its largest value."""
    count = int(random.integers(5, 11))
    omega = np.exp(random.uniform(np.log(0.1 / tau), np.log(3.0 / tau), count))
    u = np.sin(omega * t[:, None] + random.uniform(0.0, 2 * np.pi, count)).sum(axis=1)
    return amplitude * u / np.abs(u).max()


def sine(t: Array, amplitude: float, tau: float, random: np.random.Generator) -> Array:
    """One sine between 0.2/τ and 3/τ rad/s."""
    return amplitude * np.sin(np.exp(random.uniform(np.log(0.2), np.log(3.0))) / tau * t)


def ramp(t: Array, amplitude: float, tau: float, random: np.random.Generator) -> Array:
    """From zero to the amplitude, steadily."""
    return amplitude * t / t[-1]


INPUTS: dict[str, Draw] = {
    draw.__name__: draw
    for draw in (
        step,
        steps,
        square_two,
        square_one,
        stair_two,
        stair_one,
        prbs_two,
        prbs_one,
        chirp,
        multisine,
        sine,
        ramp,
    )
}


def _held(t: Array, changes: Array) -> NDArray[np.int64]:
    """The number of changes until each time t (N,); a billionth of a sample early is rounding."""
    return np.searchsorted(changes, t + 1e-9 * (t[1] - t[0]), side="right")


def _half_periods(t: Array, tau: float, random: np.random.Generator) -> NDArray[np.int64]:
    """The number of half periods that have passed, each of 1 to 8 time constants and at most a third of the record."""
    half = min(tau * np.exp(random.uniform(np.log(1.0), np.log(8.0))), t[-1] / 3)
    return _held(t, half * np.arange(1, 2 + int(t[-1] / half)))


def _bits(t: Array, tau: float, random: np.random.Generator) -> NDArray[np.bool_]:
    """Random bits, the first one on, each held for 0.3 to 3 time constants and at least one sample."""
    hold = max(tau * np.exp(random.uniform(np.log(0.3), np.log(3.0))), t[1] - t[0])
    number = _held(t, hold * np.arange(1, 2 + int(t[-1] / hold)))
    bits = random.integers(0, 2, number[-1] + 1).astype(bool)
    bits[0] = True
    return bits[number]
