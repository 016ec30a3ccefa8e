"""The effect of noise and lag on a time constant read off a speed at 63.2 %, and the best cut-off.

What is averaged over, and why nothing is drawn at random, is explained in docs/decisions/0025-filters.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import NotIdentifiable, UsageError
from servobench.core.numbers import check_positive
from servobench.identification.estimators.step_63 import time_to_63
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.derivative import Derivative
from servobench.recordings.measurement.lowpass import Discretisation, Lowpass
from servobench.systems.filters.base import SpeedEstimate
from servobench.systems.filters.edges import edge_speed

_REST, _SPAN = 4.0, 20.0  # time constants before and after the step
_TAIL = 0.2  # of the time after the step: its end, over which the steady speed is averaged
_PLACES = 64  # of the shaft within a count
_SPEEDS = 8
_AS_GOOD = 1.1  # times the smallest error
_NO_RINGING = {
    "euler": 1.0,
    "zoh": 2.0,
    "tustin": 2.0,
}  # ω T; ZOH never rings, but above has no filter left to speak of


@dataclass(frozen=True, kw_only=True)
class Rise:
    """A first-order motor that a step of voltage brings from rest to `speed` [rad/s], with the time constant [s].

    ω(t) = ω∞ (1 - e^{-t/τ}). Raises `UsageError` unless both are above zero.
    """

    speed: float
    time_constant: float

    def __post_init__(self) -> None:
        check_positive("the steady speed", self.speed, "rad/s")
        check_positive("the time constant", self.time_constant, "s")

    def position(self, t: Array) -> Array:
        """Return the angle [rad] at times t [s] since the step, of any shape."""
        since = np.maximum(t, 0.0)
        return np.asarray(self.speed * (since + self.time_constant * np.expm1(-since / self.time_constant)))

    def times(self, sample_time: float) -> Array:
        """Return sample times (N,) [s], one of them that of the step, 0: from rest until it has long settled.

        Raises `UsageError` for a sample time that isn't positive and finite.
        """
        check_positive("the sample time", sample_time, "s")
        before, after = (math.ceil(part * self.time_constant / sample_time) for part in (_REST, _SPAN))
        return sample_time * np.arange(-before, after + 1, dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class ReadingError:
    """The error of a reading of a time constant [s]: the mean, `bias`, and the `sd` over start positions."""

    bias: float
    sd: float

    @property
    def rms(self) -> float:
        """√(bias² + sd²) [s]."""
        return math.hypot(self.bias, self.sd)


@dataclass(frozen=True, kw_only=True)
class BestCutoff:
    """The `cutoff` [rad/s] with the smallest `error` of a reading, and the range `low` to `high` with a tenth more at most."""

    cutoff: float
    error: ReadingError
    low: float
    high: float


def nearby(rise: Rise, sample_time: float, quantum: float, count: int = _SPEEDS) -> tuple[Rise, ...]:
    """Return rises whose speeds at 63.2 % are spread over one count a sample, about that of the given one.

    Where the level of a reading lies between two numbers of counts moves a noisy reading to and fro. Who names a speed of
    20 rad/s doesn't mean it to a hundredth of that: `pool_errors` over these the error is what is to be expected.
    `sample_time` is in s, `quantum` in rad. Raises `UsageError` for a speed that is too slow to be spread like that.
    """
    check_positive("the sample time", sample_time, "s")
    check_positive("the encoder's step", quantum, "rad")
    width = quantum / sample_time / (1.0 - math.exp(-1.0))
    offsets = width * ((np.arange(count) + 0.5) / count - 0.5)
    if rise.speed <= -offsets[0]:
        raise UsageError(
            f"a speed of {rise.speed:g} rad/s is less than a count a sample, so speeds near it can't be spread over "
            f"one count: expected more than {-offsets[0]:.3g} rad/s; use a larger step, or longer samples"
        )
    return tuple(Rise(speed=rise.speed + offset, time_constant=rise.time_constant) for offset in offsets)


def pool_errors(errors: Sequence[ReadingError]) -> ReadingError:
    """Return mean and standard deviation of the errors of several equally likely cases, the scatter of their means included."""
    biases = np.array([error.bias for error in errors])
    within = float(np.mean([error.sd**2 for error in errors]))
    return ReadingError(bias=float(biases.mean()), sd=math.sqrt(within + float(biases.var())))


def reading_error(
    estimate: SpeedEstimate, rise: Rise, sample_time: float, quantum: float, places: int = _PLACES
) -> ReadingError:
    """Return the error of τ read at 63.2 % off a speed estimate, as `step_63` reads it, behind an ideal encoder.

    `quantum` is the encoder's step [rad]. Where in a count the shaft stood before the step is all that can differ between
    two runs of the same motor; the mean goes over `places` positions, spread evenly. The voltage changes at a sample.
    Raises `NotIdentifiable` where a speed never passes 63.2 %, `UsageError` for a sample time, a step or a number of places that
    isn't above zero.
    """
    t = rise.times(sample_time)
    start = _starts(quantum, places)
    counts = np.floor(rise.position(t)[:, None] / quantum + start)
    return _error(estimate(quantum * counts, t), t, rise)


def edge_reading_error(
    rise: Rise, sample_time: float, quantum: float, counts: int = 4, places: int = _PLACES
) -> ReadingError:
    """Return the error of τ read at 63.2 % off a tachometer that measures the time of `counts` counts.

    `sample_time` is in s, `quantum` in rad, `places` and what is raised as for `reading_error`.
    """
    t = rise.times(sample_time)
    fine = np.linspace(
        0.0, t[-1], 20 * len(t)
    )  # straight lines between are off by ω'' h²/8: less than 1e-5 of the way
    starts = quantum * _starts(quantum, places)
    speeds = [edge_speed(fine, rise.position(fine) + start, t, quantum, counts) for start in starts]
    return _error(np.stack(speeds, axis=1), t, rise)


def best_cutoff(
    rise: Rise,
    sample_time: float,
    quantum: float,
    cutoffs: Sequence[float] | None = None,
    discretisation: Discretisation = "tustin",
) -> BestCutoff:
    """Return which cut-off of `derivative | lowpass` makes the smallest rms error of a reading that its lag isn't taken off.

    A low cut-off reads the filter's own lag, a high one the encoder's steps. `cutoffs` are those tried [rad/s], by default 40
    from 1/τ to where the filter's pole reaches zero, above which it rings: 1/T by forward Euler, 2/T by Tustin. The error is
    `pool_errors` over speeds `nearby`. Raises what `reading_error` and `nearby` raise, and `UsageError` where there is none.
    """
    check_positive("the sample time", sample_time, "s")
    if cutoffs is None:
        highest = _NO_RINGING[discretisation] / sample_time
        cutoffs = np.geomspace(1.0 / rise.time_constant, highest, 40).tolist()
    if not len(cutoffs):
        raise UsageError(
            "best cut-off: there is none to try; expected cut-offs above 0, or None for the usual ones"
        )
    chains = [filtered_derivative(cutoff, discretisation) for cutoff in cutoffs]
    rises = nearby(rise, sample_time, quantum)
    errors = [
        pool_errors([reading_error(chain, each, sample_time, quantum, 16) for each in rises])
        for chain in chains
    ]
    sizes = np.array([error.rms for error in errors])
    best = int(np.argmin(sizes))
    good = [cutoff for cutoff, size in zip(cutoffs, sizes, strict=True) if size <= _AS_GOOD * sizes[best]]
    return BestCutoff(cutoff=float(cutoffs[best]), error=errors[best], low=min(good), high=max(good))


def filtered_derivative(cutoff: float, discretisation: Discretisation = "tustin") -> Chain:
    """Return the chain `derivative | lowpass` with a cut-off [rad/s]."""
    return Chain((Derivative(), Lowpass(cutoff=cutoff, discretisation=discretisation)))


def _starts(quantum: float, places: int) -> Array:
    """The shaft's start positions as parts of a count (P,), spread evenly."""
    check_positive("the encoder's step", quantum, "rad")
    if places < 1:
        raise UsageError(f"the shaft is to stand at {places} places within a count; expected 1 or more")
    return np.asarray((np.arange(places) + 0.5) / places, dtype=np.float64)


def _error(speeds: Array, t: Array, rise: Rise) -> ReadingError:
    """Mean and standard deviation of the errors of what is read off speeds (N, P)."""
    after = t >= 0
    steady = speeds[t >= (1 - _TAIL) * t[-1]].mean(axis=0)
    if not (steady > 0).all():
        raise NotIdentifiable(
            f"a speed of {rise.speed:g} rad/s moves the shaft by less than a count in {_TAIL * t[-1]:g} s, so "
            "nothing can be read; use a larger step"
        )
    read = np.array([time_to_63(t[after], part) for part in (speeds[after] / steady).T])
    if not np.isfinite(read).all():
        raise NotIdentifiable(
            f"a speed of {rise.speed:g} rad/s never passes 63.2 % behind this filter within {t[-1]:g} s; use a "
            "higher cut-off"
        )
    return ReadingError(bias=float(read.mean()) - rise.time_constant, sd=float(read.std()))
