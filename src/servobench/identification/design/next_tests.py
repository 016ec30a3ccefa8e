"""The choice of the next test of a mechanism, to know kA = τ/K better: each test adds its information to that of the data.

With P the present covariance and P' that of a test alone, the covariance from both is (P⁻¹ + P'⁻¹)⁻¹ if their errors are
independent, and kA's variance follows to first order. P' only contains the noise of an encoder, so it ranks the tests and
doesn't predict their intervals. The design of experiments by the information they give is that of Goodwin and Payne (1977).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.rounding import TWO_SIDED
from servobench.identification.design.assumed_motor import AssumedMotor
from servobench.identification.models.base import STRUCTURES

_KEPT = 3
_OUTSET = 10.0
_LEVELS = (1.0, 0.6)  # of the largest voltage that the motor has seen
_LENGTHS = (2.0, 5.0)  # time constants
_LONGEST = 20.0  # s; a robot has walls
_SHORTEST = 20  # samples


@dataclass(frozen=True, kw_only=True)
class NextTest:
    """A test from rest, and what it would tell."""

    sentence: str
    """The test in words."""
    half: float
    """Half of kA's 95 % interval after it, as a part of kA, if the encoder's noise were all that limits it."""


def best_next_tests(
    motor: AssumedMotor, names: Sequence[str], covariance: Array, largest: float, sample_time: float
) -> tuple[NextTest, ...]:
    """Return the three kinds of tests that would sharpen kA most, the best first; none that would leave it as it is.

    `covariance` (P, P) is what is known of the parameters `names`, `largest` [V] the voltage not to exceed, `sample_time` [s]
    that of the robot's log.
    """
    known = _information(covariance)
    now = _half(motor, names, known, largest)
    best: dict[str, NextTest] = {}
    for kind, sentence, u in _candidates(motor, largest, sample_time):
        half = _half(motor, names, known + _of_the_test(motor, names, u, sample_time), largest)
        if half < 0.9 * now and (kind not in best or half < best[kind].half):
            best[kind] = NextTest(sentence=sentence, half=half)
    return tuple(sorted(best.values(), key=lambda each: each.half)[:_KEPT])


def _candidates(motor: AssumedMotor, largest: float, sample_time: float) -> Iterator[tuple[str, str, Array]]:
    """The kind of a test, what it does, and its voltages (N,) [V]."""
    tau = motor.time_constant
    for level in (round(part * largest, 1) for part in _LEVELS):
        for length in _LENGTHS:
            time = min(max(length * tau, _SHORTEST * sample_time), _LONGEST)
            count = max(round(time / sample_time), _SHORTEST)
            on = np.full(count, level)
            yield (
                "dynamic",
                f"dynamic, both ways: {level:g} V from rest for {time:.2g} s",
                np.concatenate([on, -on]),
            )
            off = np.zeros(count)
            yield (
                "coast",
                f"coasting: {level:g} V for {time:.2g} s, then 0 V as long",
                np.concatenate([on, off]),
            )
            yield (
                "reverse",
                f"reversal: {level:g} V for {time:.2g} s, then {-level:g} V as long, twice",
                np.concatenate([on, -on, on, -on]),
            )
        rate = level / min(max(10 * tau, 2.0), _LONGEST)
        ramp = np.minimum(rate * sample_time * np.arange(round(level / rate / sample_time)), level)
        yield (
            "quasistatic",
            f"quasistatic, both ways: up to {level:g} V at {rate:.2g} V/s",
            np.concatenate([ramp, -ramp]),
        )


def _of_the_test(motor: AssumedMotor, names: Sequence[str], u: Array, sample_time: float) -> Array:
    """The information (P, P) of a test about the parameters `names`; it starts at rest at an unknown position."""
    structure = STRUCTURES["first_order_coulomb"]
    t = sample_time * np.arange(len(u), dtype=np.float64)
    jacobian = structure.predict(motor.theta(structure), motor.dataset(t, u)).jacobian / motor.noise
    own = [parameter.name for parameter in structure.parameters]
    start = jacobian[:, [len(own)]]
    j = jacobian[:, : len(own)]
    j = j - start @ np.linalg.lstsq(start, j, rcond=None)[0]
    information = j.T @ j
    information_by_name = np.zeros((len(names), len(names)))
    for a, first in enumerate(names):
        for b, second in enumerate(names):
            if first in own and second in own:
                information_by_name[a, b] = information[own.index(first), own.index(second)]
    return information_by_name


def _information(covariance: Array) -> Array:
    """The inverse of a covariance, in which what isn't known has no information."""
    inverse = np.zeros_like(covariance)
    known = np.flatnonzero(np.isfinite(np.diag(covariance)) & (np.diag(covariance) > 0))
    part = covariance[np.ix_(known, known)]
    scale = np.sqrt(np.diag(part))
    inverse[np.ix_(known, known)] = np.linalg.pinv(part / np.outer(scale, scale), hermitian=True) / np.outer(
        scale, scale
    )
    return inverse


def _half(motor: AssumedMotor, names: Sequence[str], information: Array, largest: float) -> float:
    """Half of kA's 95 % interval, as a part of it, where each parameter is known within ten times its size from the outset."""
    sizes = {"gain": motor.gain, "time_constant": motor.time_constant, "delay": motor.time_constant}
    size = np.array([abs(sizes.get(name, largest)) for name in names])
    slope = np.array([{"gain": -1.0, "time_constant": 1.0}.get(name, 0.0) for name in names])
    relative = information * np.outer(size, size) + np.eye(len(names)) / _OUTSET**2
    return TWO_SIDED * math.sqrt(float(slope @ np.linalg.solve(relative, slope)))
