"""Causes of a bad fit: each is found in a record with this fault, and in no sound one of the same signal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.signal import lfilter

from servobench.core.channels import Array
from servobench.core.finding import Finding
from servobench.identification.trust.explanations.base import explain
from servobench.identification.trust.explanations.hysteresis import play
from servobench.recordings.measurement.dataset import Dataset
from tests.contracts.finding_examples.base import (
    TIME,
    Example,
    driven,
    sines,
    sound,
    staircase,
    told,
)
from tests.datasets import QUANTUM, dataset
from tests.identification.trust.test_explanations import two_masses
from tests.identification.trust.test_missing_terms import odd


def _drifting() -> Dataset:
    """The output's clock goes 1 % too fast."""
    return replace(sound(), t_output=1.01 * sound().t_output)


def _dead_zone() -> Dataset:
    """Less than 0.5 V doesn't act, and the rest acts by so much less."""
    return told(sines(), sines() - np.clip(sines(), -0.5, 0.5))


def _early() -> Dataset:
    """Each value of the output stands 100 ms too early."""
    return replace(sound(), y=np.append(sound().y[50:], np.full(50, sound().y[-1])))


def _clipped() -> Dataset:
    """The amplifier puts out at most 1.5 V of the 3 V."""
    return told(staircase(), np.clip(staircase(), -1.5, 1.5))


def _hysteresis() -> Dataset:
    """0.5 V of play to either side before the motor."""
    return told(sines(), play(sines(), 0.5))


def _of_another_motor() -> Dataset:
    return replace(sound(), u=sound(seed=4).u)


def _both_ways() -> Array:
    """Voltages (5000,) of either sign, 0.5 s each."""
    return np.repeat(np.random.default_rng(7).uniform(-3.0, 3.0, 20), 250)


def _weak_half() -> Dataset:
    """An amplifier whose negative half gives a tenth less."""
    return told(_both_ways(), np.where(_both_ways() < 0.0, 0.9 * _both_ways(), _both_ways()))


def _wrong_label() -> Dataset:
    """A level labelled 3 V that is 2.2 V."""
    return told(staircase(), np.where(staircase() == 3.0, 2.2, staircase()))


def _sagging() -> Dataset:
    """The supply loses 40 % from the beginning to the end."""
    return told(sound().u, sound().u * (1 - 0.4 * TIME / TIME[-1]))


def _turned() -> Dataset:
    """The input's sign changes in the middle."""
    return told(np.where(TIME < 5.0, sound().u, -sound().u), sound().u)


def _other_supply() -> Dataset:
    """The file says 0.8 times the voltage that was applied."""
    return replace(sound(seed=4), u=0.8 * sound(seed=4).u)


def _lagging() -> Dataset:
    """A second pole, of 50 ms, before the motor."""
    u = dataset(seed=3, kind="prbs", hold=100).u
    kept = np.exp(-0.002 / 0.05)
    return told(u, lfilter([0.0, 1.0 - kept], [1.0, -kept], u))


def _driven_in_steps(slower: float) -> Dataset:
    """A motor at random levels of one sign, 0.5 s each, that slows down so many times as slowly as it speeds up (0.1 s)."""
    u = np.repeat(np.random.default_rng(2).uniform(0.5, 3.0, 20), 250)
    speed, turned = np.zeros(5000), np.zeros(5000)
    for n in range(1, 5000):
        wanted = 24.0 * u[n - 1]
        tau = 0.1 if wanted > speed[n - 1] else 0.1 * slower
        decay = np.exp(-0.002 / tau)
        speed[n] = wanted + (speed[n - 1] - wanted) * decay
        turned[n] = turned[n - 1] + wanted * 0.002 - tau * (speed[n] - speed[n - 1])
    return replace(driven(u), y=(np.floor(turned / QUANTUM) + 0.5) * QUANTUM)


def _example(code: str, faulty: Callable[[], Dataset], like: Callable[[], Dataset]) -> Example:
    def of(made: Callable[[], Dataset]) -> list[Finding]:
        return explain([made()])

    return Example(code=code, raised=partial(of, faulty), absent=partial(of, like))


EXAMPLES = (
    _example("clock-drift", _drifting, sound),
    _example("coasts", lambda: _driven_in_steps(2.5), lambda: _driven_in_steps(1.0)),
    _example("dead-zone", _dead_zone, lambda: driven(sines())),
    _example("delay-negative", _early, sound),
    _example("directions-differ", _weak_half, lambda: driven(_both_ways())),
    _example("gain-falls", _clipped, lambda: driven(staircase())),
    _example("hysteresis", _hysteresis, lambda: driven(sines())),
    _example("input-unrelated", _of_another_motor, sound),
    _example(
        "input-unsigned", lambda: told(np.abs(_both_ways()), _both_ways()), lambda: driven(_both_ways())
    ),
    _example("level-disagrees", _wrong_label, lambda: driven(staircase())),
    _example("motor-changes", _sagging, sound),
    _example("drag-not-linear", lambda: odd(1, "prbs", drag=1e-4), lambda: odd(1, "prbs")),
    _example("response-oscillates", lambda: two_masses(12.0, 0), sound),
    _example("second-pole", _lagging, lambda: dataset(seed=3, kind="prbs", hold=100)),
    _example("sign-flips", _turned, sound),
    Example(
        code="records-disagree",
        raised=lambda: explain([sound(), _other_supply()]),
        absent=lambda: explain([sound(), sound(seed=4)]),
    ),
)
