"""The smallest standard deviations that an unbiased estimator can have (Cramér-Rao), by differences of the exact simulation.

Unknown are gain, time constant, delay, what is lost of the input, and where and how fast the shaft starts. What was the input
before the first row counts as known, and so does a start at rest with friction. Approximate: the rounding of counts is taken as
white noise of variance Q²/12 while the shaft slides, and the random torque for what it does to a shaft that slides all through a
tick. A shaft at rest shows an encoder without noise the same count all the time: that tells where it is once.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from population_parts import kernels
from population_parts.departures import Departure
from population_parts.inputs import Array
from population_parts.motors import Case, Motor
from population_parts.simulator import KICKS, Motion, marched, plain, rows

SHARES = np.array([[1 / 3, 1 / 4], [1 / 4, 1 / 5]])
"""The second moments of λ and λ², the part of a delay that is a lag, all parts from none to the whole being alike probable."""
EXCESS = 0.25 * 0.5**2 / 3
"""The second moment of the excess of friction at rest, as a part of it: none in three motors of four, else up to a half."""

_LAG_STEPS = 16  # in a delay, with which its lag is simulated
_SHORTEST = 0.01  # of a sample time: whether so short a delay is a lag changes nothing
_SMALL_EXCESS = 0.05
_SLOW = 0.05  # of the top speed: where the excess has fallen to 37 %
_WORST = 1e9  # beyond this condition a parameter isn't told from the others
_STILL = 1e-3  # of the top speed: who turned back by less never turned both ways


def turns_both_ways(case: Case, motion: Motion) -> bool:
    """Whether the shaft would turn both ways without a random torque."""
    start = (float(motion.speed[0]), 0.0)
    speed = plain(case.motor, *rows(case), motion.before, start)[:, 0]
    top = float(np.abs(speed).max())
    return bool(speed.min() < -_STILL * top and speed.max() > _STILL * top)


def bound(case: Case, motion: Motion) -> dict[str, float]:
    """Return the bounds on the sd of each parameter: relative of gain and time constant, of the others in s and V.

    `lag` is time constant plus delay, in s. Infinite for what the record doesn't tell; all are where nothing moves.
    """
    motor = replace(case.motor, torque=0.0)
    names = _unknown(case, motion)
    return _bounds(motor, names, jacobian(case, motor, motion, names))


def cautious(case: Case, motion: Motion) -> dict[str, float]:
    """Return the same for an estimator that can't rule out a little friction, a lag, or more friction near rest.

    The Coulomb voltage is always unknown. A part λ of a delay may be a lag, which adds λ p + λ² q to the output, and friction at
    rest may be larger than at speed; both are nuisances with the priors of decision 0047 (van Trees 1968).
    """
    motor = replace(case.motor, torque=0.0)
    names = _unknown(case, motion)
    names += [] if "coulomb" in names else ["coulomb"]
    columns, moments = [jacobian(case, motor, motion, names)], []
    if motor.delay > _SHORTEST * motor.sample_time:
        columns.append(_weighed(case, motion, _by_lag(case, motor, motion)))
        moments.append(SHARES)
    if motor.coulomb > 0.0:
        columns.append(_weighed(case, motion, _by_excess(case, motor, motion)))
        moments.append(np.array([[EXCESS]]))
    whole = np.hstack(columns)
    prior, at = np.zeros((0, whole.shape[1])), len(names)
    for moment in moments:
        more = np.zeros((len(moment), whole.shape[1]))
        more[:, at : at + len(moment)] = np.linalg.cholesky(np.linalg.inv(moment)).T
        prior, at = np.vstack([prior, more]), at + len(moment)
    nuisances = [f"nuisance {n}" for n in range(whole.shape[1] - len(names))]
    return _bounds(motor, names + nuisances, np.vstack([whole, prior]))


def _bounds(motor: Motor, names: list[str], columns: Array) -> dict[str, float]:
    """The bounds by the information of columns (N, C)."""
    scale = np.linalg.norm(columns, axis=0)
    told = scale > 0
    found = dict.fromkeys(("gain", "time_constant", "delay", "coulomb_voltage", "lag"), np.inf)
    if not told[:2].all():
        return found
    names = [name for name, is_told in zip(names, told, strict=True) if is_told]
    root = _root(columns[:, told] / scale[told]) / scale[told][:, None]
    sd = dict(zip(names, np.linalg.norm(root, axis=1).tolist(), strict=True))
    found["gain"], found["time_constant"] = sd["gain"] / motor.gain, sd["tau"] / motor.tau
    found["delay"] = sd.get("delay", np.inf)
    found["coulomb_voltage"] = sd.get("coulomb", np.inf)
    if "delay" in names:
        found["lag"] = float(np.linalg.norm(root[names.index("tau")] + root[names.index("delay")]))
    return found


def _by_lag(case: Case, motor: Motor, motion: Motion) -> Array:
    """p and q (N, 2): what the output has more, λ p + λ² q, where a part λ of the delay is a lag."""
    t, u = rows(case)
    output, start = _output(case), (float(motion.speed[0]), 0.0)
    step = motor.delay / _LAG_STEPS
    own = t[0] - 40 * motor.delay + step * np.arange(int((t[-1] - t[0]) / step + 40 * _LAG_STEPS))
    driven = np.append(motion.before, u)[np.searchsorted(t, own, side="right")]
    runs = []
    for share in (0.0, 0.5, 1.0):
        decay = np.exp(-1.0 / (share * _LAG_STEPS)) if share else 0.0
        lagged = kernels.lagged(driven, decay, motion.before)
        times = own + (1.0 - share) * motor.delay
        out = np.empty((len(t), 2))
        kernels.turn((motor.gain, motor.tau, motor.coulomb), times, lagged, motion.before, t, start, out)
        runs.append(out[:, output])
    half, whole = runs[1] - runs[0], runs[2] - runs[0]
    return np.ascontiguousarray(np.column_stack([4.0 * half - whole, 2.0 * whole - 4.0 * half]))


def _by_excess(case: Case, motor: Motor, motion: Motion) -> Array:
    """The additional output (N, 1) for friction that is twice as large at rest as at speed, by a difference."""
    t, u = rows(case)
    top = max(float(np.abs(motion.speed).max()), 1e-12)
    runs = []
    for excess in (0.0, _SMALL_EXCESS):
        more = Departure(name="excess", stribeck=excess, slow=_SLOW * top)
        out = marched(replace(motor, departure=more), t, u, motion.before, (float(motion.speed[0]), 0.0))
        runs.append(out[:, _output(case)])
    return np.ascontiguousarray((runs[1] - runs[0])[:, None] / _SMALL_EXCESS)


def _output(case: Case) -> int:
    """The column of a motion that a record holds."""
    return 0 if case.output == "speed" else 1


def _root(columns: Array) -> Array:
    """A root (C, C) of the inverse of the information; infinite rows for what isn't told from other columns."""
    _, s, v = np.linalg.svd(columns, full_matrices=False)
    told = s > s[0] / _WORST
    root = v[told].T / s[told]
    # What has a part in a combination that leaves no trace is known by none of its other parts.
    lost = np.abs(v[~told]).max(axis=0, initial=0.0) > 1e-6
    return np.hstack([np.where(lost[:, None], np.inf, root), np.zeros((len(v), int((~told).sum())))])


