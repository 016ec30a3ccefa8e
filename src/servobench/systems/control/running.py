"""The parts of a running law: its compiled step, its numbers, its state, and how it reads the shaft through the counter.

The speed is that of the measurement chain `derivative | lowpass`: the difference of the counts over the time between their two
latches, through ω/(s + ω) by the trapezoid rule. `kernels` has the laws. Why it is so is told in
docs/decisions/0019-control.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from servobench.core.channels import Array, DeviceInfo, Sample
from servobench.core.errors import UsageError
from servobench.core.settings import In, InBy, Time

Output: TypeAlias = Literal["position", "speed"]
UNITS: dict[str, str] = {"position": "rad", "speed": "rad/s"}
"""The unit of what is followed."""
FadeTime: TypeAlias = Annotated[Time, Field(ge=0, le=1e9)]
Cutoff: TypeAlias = Annotated[float, In("rad/s"), Field(gt=0)]
_LARGEST_BITS = 53  # a float holds whole numbers up to 2^53, and so does the travel

Law: TypeAlias = Callable[[Array, Array, float, int, float], tuple[Array, float]]
"""(state, numbers, reference, counts, time [s]) -> (next state, voltage [V])."""


class Running(NamedTuple):
    """The state of a compiled law: the law itself, its numbers p (fixed) and its state x (never changed in place).

    A loop that is compiled as a whole calls `law` itself: x, u = law(x, p, reference, counts, time).
    """

    law: Law
    p: Array
    x: Array


def advance(state: Running, reference: float, sample: Sample) -> tuple[Running, float]:
    """Return the next state and the voltage [V] of a compiled law."""
    law, p, x = state
    # Of one type always: another one would be compiled for, in the middle of a run.
    x, voltage = law(x, p, float(reference), sample.counts, sample.time)
    return Running(law, p, x), voltage


class Shaft(NamedTuple):
    """A device as a law sees it: `scale` [rad] of a count, and the voltage's limits.

    `modulus` is the counter's range [counts], 0 where it doesn't wrap; `lowest` and `highest` are the limits [V].
    """

    scale: float
    modulus: float
    lowest: float
    highest: float


def shaft_of(info: DeviceInfo, law: str) -> Shaft:
    """Return what a device says of its encoder and of its voltage; `law` is the name that messages give who needs it.

    Raises `UsageError` where it has no encoder, or doesn't say how many counts a turn has.
    """
    counts, voltage = info.channel("counts"), info.channel("voltage")
    if counts is None or not counts.counts_per_rev:
        lacks = "has no encoder" if counts is None else "doesn't give its encoder's counts per turn"
        raise UsageError(
            f"the controller {law!r} needs the shaft's angle, and the device {info.name!r} {lacks}; give "
            'counts_per_rev in its settings, or use type = "open_loop"'
        )
    bits = counts.counter_bits
    if bits is not None and bits > _LARGEST_BITS:
        raise UsageError(
            f"the device {info.name!r} reports a counter of {bits} bits; expected at most {_LARGEST_BITS}"
        )
    low, high = (None, None) if voltage is None else (voltage.minimum, voltage.maximum)
    return Shaft(
        scale=2 * math.pi / counts.counts_per_rev,
        modulus=0.0 if bits is None else 2.0**bits,
        lowest=-math.inf if low is None else low,
        highest=math.inf if high is None else high,
    )


def gain_unit(position: str, speed: str) -> InBy:
    """Mark a gain whose unit hangs on what is followed; a field `output` stands before it."""
    return InBy("output", (("position", position), ("speed", speed)))


Finite: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
Proportional: TypeAlias = Annotated[Finite, gain_unit("V/rad", "V·s/rad")]
Integral: TypeAlias = Annotated[Finite, gain_unit("V/(rad·s)", "V/rad")]
Derivative: TypeAlias = Annotated[Finite, gain_unit("V·s/rad", "V·s²/rad")]


def begin_law(law: Law, p: Array, x: Array) -> Running:
    """Return a running law of numbers p (P,) and states x (X,), compiled: it has stepped once, and forgotten it."""
    law(x, p, 0.0, 0, 0.0)
    return Running(law, np.ascontiguousarray(p), x)


def take_over(
    state: Running, reference: float, sample: Sample, voltage: float, *, integral: bool, fade_time: float
) -> Running:
    """Return a running law from which that sample gives that voltage [V].

    What it would give by itself is made up by its integral, where it has one, permanently; otherwise by a bias that fades with
    `fade_time` [s], or by nothing where that is 0.
    """
    from servobench.systems.control.kernels import BIAS, INTEGRAL, SEEN, TAKEN_OVER

    x = state.x.copy()
    x[SEEN] = TAKEN_OVER
    _, alone = state.law(x, state.p, reference, sample.counts, sample.time)
    if integral or fade_time > 0:
        x[INTEGRAL if integral else BIAS] = voltage - alone
    return Running(state.law, state.p, x)


def prepare() -> None:
    """Compile all laws, or load them compiled: after that a switch while a motor turns waits for none."""
    from servobench.systems.control import kernels

    for law in (kernels.pid, kernels.lead, kernels.state_feedback):
        begin_law(law, np.ones(kernels.GAINS + 4), np.zeros(kernels.OWN + 5))
