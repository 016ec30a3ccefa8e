"""An input that was logged up to the end of a range only, while what drives the motor goes on beyond it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
from servobench.core.runs import runs
from servobench.identification.models.motion import smooth_speed
from servobench.identification.models.steady import stretches_of_input
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_OFF = 0.02  # of the largest input
_FEWEST = 3  # stretches at an end of the range
_LONG = 8  # samples of a stretch that show whether the speed turns round in it
_GRADUAL = 0.4  # of the range: what the input steps by into a stretch that its log cuts off
_INNER = (0.1, 0.9)  # of a stretch: where the speed is largest if it turns round
_FALLS = 0.05  # of the largest speed: by how much less it is at the end
_MOST = 0.7  # of the stretches
_PARTS = 12  # of a stretch
_BEYOND_NOISE = 7.0  # standard deviations of a part's mean, where a single stretch shows it
_BY_CHANCE = 2.2  # the same on average over several stretches: what noise alone makes of the largest part
_BEYOND_CHANCE = 3.0  # over the root of their number, and more than that
_NORMAL_MEDIAN, _NORMAL_MEAN = 0.6745, 0.7979  # of the sizes of normal values, in standard deviations
_SETTLED = 0.01  # of the largest speed: what it changes by from one part to the next
_LONG_SETTLED = 4  # such changes one after the other: where a speed turns round there are fewer
_LATE = 3  # rows, with those that a smoothed speed looks ahead
_AT_ONCE = 0.05  # of it: a motor that warms up, or a supply that sags, takes longer than a part
_PLAINLY = 0.2  # of the largest speed: a rise and a fall of so much under a constant input in a single stretch are enough


def _about(records: Sequence[Dataset]) -> list[Finding]:
    return [finding for record in records for finding in _of(record)]


def _of(data: Dataset) -> list[Finding]:
    for end in (float(data.u.max()), float(data.u.min())):
        if _is_cut_off(data, end):
            sentence = (
                f"{data.name}: the input stays at {with_unit(end, data.input_unit)} for a while, but there the speed changes "
                "as if the input went on beyond: it was logged, or converted, up to there only. Widen the range of that channel, "
                "or record an input that stays within it."
            )
            return [warning("input-cut-off", sentence, parameters=("gain",))]
    return []


def _is_cut_off(data: Dataset, end: float) -> bool:
    """Whether the speed under an input that gradually came to that end of its range is none of a constant input.

    It turns round plainly in one stretch, or in most of several, or rises again after it had settled.
    """
    sense = 1.0 if end >= 0.5 * float(data.u.max() + data.u.min()) else -1.0
    if not np.ptp(data.u) > 0 or abs(end) < _OFF * float(np.abs(data.u).max()):
        return False  # an input that is switched off isn't cut off
    u, (first, after) = data.input_at_output, stretches_of_input(data)
    gradual = np.abs(u[first] - u[first - 1]) < _GRADUAL * np.ptp(data.u)
    some = (u[first] == end) & (after - first >= _LONG) & (first > 0) & gradual
    if not some.any():
        return False
    speed = sense * smooth_speed(data)
    top = float(np.percentile(np.abs(speed), 99))
    stretches = [_before_the_next(speed[a:b], top) for a, b in zip(first[some], after[some], strict=True)]
    means = [_means(each) for each in stretches]
    rises = np.array([_rise(each) for each in means])
    noise = max(_noise(stretches, means), _count_noise(data, stretches))
    plainly = np.array([_turns_round(each, _PLAINLY * top) for each in stretches])
    if np.any(plainly & (rises > _BEYOND_NOISE * noise)):
        return True
    long = [mean for mean, each in zip(means, stretches, strict=True) if len(each) >= 2 * _PARTS]
    if any(_rises_again(each, top, _BEYOND_NOISE * noise) for each in long):
        return True
    turns = np.mean([_turns_round(each, _FALLS * top) for each in stretches])
    chance = (_BY_CHANCE + _BEYOND_CHANCE / np.sqrt(len(rises))) * noise
    return bool(len(rises) >= _FEWEST and turns >= _MOST and rises.mean() > chance)


def _before_the_next(speed: Array, top: float) -> Array:
    """The speed in a stretch, without its end where it had settled: what changes there may be the next input's, logged late."""
    means = _means(speed)
    small = np.abs(np.diff(means)) < _SETTLED * top
    if max((last - first for first, last in runs(small)), default=0) < _LONG_SETTLED:
        return speed
    return speed[: len(speed) - max(len(speed) // _PARTS, _LATE)]


def _turns_round(speed: Array, by: float) -> bool:
    """Whether a speed is larger within a stretch than at either end of it, which no constant input makes it, by so much."""
    at = int(speed.argmax())
    inner = _INNER[0] * len(speed) <= at <= _INNER[1] * len(speed)
    return bool(inner and speed[at] - max(speed[0], speed[-1]) > by)


def _rises_again(means: Array, top: float, beyond: float) -> bool:
    """Whether a speed, by the means of a stretch's parts, is another one at once after it had settled, as it is on stairs.

    The change is by more than noise makes of a mean, on both of its sides.
    """
    change = np.abs(np.diff(means))
    small = change < _SETTLED * top
    settled = np.flatnonzero(small[1:] & small[:-1])  # a single small one may be chance
    return len(settled) > 0 and float(change[settled[0] :].max()) > max(_AT_ONCE * top, np.sqrt(2) * beyond)


def _means(speed: Array) -> Array:
    """The means of the parts of a stretch."""
    return np.array([part.mean() for part in np.array_split(speed, min(_PARTS, len(speed)))])


def _rise(means: Array) -> float:
    """By how much the largest of a stretch's means lies above the first and the last."""
    return float(means.max() - max(means[0], means[-1]))


def _count_noise(data: Dataset, stretches: Sequence[Array]) -> float:
    """The standard deviation that whole counts give the mean speed of a stretch's part: a count more or less in its time."""
    rows = max(float(np.median([len(each) / _PARTS for each in stretches])), 1.0)
    counted = data.quantum if data.kind == "position" and data.quantum else 0.0
    return float(counted / (np.sqrt(6.0) * rows * data.sample_time))


def _noise(stretches: Sequence[Array], means: Sequence[Array]) -> float:
    """The standard deviation of the mean of a part of a stretch: the smaller of two, as each is spoiled by something else.

    One is by how far a mean is off a parabola through others, which stairs that go on spoil. The other is by how far samples are
    off the next ones, twice that as the noise of a smoothed speed lasts; of a coarse speed most are off by nothing.
    """
    bends = np.abs(np.concatenate([np.diff(each, 3) for each in means]))
    steps = np.abs(
        np.concatenate([np.diff(each) / np.sqrt(max(1.0, len(each) / _PARTS)) for each in stretches])
    )
    by_means = float(np.median(bends)) / (_NORMAL_MEDIAN * np.sqrt(20.0))
    by_samples = 2.0 * float(steps.mean()) / (_NORMAL_MEAN * np.sqrt(2.0))
    return float(min(by_means, by_samples))


DOUBTS.member("input_cut_off")(Doubt(codes=("input-cut-off",), about_data=_about))
