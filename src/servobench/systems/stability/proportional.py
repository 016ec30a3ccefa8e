"""A proportional controller around a motor: whether the loop is stable, and its margins, as it runs at ticks or on paper.

Margins are those of Åström and Murray 2008, chapter 9; `sampled_loop` defines a loop at ticks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from servobench.systems.margins import Margins, delay_margin, margins
from servobench.systems.sampled_loop import proportional, sampled_delay_margin, sampled_loop, sampled_margins
from servobench.systems.stability.gains import stable_gains
from servobench.systems.stability.nyquist import ClosedLoop, closed_loop
from servobench.systems.stability.sampled import closed_sampled_loop, stable_sampled_gains
from servobench.systems.transfer_function import TransferFunction


@dataclass(frozen=True, kw_only=True)
class ProportionalLoop:
    """A loop with a proportional controller, every `sample_time` [s], or continuous where that is None.

    `closed` is what it is once it is closed. A stable loop has `margins` and a `delay_margin` [s]; of another one
    `stable_factors` are the ranges of factors on its gain
    with which it would be stable.
    """

    sample_time: float | None
    closed: ClosedLoop
    margins: Margins | None
    delay_margin: float | None
    stable_factors: tuple[tuple[float, float], ...] | None


def sampled_proportional_loop(system: TransferFunction, gain: float, sample_time: float) -> ProportionalLoop:
    """Return the loop of a gain around a system, as it runs every `sample_time` [s]."""
    loop = sampled_loop(proportional(gain), system, sample_time)
    return _judge(
        sample_time,
        closed_sampled_loop(loop),
        lambda: (sampled_margins(loop), sampled_delay_margin(loop)),
        lambda: stable_sampled_gains(loop),
    )


def continuous_proportional_loop(system: TransferFunction, gain: float) -> ProportionalLoop:
    """Return the loop of a gain around a system without ticks; a negative delay counts as none."""
    loop = replace(system, numerator=tuple(gain * c for c in system.numerator), delay=max(system.delay, 0.0))
    return _judge(
        None, closed_loop(loop), lambda: (margins(loop), delay_margin(loop)), lambda: stable_gains(loop)
    )


def _judge(
    sample_time: float | None,
    closed: ClosedLoop,
    left: Callable[[], tuple[Margins, float]],
    factors: Callable[[], tuple[tuple[float, float], ...]],
) -> ProportionalLoop:
    stable = closed.verdict == "stable"
    loop_margins, delay = left() if stable else (None, None)
    return ProportionalLoop(
        sample_time=sample_time,
        closed=closed,
        margins=loop_margins,
        delay_margin=delay,
        stable_factors=None if stable else factors(),
    )
