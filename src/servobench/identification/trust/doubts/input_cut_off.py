"""An input that was logged up to the end of a range only, while what drives the motor goes on beyond it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.core.rounding import with_unit
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
_BY_CHANCE, _BEYOND_CHANCE = (
    2.2,
    3.0,
)  # the same on average over n stretches: what noise alone makes, and this over √n more
_SETTLED = 0.01  # of the largest speed: what it changes by from one part to the next
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
    """Whether the speed turns round in most of the stretches in which the input gradually came to that end of its range."""
    sense = 1.0 if end >= 0.5 * float(data.u.max() + data.u.min()) else -1.0
    if not np.ptp(data.u) > 0 or abs(end) < _OFF * float(np.abs(data.u).max()):
        return False  # an input that is switched off isn't cut off
    u, (first, after) = data.input_at_output, stretches_of_input(data)
    gradual = np.abs(u[first] - u[first - 1]) < _GRADUAL * np.ptp(data.u)
    some = (u[first] == end) & (after - first >= _LONG) & (first > 0) & gradual
    if not some.any():
        return False
    speed = sense * smooth_speed(data)
    stretches = [speed[a:b] for a, b in zip(first[some], after[some], strict=True)]
    top = float(np.percentile(np.abs(speed), 99))
    noise = _noise(stretches)
    plain = _BEYOND_NOISE * noise
    if any(_turns_round(each, _PLAINLY * top, plain) or _rises_again(each, top, plain) for each in stretches):
        return True
    turn = [_turns_round(each, _FALLS * top, -np.inf) for each in stretches]
    if len(turn) < _FEWEST or np.mean(turn) < _MOST:
        return False
    chance = (_BY_CHANCE + _BEYOND_CHANCE / float(np.sqrt(len(turn)))) * noise
    return float(np.mean([_rise(_means(each)) for each in stretches])) > chance


def _turns_round(speed: Array, by: float, beyond: float) -> bool:
    """Whether a speed is larger within a stretch than at either end of it, which no constant input makes it, by so much.

    The means of its parts have to show that, too, by more than noise makes of them.
    """
    at = int(speed.argmax())
    inner = _INNER[0] * len(speed) <= at <= _INNER[1] * len(speed)
    return inner and speed[at] - max(speed[0], speed[-1]) > by and _rise(_means(speed)) > beyond


def _rises_again(speed: Array, top: float, beyond: float) -> bool:
    """Whether a speed is another one at once in a stretch, after it had settled, as it is on the stairs of a staircase.

    The change is by more than noise makes of a part's mean, on both of its sides.
    """
    if len(speed) < 2 * _PARTS:
        return False
    change = np.abs(np.diff(_means(speed)))
    small = change < _SETTLED * top
    settled = np.flatnonzero(small[1:] & small[:-1])  # a single small one may be chance
    return len(settled) > 0 and float(change[settled[0] :].max()) > max(_AT_ONCE * top, np.sqrt(2) * beyond)


def _means(speed: Array) -> Array:
    """The means of the parts of a stretch."""
    return np.array([part.mean() for part in np.array_split(speed, min(_PARTS, len(speed)))])


def _rise(means: Array) -> float:
    """By how much the largest of a stretch's means lies above the first and the last."""
    return float(means.max() - max(means[0], means[-1]))


def _noise(stretches: Sequence[Array]) -> float:
    """The standard deviation of a part's mean, by what is smaller: how much parts are off a parabola through others, or samples
    off the next ones, twice that as the noise of a smoothed speed lasts. Stairs that go on beyond the end spoil the first alone.
    """
    bends = np.concatenate([np.diff(_means(each), 3) for each in stretches])
    steps = np.concatenate([np.diff(each) / np.sqrt(max(1.0, len(each) / _PARTS)) for each in stretches])
    # Of normal values the median of their sizes is 0.6745 standard deviations, their mean 0.7979; a coarse speed has many zeros.
    return min(
        float(np.median(np.abs(bends))) / 0.6745 / 20**0.5,
        2.0 * float(np.abs(steps).mean()) / 0.7979 / 2**0.5,
    )


DOUBTS.member("input_cut_off")(Doubt(codes=("input-cut-off",), about_data=_about))