def jacobian(case: Case, motor: Motor, motion: Motion, names: list[str]) -> Array:
    """Return the derivatives of what is read (N, C), each row over its standard deviation, innovations where torque is random."""
    t, u = rows(case)
    output = _output(case)
    steps = {
        "gain": 1e-5 * motor.gain,
        "tau": 1e-5 * motor.tau,
        "delay": 1e-3 * motor.sample_time,
        "coulomb": 1e-5 * case.amplitude,
        "offset": 1e-5 * case.amplitude,
        "speed": 1e-5 * motor.gain * case.amplitude,
        "angle": 1.0,
    }

    def response(name: str, change: float) -> Array:
        changed, offset, w, theta = motor, 0.0, float(motion.speed[0]), 0.0
        if name == "offset":
            offset = change
        elif name == "speed":
            w += change
        elif name == "angle":
            theta += change
        else:
            changed = replace(motor, **{name: getattr(motor, name) + change})
        return plain(changed, t, u, motion.before, (w, theta), offset)[:, output]

    columns = []
    for name in names:
        h = steps[name]
        # A delay or a Coulomb voltage below zero has no meaning.
        is_edge = name in ("delay", "coulomb") and getattr(motor, name) < h
        at, weight = ((0.0, h, 2 * h), (-1.5, 2.0, -0.5)) if is_edge else ((-h, 0.0, h), (-0.5, 0.0, 0.5))
        columns.append(sum(w * response(name, x) for w, x in zip(weight, at, strict=True)) / h)
    return _weighed(case, motion, np.ascontiguousarray(np.column_stack(columns)))


