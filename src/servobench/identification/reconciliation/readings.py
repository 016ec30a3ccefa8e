"""The value that a method reads off the data, and the effect of filters on it."""

from __future__ import annotations

from dataclasses import dataclass

from servobench.core.channels import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Lags:
    """The part of filters of falling `cutoffs` (n,) [rad/s] in a time constant, `extra`, and in `delays` (n,) [s], as found."""

    cutoffs: Array
    extra: Array
    delays: Array


@dataclass(frozen=True, kw_only=True)
class Reading:
    """A method's reading of a speed behind a chain: gain [unit of the data] and time constant [s].

    `by_hand` where a person reads it off a curve; `simulated` where the record has no steps and the fitted motor was given some.
    `why_not` says why it can't be read, empty where it can; then both are NaN.
    """

    method: str
    chain: str
    gain: float
    time_constant: float
    by_hand: bool
    simulated: bool = False
    why_not: str = ""
