"""When the output of a record first responds to its input.

The output can't respond before its cause. If a record begins at rest or in steady motion, the first sample that deviates comes
at least a delay after the first change of the input, whatever the model. So

    delay <= t(first motion) - t(first change of the input) + one sample time

where the sample time allows for columns that were latched one after the other. A ramp from rest changes at the first sample,
but the shaft moves much later, when the ramp has overcome friction: then the bound is too wide to be useful. If it is stated
that the shaft rested before its first sample, an input that is on from there is a change, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.measurement.base import Kind

_NOISE = 6.0  # standard deviations: beyond that it is motion, and once in 10^9 samples chance
SUSTAINED = 3  # samples beyond it in a row: a single one may be damaged
_CLEAR = 10.0  # of the noise that the shaft must have gone by at its top speed while it is taken to rest
_ROUGH = 1.4826 / np.sqrt(
    6.0
)  # from the median of |second differences| to the standard deviation of white noise


class Record(Protocol):
    """The part of a `Dataset` from which its first motion is found."""

    @property
    def t_input(self) -> Array:
        """Times of the input (N,) [s]."""
        ...

    @property
    def u(self) -> Array:
        """The input (N,)."""
        ...

    @property
    def t_output(self) -> Array:
        """Times of the output (M,) [s]."""
        ...

    @property
    def y(self) -> Array:
        """The output (M,)."""
        ...

    @property
    def kind(self) -> Kind:
        """Whether the output is a position or a speed."""
        ...

    @property
    def quantum(self) -> float | None:
        """The smallest step of the output where it is known."""
        ...

    @property
    def input_before(self) -> float:
        """The input before its first sample."""
        ...

    @property
    def starts_at_rest(self) -> bool:
        """Whether it is stated that the shaft rests at the first sample."""
        ...


@dataclass(frozen=True, kw_only=True)
class FirstMotion:
    """A record's first motion: the input first changes at `cause` [s], the output first leaves its course by `effect` [s].

    `samples` of the output come before the cause, and all stay within `within` (the output's unit) of each other.
    """

    cause: float
    effect: float
    samples: int
    within: float


def first_motion(data: Record) -> FirstMotion | None:
    """Return how a record begins; None where its input changes at once, or its output doesn't stand until then.

    A shaft that is stated to rest at the first sample needn't be seen to stand.
    """
    cause = _first_change(data)
    if cause is None:
        return None
    at_rest = data.starts_at_rest and cause <= data.t_output[0]
    within = noise_of(data)
    samples = 1 if at_rest else _samples_before(data, cause, within)
    if samples < 1:
        return None
    middle = float(np.median(data.y[:samples]))
    if (
        not within > 0
        or np.abs(data.y[:samples] - middle).max() > within
        or (not at_rest and np.ptp(data.y) <= _CLEAR * within)
    ):
        return None
    # As a shaft that is only seen to stand may run on so slowly that it goes unseen, what it would do then is no answer. It
    # would have left its place sooner if it were faster: so the whole standstill counts, beyond the cause as well.
    left = np.flatnonzero(np.abs(data.y - middle) > within)
    stood = max(int(left[0]) if len(left) else len(data.y), samples)
    # A speed of nothing is a standstill in a single sample.
    rests = at_rest or (data.kind == "speed" and abs(middle) <= within)
    lasted = np.inf if rests else float(data.t_output[stood - 1] - data.t_output[0])
    if not lasted > 0:
        return None
    unseen = within * (2.0 + (data.t_output - data.t_output[samples - 1]) / lasted)
    away = np.abs(data.y - middle) > unseen
    away[:samples] = False
    runs = np.convolve(away, np.ones(SUSTAINED), mode="valid") if len(away) >= SUSTAINED else np.zeros(0)
    moved = np.flatnonzero(runs > SUSTAINED - 0.5)
    if not len(moved):
        return None
    return FirstMotion(cause=cause, effect=float(data.t_output[moved[0]]), samples=samples, within=within)


def _samples_before(data: Record, cause: float, within: float) -> int:
    """The outputs up to a cause [s]; that of its own row isn't one of them where a speed has answered to it already."""
    samples = int(np.count_nonzero(data.t_output <= cause))
    is_answer = data.kind == "speed" and samples > 1 and data.t_output[samples - 1] == cause
    return samples - int(is_answer and abs(data.y[samples - 1] - data.y[samples - 2]) > within)


def _first_change(data: Record) -> float | None:
    """The time of the first change of the input [s]; None where it stays what it is."""
    if data.starts_at_rest and data.u[0] != data.input_before:
        return float(data.t_input[0])
    changes = np.flatnonzero(data.u != data.u[0])
    return float(data.t_input[changes[0]]) if len(changes) else None


def noise_of(data: Record) -> float:
    """Return how far apart two samples of an output that stands may lie, in its unit: six deviations of its noise, and a step.

    The noise is that of second differences, in which motion has next to no part; the step that of the encoder, or the smallest
    difference between neighbours.
    """
    step = data.quantum or _smallest(np.abs(np.diff(data.y)))
    rough = _ROUGH * float(np.median(np.abs(np.diff(data.y, 2)))) if len(data.y) > 2 else 0.0
    # Of a slow shaft most second differences are no or one step, which is rounding.
    return 1.001 * step + (_NOISE * rough if rough > step else 0.0)


def _smallest(differences: Array) -> float:
    moved = differences[differences > 0]
    return float(moved.min()) if len(moved) else 0.0
