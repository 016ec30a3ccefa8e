"""Wraps in a column: their removal, and the places where some may have been missed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.errors import UsageError
from servobench.core.finding import Finding, info, refusal, warning
from servobench.core.rounding import count_text, with_unit
from servobench.core.units import unit as unit_named
from servobench.recordings.measurement.column import Column
from servobench.recordings.measurement.unwrap import Unwrap, Unwrapped, unwrap

# Widths at which absolute encoders (10, 12, 14) and counters wrap.
_USUAL_BITS = (8, 10, 12, 14, 16, 24, 32)
_ALL = 0.9  # of the range: a jump back to where the sensor begins
_GRADUAL = 0.3  # of the range: more from row to row, and a swing looks like a jump
_FAST = 0.02  # of the modulus, from row to row: what is always slower is far from the limit
_SIDES = 2  # steps on either side of a jump that go the other way
_TURNS = 4.0  # that an angle may stay within and wrap at each
_SELDOM = 0.1  # of the steps: what jumps more often is sampled too rarely to say
_BEYOND = 1.5  # times such a range: the travel, wraps taken out
_STOPS = 0.05  # of the steps beside it: a smaller step the other way is none


def without_wraps(column: Column, stage: Unwrap) -> tuple[Column, list[Finding]]:
    """Return a column without its wraps, and findings where a wrap may be none or one may be missed.

    Raises `UsageError` where the modulus is in another unit than the column can be.
    """
    if unit_named(stage.unit).dimension != unit_named(column.unit).dimension:
        raise UsageError(
            f"`{stage}` can't unwrap {column.name!r}, which is in {column.unit} there: give the modulus in {column.unit}"
        )
    unwrapping = unwrap(column.x, stage.si_modulus)
    doubts = [
        *_ambiguous_steps(column, stage, unwrapping),
        *_wraps_in_a_longer_range(column, stage, unwrapping),
    ]
    if not doubts:
        doubts = _fastest_unwrapped(column, stage, unwrapping)
    return replace(column, x=unwrapping.count), doubts


def _ambiguous_steps(column: Column, stage: Unwrap, unwrapping: Unwrapped) -> list[Finding]:
    # From one step to the next the speed can't change by half the modulus and come out right: a wrap was misjudged.
    erratic = np.abs(np.diff(unwrapping.delta, prepend=unwrapping.delta[:1])) >= 0.5 * stage.si_modulus
    erratic[:2] = False  # the first step is no step, and from it to the second nothing changes
    doubtful = column.rows[np.flatnonzero(unwrapping.ambiguous | erratic)]
    if not len(doubtful):
        return []
    sentence = (
        f"In {count_text(len(doubtful), 'place')}, the first of them row {doubtful[0]}, {column.name!r} changes so much between "
        f"samples that `{stage}` can't determine the direction; sample more often, or check the modulus."
    )
    return [warning("unwrap-ambiguous", sentence, rows=(int(doubtful[0]), int(doubtful[-1])))]


def _wraps_in_a_longer_range(column: Column, stage: Unwrap, unwrapping: Unwrapped) -> list[Finding]:
    span, jumps = float(np.ptp(column.x)), column.rows[np.flatnonzero(unwrapping.wrap)]
    if not len(jumps) or span <= stage.si_modulus * (1.0 + 1e-6):
        return []
    sentence = (
        f"{column.name!r} spans {span:.9g} {column.unit}, more than `{stage}` allows, and {len(jumps)} of its jumps "
        f"were unwrapped, the first in row {jumps[0]}; check the modulus."
    )
    return [warning("unwrap-out-of-range", sentence, rows=(int(jumps[0]), int(jumps[-1])))]


def _fastest_unwrapped(column: Column, stage: Unwrap, unwrapping: Unwrapped) -> list[Finding]:
    """Up to which speed a wrapped column can be unwrapped: a faster one looks like a slower one, also the other way."""
    if not unwrapping.wrap.any() or np.abs(unwrapping.delta).max() < _FAST * stage.si_modulus:
        return []
    step = float(np.median(np.diff(column.t)))
    sentence = (
        f"`{stage}` is right as long as {column.name!r} moves by less than half of that from row to row, "
        f"{with_unit(step, 's', 3)}: at less than {with_unit(0.5 * stage.si_modulus / step, f'{column.unit}/s', 3)}. These rows "
        "can't show a faster motion, which would look like a slower one."
    )
    return [info("unwrap-limit", sentence)]


def suspect_wraps(column: Column, counts_per_rev: float | None) -> list[Finding]:
    """Return a finding if a position, in SI units or in counts, seems to wrap: reported, not repaired.

    It has to stay within one modulus (a turn, or a usual width of a counter), jump by more than half of it, and go on
    after each jump as it went before. Where it wraps at a turn to either side, or has a false value in a wrap, it stays within
    four, jumps seldom, and its travel is longer.
    """
    span, largest = float(np.ptp(column.x)), float(np.max(np.abs(np.diff(column.x)), initial=0.0))
    for stage in _usual_moduli(column.unit, counts_per_rev):
        modulus = stage.si_modulus
        is_within = span <= modulus * (1.0 + 1e-6)
        is_near = column.unit == "rad" and span <= _TURNS * modulus
        if largest <= 0.5 * modulus or not (is_within or is_near):
            continue
        unwrapping = unwrap(column.x, modulus)
        jumps = np.flatnonzero(unwrapping.wrap)
        seldom = len(jumps) <= _SELDOM * len(unwrapping.wrap)
        comes_back = seldom and float(np.ptp(unwrapping.count)) > _BEYOND * span
        if (is_within or comes_back) and _goes_on(unwrapping.delta, jumps):
            return [_wraps(column, stage, column.rows[jumps])]
        if is_within:
            break
    return _begins_anew(column, span)


def _begins_anew(column: Column, span: float) -> list[Finding]:
    """A refusal of a position that jumps back by all of its range as it moves the other way, as a turning potentiometer does."""
    steps = np.diff(column.x)
    jumps = np.flatnonzero(np.abs(steps) > _ALL * span)
    beside = jumps[:, None] + np.array([*range(-_SIDES, 0), *range(1, _SIDES + 1)])
    if not len(jumps) or beside.min() < 0 or beside.max() >= len(steps):
        return []
    if (
        not (steps[beside] * np.sign(steps[jumps])[:, None] < 0.0).all()
        or np.abs(steps[beside]).max() > _GRADUAL * span
    ):
        return []
    jump = float(np.median(np.abs(steps[jumps])) + np.median(np.abs(steps[beside])))
    whole = f"{np.degrees(jump):.4g} deg" if column.unit == "rad" else f"{jump:.4g} {column.unit}"
    row = column.rows[jumps[0] + 1]
    sentence = (
        f"The position {column.name!r} jumps back by all of its range, the first time in row {row}, and moves on as before: its "
        f"sensor begins anew, as a turning potentiometer does, and a motor model can't fit that. Put `unwrap {whole}` at the "
        f"front of the chain (`chain='unwrap {whole}'`), and check that this is a turn of the shaft in the unit that was given."
    )
    return [refusal("angle-wraps", sentence, rows=(int(row), int(column.rows[jumps[-1] + 1])))]


def _usual_moduli(unit: str, counts_per_rev: float | None) -> list[Unwrap]:
    """The moduli that positions in a unit wrap at, smallest first."""
    if unit == "rad":
        return [Unwrap(modulus=360.0, unit="deg")]
    if unit != "counts":
        return []
    counts = [2.0**bits for bits in _USUAL_BITS]
    return [
        Unwrap(modulus=n, unit="counts")
        for n in sorted([*counts, *([counts_per_rev] if counts_per_rev else [])])
    ]


def _goes_on(delta: Array, jumps: NDArray[np.intp]) -> bool:
    """Whether the steps at the jumps, wraps taken out, go the way of the steps beside them, in nine of ten at least."""
    sides = np.concatenate([delta, [0.0]])
    beside = sides[jumps - 1] + sides[jumps + 1]
    small = np.abs(delta[jumps]) <= 2.0 * np.max(np.abs(np.delete(delta, jumps)), initial=0.0)
    return bool(np.mean((beside * delta[jumps] >= -_STOPS * beside**2) & small) >= 0.9)


def _wraps(column: Column, stage: Unwrap, rows: NDArray[np.int64]) -> Finding:
    jump = "a turn" if column.unit == "rad" else f"{stage.modulus:.9g} counts"
    times = "once, " if len(rows) == 1 else f"{len(rows)} times, the first time "
    return refusal(
        "angle-wraps",
        f"The position {column.name!r} jumps by about {jump} {times}in row {rows[0]} and continues as before: it "
        f"wraps, and a motor model can't fit a wrapped angle. Put `{stage}` at the front of the chain "
        f"(`chain='{stage}'`).",
        rows=(int(rows[0]), int(rows[-1])),
    )
