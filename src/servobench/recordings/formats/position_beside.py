"""A position that stands beside a speed in the same file, and goes another way than the speed adds up to."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.core.rounding import plain
from servobench.core.units import unit
from servobench.recordings.formats.choice import is_reference, parts_that_tell_apart
from servobench.recordings.formats.roles import quantity_of, shell_text
from servobench.recordings.recording import Recording, Series

_FEWEST = 30  # samples
_SAME = 0.05  # of the way: what sums of samples may be off by
_CLEAR = 5.0  # times what the two ways scatter by, each over its range
_GEAR = 3.0  # another factor than those of units, and larger: of a gear between the two
_UNITS = (60.0, 2.0 * np.pi, 360.0, 60.0 / (2.0 * np.pi), 180.0 / np.pi)  # what speeds are mistaken by
_NEAR = 0.03  # of such a factor


def about_position_beside(recording: Recording, output: Series) -> list[Finding]:
    """Return a doubt of an output speed that a position of the same motor, by the file's own unit, contradicts.

    The way that the speed adds up to and the way that the position goes are alike but for a factor other than 1: one of the units
    is wrong, a part of the counts was lost, or there is a gear between the two, which isn't doubted.
    """
    if quantity_of(output.channel.unit) != "speed" or output.t is None or len(output.values) < _FEWEST:
        return []
    for other in recording.series:
        factor = _factor(output, other)
        if factor is None or abs(factor - 1.0) <= _SAME:
            continue
        name, beside, times = output.channel.name, other.channel.name, plain(abs(factor), 3)
        way = "the other way, " if factor < 0 else ""
        sentence = (
            f"The position `{beside}` goes {way}{times} times as far as the speed `{name}` adds up to. Either a unit is wrong, "
            "or the speed misses a part of the counts, or there is a gear between the two. If the position is right, say "
            f"`output={shell_text(beside)}`."
        )
        say = info if _is_gear(factor) else warning
        return [say("position-disagrees", sentence, parameters=("gain",))]
    return []


def _is_gear(factor: float) -> bool:
    """Whether a factor is larger than what gets lost, or smaller, and none by which units are mistaken."""
    size = max(abs(factor), 1.0 / abs(factor))
    return size > _GEAR and all(abs(size / each - 1.0) > _NEAR for each in _UNITS)


def _factor(output: Series, other: Series) -> float | None:
    """The way of a position over that of a speed; None where it is none of the same motor, or goes another way."""
    name, symbol = other.channel.name, other.channel.unit
    if quantity_of(symbol) != "position" or is_reference(name) or len(other.values) != len(output.values):
        return None
    if parts_that_tell_apart(name) != parts_that_tell_apart(output.channel.name):
        return None
    whole, rate = unit(str(symbol)), unit(str(output.channel.unit))
    if rate.si != f"{whole.si}/s":
        return None
    position, speed, steps = (
        whole.factor / rate.factor * other.values,
        output.values,
        np.diff(np.asarray(output.t)),
    )
    way = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * steps))
    return _slope(way, position)


def _slope(way: Array, position: Array) -> float | None:
    """The slope of a line through positions over ways (N,); None where they don't lie on one as near as its slope is from 1."""
    if not (np.isfinite(way).all() and np.isfinite(position).all() and np.ptp(way) > 0 < np.ptp(position)):
        return None
    x, y = way - way.mean(), position - position.mean()
    slope = float(x @ y) / float(x @ x)
    scatter = float(np.std(y - slope * x)) / float(np.ptp(x))
    return slope if slope != 0.0 and _CLEAR * scatter < min(abs(slope - 1.0), abs(slope)) else None
