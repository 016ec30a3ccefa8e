"""A peer's input and output: one record, and an answer in continuous time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Interval = tuple[float, float]
QUANTUM = 2 * math.pi / 2048  # rad


class NoAnswer(Exception):
    """The peer ended, and what it gave is no motor."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """One record: times [s], voltage [V] and counts, all (N,)."""

    t: Array
    u: Array
    counts: Array

    @property
    def sample_time(self) -> float:
        """The time between samples [s]."""
        return float(self.t[1] - self.t[0])

    @property
    def position(self) -> Array:
        """The middle of each count's bin [rad], (N,)."""
        return (self.counts + 0.5) * QUANTUM

    @property
    def speed(self) -> Array:
        """The difference of the positions over the sample time [rad/s], (N - 1,)."""
        return np.diff(self.position) / self.sample_time


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Gain [rad/(s·V)] and time constant [s], with 95 % intervals where there are any.

    `interval_from` is "tool" where the tool gives them, "hand" where they are worked out by hand from something that it gives.
    `seconds` is the time of the fit where the tool itself has measured it.
    """

    gain: float
    time_constant: float
    gain_interval: Interval | None = None
    time_constant_interval: Interval | None = None
    interval_from: str = ""
    note: str = ""
    seconds: float | None = None


Method = Callable[[Record], Answer]
Linear = Callable[[Array, Array, float], Answer]


def time_constant_of(pole: complex, sample_time: float) -> float:
    """Return τ = -T/ln a of a discrete pole a [s]; raises `NoAnswer` for a pole that no lag of first order has."""
    if abs(pole.imag) > 1e-9 * abs(pole) or not 0.0 < pole.real < 1.0:
        raise NoAnswer(f"the pole {pole:.4g} isn't a first-order lag")
    return -sample_time / math.log(pole.real)


def answer_of(pole: complex, gain: float, sample_time: float) -> Answer:
    """Return the answer for a discrete pole and the gain at zero frequency."""
    return Answer(gain=float(gain), time_constant=time_constant_of(complex(pole), sample_time))


def state_space_answer(a: Array, b: Array, c: Array, d: Array, sample_time: float) -> Answer:
    """Return the answer for x⁺ = A x + B u, y = C x + D u with a single state."""
    pole = complex(np.linalg.eigvals(a)[0])
    gain = np.asarray(c) @ np.linalg.solve(np.eye(len(a)) - a, b) + d
    return answer_of(pole, float(np.squeeze(gain)), sample_time)


def both_ways(name: str, fit: Linear, *, forward: bool = False) -> dict[str, Method]:
    """Return a linear method twice: on voltage and speed as they are, and with the mean taken out of both.

    `fit` takes voltage and speed, both (N - 1,), and the sample time. A difference of positions belongs to the sample at its
    end: then u(k-1) and u(k-2) act on it, which is one pole and two numerator terms. With `forward` it belongs to the one at its
    beginning: then u(k) and u(k-1) act on it, which is one state and a direct term, exact for a state-space method.
    """

    def signals(record: Record) -> tuple[Array, Array]:
        return (record.u[:-1] if forward else record.u[1:]), record.speed

    def raw(record: Record) -> Answer:
        return fit(*signals(record), record.sample_time)

    def detrended(record: Record) -> Answer:
        u, y = signals(record)
        return fit(u - u.mean(), y - y.mean(), record.sample_time)

    return {name: raw, f"{name}, detrended": detrended}


def interval(value: float, sd: float) -> Interval:
    """Return the 95 % interval value ± 1.96 sd."""
    return (value - 1.959964 * sd, value + 1.959964 * sd)
