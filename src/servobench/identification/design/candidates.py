"""Experiments to choose from: a few families of signals, each with a few values of its few parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Protocol

from servobench.identification.design.assumed_motor import AssumedMotor
from servobench.systems.signals.base import Signal
from servobench.systems.signals.multisine import Multisine
from servobench.systems.signals.prbs import PRBS
from servobench.systems.signals.square import Square
from servobench.systems.signals.staircase import Staircase
from servobench.systems.signals.sum import Sum

_DWELLS = (0.3, 0.5, 0.8, 1.2, 2.0, 3.0, 5.0, 8.0)  # time constants between two changes of the input
_LOWS = (0.05, 0.15, 0.3)  # of the upper level, where the motor turns one way only
_BANDS = (0.5, 1.0, 2.0, 4.0)  # highest frequency of a multisine, over the motor's corner frequency 1/τ
# Levels of a staircase as parts of the largest: large changes first, no two neighbours alike.
_STAIRS = (1.0, -1.0, 0.5, -0.5, 1.0, 0.2, -0.9, 0.7, -0.3, 0.9, -1.0, 0.97)


class Shape(Protocol):
    """A signal but for its size: `top` is its largest voltage [V]."""

    def __call__(self, top: float) -> Signal:
        """Return the signal."""
        ...


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A family, and a shape in it."""

    family: str
    shape: Shape


def candidates(motor: AssumedMotor, duration: float, sample_time: float) -> Iterator[Candidate]:
    """Yield what there is to choose from for a motor, a duration [s] and a sample time [s]."""
    numbers = sorted({_prime(dwell * motor.time_constant / sample_time) for dwell in _DWELLS})
    dwells = [_duration_of(number, sample_time) for number in numbers]
    for dwell in (dwell for dwell in dwells if 4 * dwell <= duration):
        order = min(max(math.ceil(math.log2(duration / dwell + 1)), 4), 12)
        for seed in (1, 2 ** (order - 1) + 1):
            yield Candidate(family="PRBS, both ways", shape=partial(_prbs, -1.0, dwell, order, seed, motor))
            for low in _LOWS:
                yield Candidate(family="PRBS, one way", shape=partial(_prbs, low, dwell, order, seed, motor))
        yield Candidate(family="square, both ways", shape=partial(_square, -1.0, dwell, 0.0, motor))
        yield Candidate(family="square, both ways", shape=partial(_square, -1.0, dwell, 0.25, motor))
        for low in _LOWS:
            yield Candidate(family="square, one way", shape=partial(_square, low, dwell, 0.0, motor))
        yield Candidate(family="square and PRBS", shape=partial(_both, dwell, order))
    for dwell in (duration / len(_STAIRS), duration / (2 * len(_STAIRS))):
        steps = _duration_of(max(round(dwell / sample_time), 1), sample_time)
        yield Candidate(family="staircase, both ways", shape=partial(_stairs, False, steps, motor))
        yield Candidate(family="staircase, one way", shape=partial(_stairs, True, steps, motor))
    yield from _multisines(motor, duration, sample_time)


def _multisines(motor: AssumedMotor, duration: float, sample_time: float) -> Iterator[Candidate]:
    spacing = 1 / duration
    for band in _BANDS:
        highest = min(band / (2 * math.pi * motor.time_constant), 0.2 / sample_time)
        if highest <= 3 * spacing:
            continue
        for random in (False, True):
            yield Candidate(
                family="multisine, both ways",
                shape=partial(_multisine, -1.0, spacing, highest, random, motor),
            )
            yield Candidate(
                family="multisine, one way", shape=partial(_multisine, 0.05, spacing, highest, random, motor)
            )


def _duration_of(samples: int, sample_time: float) -> float:
    """The duration of so many samples [s], as one would write it: 1009 samples of 2 ms are 2.018 s, not 2.0180000000000002 s."""
    return float(f"{samples * sample_time:.15g}")


def _prime(samples: float) -> int:
    """The prime number next to a number of samples: rounding then doesn't meet the same counts at each change."""
    number = max(round(samples), 2)
    while any(number % divisor == 0 for divisor in range(2, math.isqrt(number) + 1)):
        number += 1
    return number


def _low(part: float, top: float, motor: AssumedMotor) -> float:
    """The lower level [V]: a part of the upper one, but so that friction doesn't stop a motor that is to go on."""
    if part < 0:
        return part * top
    least = 2 * motor.coulomb_voltage + motor.offset_voltage + motor.dead_band
    return round(min(max(part * top, least), 0.7 * top), 4)


def _prbs(low: float, dwell: float, order: int, seed: int, motor: AssumedMotor, top: float) -> Signal:
    return PRBS(low=_low(low, top, motor), high=top, bit_time=dwell, order=order, seed=seed)


def _square(low: float, dwell: float, phase: float, motor: AssumedMotor, top: float) -> Signal:
    return Square(low=_low(low, top, motor), high=top, frequency=0.5 / dwell, phase=2 * math.pi * phase)


def _both(dwell: float, order: int, top: float) -> Signal:
    slow = Square(low=-0.5 * top, high=0.5 * top, frequency=0.5 / (7 * dwell))
    return Sum(parts=(slow, PRBS(low=-0.5 * top, high=0.5 * top, bit_time=dwell, order=order)))


def _stairs(one_way: bool, dwell: float, motor: AssumedMotor, top: float) -> Signal:
    least = _low(0.05, top, motor) / top
    parts = [least + (1 - least) * 0.5 * (part + 1) if one_way else part for part in _STAIRS]
    return Staircase(levels=tuple(round(part * top, 4) for part in parts), dwell=dwell)


def _multisine(
    low: float, spacing: float, highest: float, random: bool, motor: AssumedMotor, top: float
) -> Signal:
    least = _low(low, top, motor)
    return Multisine(
        amplitude=0.5 * (top - least),
        offset=0.5 * (top + least),
        frequency=spacing,
        highest=highest,
        phases="random" if random else "schroeder",
    )
