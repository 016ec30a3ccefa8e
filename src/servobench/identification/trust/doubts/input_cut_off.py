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
    if any(_turns_round(each, _PLAINLY * top) or _rises_again(each, top) for each in stretches):
        return True
    turn = [_turns_round(each, _FALLS * top) for each in stretches]
    return len(turn) >= _FEWEST and bool(np.mean(turn) >= _MOST)


def _turns_round(speed: Array, by: float) -> bool:
    """Whether a speed is larger within a stretch than at either end of it, which no constant input makes it, by so much."""
    at = int(speed.argmax())
    inner = _INNER[0] * len(speed) <= at <= _INNER[1] * len(speed)
    return inner and speed[at] - max(speed[0], speed[-1]) > by


def _rises_again(speed: Array, top: float) -> bool:
    """Whether a speed is another one at once in a stretch, after it had settled, as it is on the stairs of a staircase."""
    if len(speed) < 2 * _PARTS:
        return False
    change = np.abs(np.diff([part.mean() for part in np.array_split(speed, _PARTS)]))
    settled = np.flatnonzero(change < _SETTLED * top)
    return len(settled) > 0 and float(change[settled[0] :].max()) > _AT_ONCE * top


DOUBTS.member("input_cut_off")(Doubt(codes=("input-cut-off",), about_data=_about))