def transition(motor: Motor) -> tuple[Array, Array]:
    """Return the transition (2, 2) of (ω, θ) over a sample time and the covariance that the random torque adds to it."""
    step = motor.sample_time / KICKS
    gone = -np.expm1(-step / motor.tau)
    a = np.array([[1.0 - gone, 0.0], [motor.tau * gone, 1.0]])
    b = motor.gain * np.array([gone, step - motor.tau * gone])
    whole, noise = np.eye(2), np.zeros((2, 2))
    for _kick in range(KICKS):
        noise = a @ noise @ a.T + np.outer(b, b) * motor.torque / step
        whole = a @ whole
    return whole, noise


def _unknown(case: Case, motion: Motion) -> list[str]:
    """The unknowns: who sees a motor turn one way only can't tell friction from offset, nor leave friction out."""
    names = ["gain", "tau", "delay"]
    both = turns_both_ways(case, motion)
    if case.motor.coulomb > 0.0 or not both:
        names.append("coulomb")
    if both:
        names.append("offset")
    if case.output != "speed":
        names.append("angle")
    if case.motor.coulomb == 0.0 or motion.speed[0] != 0.0:
        names.append("speed")
    return names


def _weighed(case: Case, motion: Motion, columns: Array) -> Array:
    motor = case.motor
    # A shaft that is at rest at both ends of a tick stayed so.
    sliding = (motion.speed != 0.0) | (np.append(motion.speed[1:], motion.speed[-1]) != 0.0)
    if motor.coulomb == 0.0:
        sliding[:] = True
    variances = _variances(case, sliding)
    if not motor.torque:
        return columns / np.sqrt(variances)[:, None]
    plainly, noise = transition(motor)
    transitions = np.tile(plainly, (len(sliding), 1, 1))
    _turn_back(case, motion, transitions)
    kernels.whiten(transitions, noise, sliding, case.output == "speed", variances, columns)
    return columns


def _turn_back(case: Case, motion: Motion, transitions: Array) -> None:
    """Replace the transitions of ticks in which the shaft stops or turns back by what two shafts do that differ a little."""
    motor, (t, u) = case.motor, rows(case)
    speed = plain(motor, t, u, motion.before, (float(motion.speed[0]), 0.0))[:, 0]
    for n in np.flatnonzero((speed[:-1] != 0.0) & (speed[:-1] * speed[1:] <= 0.0)):
        change, out = 1e-5 * speed[n], np.empty((2, 2, 2))
        for side, each in zip((-0.5, 0.5), out, strict=True):
            start = (speed[n] + side * change, 0.0)
            p = (motor.gain, motor.tau, motor.coulomb)
            kernels.turn(p, t + motor.delay, u, motion.before, t[n : n + 2], start, each)
        transitions[n, :, 0] = (out[1, 1] - out[0, 1]) / change


def _variances(case: Case, sliding: NDArray[np.bool_]) -> Array:
    """The variance of each reading (N,), where those of one rest together are worth one."""
    motor = case.motor
    if case.output == "speed":
        return np.full(len(sliding), motor.noise**2)
    variances = np.full(len(sliding), motor.noise**2 + motor.quantum**2 / 12)
    if motor.noise < 0.5 * motor.quantum:
        edges = np.flatnonzero(np.diff(sliding.astype(np.int8), prepend=2, append=2))
        for first, after in pairwise(edges):
            if not sliding[first]:
                variances[first:after] = motor.noise**2 + (after - first) * motor.quantum**2 / 12
    return variances
