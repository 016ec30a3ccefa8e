"""The motor's motion and its recording."""

from dataclasses import dataclass

import numpy as np

from population_parts import kernels
from population_parts.inputs import Array
from population_parts.motors import Case, Motor

KICKS = 4
"""The number of changes of the random torque in a sample time; it holds in between."""

_MARCH = 1000  # short steps in a time constant, at least; a winding's is a twentieth of it
_FINE = 16  # places between two samples at which the play of a gear is followed


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Speed [rad/s] and angle [rad] of the shaft at the rows (N,), what acted before the first, and the times of latching."""

    speed: Array
    angle: Array
    before: float


def rows(case: Case) -> tuple[Array, Array]:
    """Return the record's times and inputs (N,)."""
    return case.t[case.first :], case.u[case.first :]


def latched(case: Case) -> Array:
    """Return when each of `case.t` (L,) really was: off by chance where the loop's timing is, and nobody wrote that down."""
    jitter = case.motor.departure.jitter
    if not jitter:
        return case.t
    random = np.random.default_rng((*case.seed, 2))
    return case.t + jitter * case.motor.sample_time * np.clip(random.standard_normal(len(case.t)), -3.0, 3.0)


def moved(case: Case) -> Motion:
    """Return the motion from rest, with the random torque of the case."""
    motor, t = case.motor, latched(case)
    times, volts = acting(motor, t, case.u)
    if motor.torque:
        times, volts = _with_torque(case, times, volts)
    if not motor.departure.play:
        speed, angle = _run(motor, times, volts, t, (0.0, case.angle)).T
        return Motion(speed=speed[case.first :], angle=angle[case.first :], before=_before(case))
    fine = np.interp(np.arange(_FINE * (len(t) - 1) + 1) / _FINE, np.arange(len(t)), t)
    speed, angle = _run(motor, times, volts, fine, (0.0, case.angle)).T
    seen = played(angle, motor.departure.play)[::_FINE]
    return Motion(speed=speed[::_FINE][case.first :], angle=seen[case.first :], before=_before(case))


def acting(motor: Motor, t: Array, u: Array) -> tuple[Array, Array]:
    """Return when the voltage that acts changes, and to what."""
    lost = motor.departure.dead_band * motor.departure.amplitude
    return t + motor.delay, np.sign(u) * np.maximum(np.abs(u) - lost, 0.0) if lost else u


def plain(
    motor: Motor, t: Array, u: Array, before: float, start: tuple[float, float], offset: float = 0.0
) -> Array:
    """Return speed and angle (N, 2) of a motor without departures, at the rows, from a start state (ω, θ) at the first.

    `before` is the input before the first row; `offset` [V] is lost of each input.
    """
    out = np.empty((len(t), 2))
    p = (motor.gain, motor.tau, motor.coulomb)
    kernels.turn(p, t + motor.delay, u - offset, before - offset, t, start, out)
    return out


def played(angle: Array, play: float) -> Array:
    """Return the angle behind a gap (N,): it rests until the gap is used up, then follows."""
    low, high = angle - 0.5 * play, angle + 0.5 * play
    out = np.empty(len(angle))
    at = angle[0]
    for k, (least, most) in enumerate(zip(low.tolist(), high.tolist(), strict=True)):
        at = min(max(at, least), most)
        out[k] = at
    return out


def read(case: Case, motion: Motion) -> Array:
    """Return what the record says of its output (N,): counts, rad, or rad/s."""
    motor, random = case.motor, np.random.default_rng((*case.seed, 1))
    noise = motor.noise * random.standard_normal(len(motion.angle))
    off, phase = motor.departure.eccentricity, motor.departure.phase
    if case.output == "speed":
        return motion.speed * (1.0 + off * np.cos(motion.angle + phase)) + noise
    seen = motion.angle + off * np.sin(motion.angle + phase) + noise
    counts = np.floor(seen / motor.quantum)
    if case.output == "counts":
        return counts
    if case.output == "rad":
        return counts * motor.quantum
    return np.diff(counts, prepend=counts[0]) * motor.quantum / motor.sample_time


def _before(case: Case) -> float:
    """The input before the record's first row."""
    return float(case.u[case.first - 1]) if case.first else 0.0


def _run(motor: Motor, times: Array, volts: Array, t: Array, start: tuple[float, float]) -> Array:
    """Speed and angle (M, 2) at times t (M,), from rest without an input before."""
    out, d = np.empty((len(t), 2)), motor.departure
    if not d.is_marched:
        kernels.turn((motor.gain, motor.tau, motor.coulomb), times, volts, 0.0, t, start, out)
        return out
    return _marched(motor, times, volts, 0.0, t, start)


def marched(motor: Motor, t: Array, u: Array, before: float, start: tuple[float, float]) -> Array:
    """Return speed and angle (N, 2) of a motor with departures, at the rows, from a start state (ω, θ) at the first."""
    return _marched(motor, t + motor.delay, u, before, t, start)


def _marched(
    motor: Motor, times: Array, volts: Array, before: float, t: Array, start: tuple[float, float]
) -> Array:
    out, d = np.empty((len(t), 2)), motor.departure
    q = (motor.gain, motor.tau, motor.coulomb, d.stribeck, d.slow, d.cogging * d.amplitude, float(d.teeth), d.phase,
         d.winding * motor.tau, d.sag, d.amplitude, d.warming, t[-1] - t[0])  # fmt: skip
    kernels.march(q, times, volts, before, t, start, motor.tau / _MARCH, out)
    return out


def _with_torque(case: Case, times: Array, volts: Array) -> tuple[Array, Array]:
    """The changes of the voltage with a random torque in it, white to `KICKS` times the rate of samples."""
    motor, random = case.motor, np.random.default_rng((*case.seed, 3))
    step = motor.sample_time / KICKS
    own = case.t[0] + step * np.arange(KICKS * len(case.t))
    kicks = np.sqrt(motor.torque / step) * random.standard_normal(len(own))
    both = np.union1d(times, own)
    held = np.searchsorted(times, both, side="right") - 1
    pushed = np.searchsorted(own, both, side="right") - 1
    driven = np.where(held >= 0, volts[np.maximum(held, 0)], 0.0)
    return both, driven + np.where(pushed >= 0, kicks[np.maximum(pushed, 0)], 0.0)
