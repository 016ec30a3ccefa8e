"""The judge of what is said of random motors: verdicts, coverage, widths beside the bound, causes that aren't there, cost."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from accusations import ACCUSATIONS

Row = dict[str, Any]

COVERED = ("gain", "time_constant", "delay", "coulomb_voltage")
TOGETHER = ("lag", "speed_at_level", "acceleration")
"""Combinations of parameters."""
JUDGED = (*COVERED, *TOGETHER, "offset_voltage")
WIDENED = ("gain", "time_constant", "lag")
FAR = 3.0
"""Standard deviations beyond which an estimate is off."""
SEVERAL = 4
"""Events from which on a record has several."""
KNOWABLE = 0.02
"""A bound on gain and time constant below which a record ought to be trusted."""

CAUSES = ACCUSATIONS | {
    "angle-wraps",
    "factor-off",
    "gap-input-unknown",
    "integrator-likely",
    "loop-runs-away",
    "loop-swings",
    "records-apart",
    "sign-negative",
    "time-unit-doubtful",
    "weight",
}
"""Findings that accuse the motor or the record of something that a plain first-order record hasn't."""

_TWO_SIDED = 1.959964


def stated(row: Row) -> dict[str, tuple[float, float, float, float]]:
    """Return what a row states: value, standard deviation and 95 % interval by parameter or combination; nothing if refused."""
    if row["verdict"] not in ("trusted", "doubtful"):
        return {}
    return {name: tuple(one) for name, one in row.get("estimates", {}).items() if name in JUDGED}


def knows(row: Row) -> bool:
    """Return whether a row states gain and time constant by themselves."""
    return {"gain", "time_constant"} <= set(stated(row))


def widening(one: tuple[float, float, float, float], true: tuple[float, float]) -> float:
    """Return by what factor an interval would have to grow about its value to reach what is true; 0 where the value is.

    What is true is anything from `true[0]` to `true[1]`. An interval that ends at its value on that side has no factor.
    """
    value, _, low, high = one
    if true[0] <= value <= true[1]:
        return 0.0
    miss, half = (true[0] - value, high - value) if value < true[0] else (value - true[1], value - low)
    return miss / half if half > 0.0 else math.inf


def holds(one: tuple[float, float, float, float], true: tuple[float, float]) -> bool:
    """Return whether an interval holds a value that is true."""
    return bool(one[2] <= true[1] and one[3] >= true[0])


def off(row: Row) -> dict[str, float]:
    """Return by how many standard deviations each parameter that a row states is off, of those beyond `FAR`.

    The lag doesn't count where nothing but time constant and delay is stated, from which it follows.
    """
    said = stated(row)
    derived = {"lag"} - set(row.get("combinations", ()))
    found = {name: _TWO_SIDED * widening(said[name], row["true"][name]) for name in set(said) - derived}
    return {name: z for name, z in sorted(found.items()) if z > FAR}


def is_knowable(row: Row) -> bool:
    """Return whether gain and time constant could be known to within `KNOWABLE`."""
    return max(row["bound"]["gain"], row["bound"]["time_constant"]) < KNOWABLE


def causes(row: Row) -> list[str]:
    """Return the codes of what a row accuses its motor or its record of."""
    codes = {code for group in row.get("findings", {}).values() for code in group}
    return sorted(codes & CAUSES)


def bounded(rows: Iterable[Row]) -> tuple[int, int]:
    """Return how many upper ends of bounded parameters what is true keeps below, and how many there are."""
    found = [
        row["true"][name][0] <= high
        for row in rows
        if row["verdict"] in ("trusted", "doubtful")
        for name, (_, high) in row.get("bounds", {}).items()
        if name in JUDGED
    ]
    return sum(found), len(found)


def coverage(rows: Iterable[Row], name: str) -> tuple[int, int]:
    """Return how many intervals of a parameter hold what is true, and how many are stated; a friction of zero doesn't count."""
    found = [
        holds(stated(row)[name], row["true"][name])
        for row in rows
        if name in stated(row) and (name != "coulomb_voltage" or row["true"][name][1] != 0.0)
    ]
    return sum(found), len(found)


def ratios(rows: Iterable[Row], name: str, beside: str = "bound") -> list[float]:
    """Return stated standard deviation over a bound of gain or time constant, of records that could be known."""
    return [
        stated(row)[name][1] / abs(row["true"][name][0]) / row[beside][name]
        for row in rows
        if name in stated(row) and is_knowable(row)
    ]


def factors(rows: Iterable[Row]) -> list[float]:
    """Return by how much each interval of gain, time constant and lag would have to grow to hold what is true."""
    return [
        widening(one, row["true"][name])
        for row in rows
        for name, one in stated(row).items()
        if name in WIDENED
    ]


def codes(rows: Sequence[Row], severities: Sequence[str]) -> Counter[str]:
    """Return in how many rows each code of a finding of those severities stands."""
    return Counter(
        code for row in rows for code in {c for s in severities for c in row.get("findings", {}).get(s, [])}
    )


def share(part: float, whole: float) -> float:
    """Return a share in percent; NaN of nothing."""
    return 100.0 * part / whole if whole else float("nan")


def quantile(values: Sequence[float], q: float) -> float:
    """Return a quantile that is one of the values, so that an infinite one is no trouble; NaN of none."""
    return float(np.quantile(values, q, method="inverted_cdf")) if len(values) else float("nan")
