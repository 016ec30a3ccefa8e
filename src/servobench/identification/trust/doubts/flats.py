"""Stretches in which the output stands still: a sensor at the end of its range, a blocked shaft, a dead channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from servobench.core.channels import Array
from servobench.core.finding import Finding, refusal, warning
from servobench.core.rounding import plain, with_unit
from servobench.core.runs import runs
from servobench.identification.models.motion import smooth_speed, smoothing_span
from servobench.identification.models.steady import speeds_by_level, stretches_of_input
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.lattice import lattice_step
from servobench.recordings.measurement.dataset import Dataset

_STILL = "output-still"
_FEW = 3.0  # quanta: what moves less than that hasn't moved
_TRAVELLED = 6.0  # times what steps that come and go by chance would travel
_ZERO = 0.02  # of the largest speed: what a tachometer may show of a shaft that rests
_FINE = 200.0  # quanta in the range: a coarser sensor doesn't show how fast it reached its end
_VISITS = 2  # of the end of a range: a motor that turns round once stands at its own largest value, too
_OF_ALL = 0.2  # of the stretches that stand still: a sensor whose values are held has them everywhere
_SHORTEST = 5  # samples in a stretch
_ABRUPT = 0.3  # of the usual pace, or of a loop's full pace, at which a stretch is entered: a motor slows down first
_UNDER_WAY = 0.6  # of the pace that it reaches or exceeds in a twentieth of its windows
_PILE = 0.005  # of the samples are exactly alike where a sensor without steps is at its end
_ALONE = 5.0  # times as many samples at the end of the range as at any other value
_ARRIVED = 0.05  # of the range: as near to its reference as a loop comes before friction holds it
_WOULD_GO = 10.0  # quanta that the shaft would go at its top speed one way: on fewer it may have turned round
_LATE = 2  # samples of delay, as a loop often has them
_PART = 0.05  # of the record, for a blocked shaft
_PARTS = 8  # of a record: an input that alternates within them may be too fast for a motor
_ALTERNATES = 0.1  # of the largest input, as the standard deviation of its means over the parts
_COUNTED = 50.0  # quanta that show whether a motion is even
_ONE_STEP = 0.51  # quanta by which even motion may be off its line: half a step, and what a line of least squares adds
_LONG = 20  # samples under the last input, of which a quarter at least has to show an even speed
_EVEN = 0.3  # of the speed: what an even one may vary by
_STAIRS = 0.05  # of the rows: an input that changes in fewer of them is one of levels
_SLOW = 0.1  # of the speed: so much is as good as rest, and as much less as good as none less
_AT_REST = 3  # samples
_SLOWED = 0.5  # of the speed: a motor that loses more of it under the same input is no longer driven by that
_FALLS = 4  # samples at least, each slower than the one before, that show it
_ROUNDING = 1e-9  # of the range
_TURNS_WITHIN = (
    3.0  # quanta: a shaft that goes no farther before and after it turned round may have done so unseen
)


@dataclass(frozen=True, kw_only=True)
class _Flat:
    """Samples `first` to `last`, which are alike, and the least pace of the output before them, per sample."""

    first: int
    last: int
    pace: float


def _about(records: Sequence[Dataset]) -> list[Finding]:
    findings = [finding for record in records for finding in _of(record)]
    if sum(finding.code == _STILL for finding in findings) == len(records):
        return findings
    # Files of one motor at many levels: at the lowest of them it stays where it is, and the others need no such file.
    return [
        replace(each, sentence=f"{each.sentence} Leave this recording out.") if each.code == _STILL else each
        for each in findings
    ]


def _turns_evenly(data: Dataset, quantum: float) -> bool:
    """Whether a position goes on at one speed, to within its steps, while the input differs from part to part of the record."""
    levels = [part.mean() for part in np.array_split(data.u, _PARTS)]
    alternates = np.std(levels) > _ALTERNATES * np.abs(data.u).max()
    if data.kind != "position" or not alternates or np.ptp(data.y) <= _COUNTED * quantum:
        return False
    t = data.t_output - data.t_output.mean()
    away = data.y - data.y.mean() - t * float(t @ data.y) / float(t @ t)
    return bool(np.abs(away).max() <= max(_ONE_STEP * quantum, _ROUNDING * np.ptp(data.y)))


def _even_motion(data: Dataset) -> Finding:
    low, high = plain(data.u.min(), 3), plain(data.u.max(), 3)
    speed = (data.y[-1] - data.y[0]) / (data.t_output[-1] - data.t_output[0])
    sentence = (
        f"{data.name}: the shaft turns at {with_unit(float(speed), f'{data.position_unit}/s', 3)} all the time, although the "
        f"input goes from {low} to {high} {data.input_unit}: the input and the output don't belong together, or something else "
        "drives the shaft."
    )
    return refusal(_STILL, sentence)


def _of(data: Dataset) -> list[Finding]:
    if not np.ptp(data.u) > 0 and (finding := _slows_down(data)):
        return [finding]
    if not np.ptp(np.append(data.u, data.input_before)) > 0 or len(data.y) < 20:
        return []
    quantum = data.quantum or lattice_step(data.y) or 0.0
    if np.ptp(data.y) > 0 and not _travels(data, quantum):
        return [_too_little(data, quantum)]
    if np.ptp(data.y) == 0:
        low, high = plain(data.u.min(), 3), plain(data.u.max(), 3)
        goes = f"is {high}" if low == high else f"goes from {low} to {high}"
        sentence = (
            f"{data.name}: the output doesn't move, although the input {goes} {data.input_unit}: friction holds the shaft, it is "
            "blocked, the amplifier is off, the sensor belongs to another motor, or the motion was smaller than one step of the "
            "sensor."
        )
        return [refusal(_STILL, sentence)]
    if _turns_evenly(data, quantum):
        return [_even_motion(data)]
    flats = _flats(data, quantum)
    return (
        _clipping(data, flats, quantum)
        or _pile_up(data, quantum)
        or _stops(data, flats, quantum)
        or _runs_down(data, quantum)
    )


def _travels(data: Dataset, quantum: float) -> bool:
    """Whether the output goes further than a few steps of its sensor, by a speed also bit by bit.

    A wheel that turns by less than a count in each row has a speed of one or no steps, and travels all the same. Steps that come
    and go by chance would be as far away as the root of their number.
    """
    if np.ptp(data.y) > _FEW * quantum:
        return True
    dithers = np.abs(data.y).max() > _FEW * quantum  # a value, by its last digit
    if data.kind != "speed" or dithers:
        return False
    steps = data.y / quantum
    return bool(np.ptp(np.cumsum(steps)) > _TRAVELLED * max(float(np.sqrt(np.count_nonzero(steps))), _FEW))


def _too_little(data: Dataset, quantum: float) -> Finding:
    steps = max(round(float(np.ptp(data.y)) / quantum), 1)
    sentence = (
        f"{data.name}: the output moves by {steps} {'step' if steps == 1 else 'steps'} of its "
        f"sensor, {plain(quantum, 3)} {data.output_unit} each: too few to identify a motor. Drive it "
        "further, or use a finer sensor."
    )
    return refusal("motion-too-small", sentence)


def _flats(data: Dataset, quantum: float) -> list[_Flat]:
    """The stretches of the same value, longer than one of the rounding at the slowest usual pace."""
    same = np.abs(np.diff(data.y)) <= 0
    pace = _usual_pace(data.y)
    shortest = max(_SHORTEST, int(np.ceil(5 * quantum / pace)) if pace > 0 else _SHORTEST)
    window = max(2, shortest // 2)
    return [
        _Flat(first=first, last=last, pace=_pace_before(data.y, first, window, quantum))
        for first, last in runs(same)
        if last - first >= shortest
    ]


def _usual_pace(y: Array) -> float:
    """The travel of the output in a sample while it moves: the median over windows of 20 samples in which it moves at all."""
    paces = _paces(y)
    return float(np.median(paces)) if len(paces) else 0.0


def _full_pace(y: Array) -> float:
    """The same for an output that is under way: of a loop that creeps to its set point for long, most windows aren't."""
    paces = _paces(y)
    return max(_usual_pace(y), _UNDER_WAY * float(np.percentile(paces, 95))) if len(paces) else 0.0


def _paces(y: Array) -> Array:
    """The travel of the output in a sample in each window of 20 samples in which it moves."""
    steps = np.abs(y[20:] - y[:-20]) / 20
    return np.asarray(steps[steps > 0], dtype=np.float64)


def _pace_before(y: Array, at: int, window: int, quantum: float) -> float:
    """The least pace there was: what moved by one count may have crept over its edge, as a pendulum that turns round does."""
    return max(abs(float(y[at] - y[max(at - window, 0)])) - quantum, 0.0) / window if at >= window else 0.0


def _clipping(data: Dataset, flats: list[_Flat], quantum: float) -> list[Finding]:
    """Whether flat tops stand at an end of the range, and are reached at full pace: no motor stops within a sample."""
    usual = _full_pace(data.y) if data.closed_loop else _usual_pace(data.y)
    if np.ptp(data.y) < _FINE * quantum:
        return []
    for end, which in ((float(data.y.max()), "largest"), (float(data.y.min()), "smallest")):
        if _is_rest(data, end):
            continue
        at_end = [flat for flat in flats if data.y[flat.first] == end and not _is_commanded(data, flat)]
        abrupt = [flat for flat in at_end if flat.pace > _ABRUPT * usual]
        if (
            len(abrupt) >= max(_VISITS, _OF_ALL * len(flats))
            and len(abrupt) >= 0.5 * len(at_end)
            and _leaves(data, abrupt, usual)
        ):
            return [_at_the_end(data, which, end, np.flatnonzero(data.y == end))]
    return []


def _is_rest(data: Dataset, end: float) -> bool:
    """Whether an end of an output's range is the speed of a shaft that rests, or what a tachometer shows of it."""
    return data.kind == "speed" and abs(end) <= _ZERO * float(np.abs(data.y).max())


def _is_commanded(data: Dataset, flat: _Flat) -> bool:
    """Whether a feedback loop was told to be there where the output stands: it brakes, and friction holds the shaft at once."""
    if data.reference is None:
        return False
    held = max(int(np.searchsorted(data.t_input, data.t_output[flat.first], side="right")) - 1, 0)
    return bool(abs(data.reference[held] - data.y[flat.first]) <= _ARRIVED * np.ptp(data.y))


def _pile_up(data: Dataset, quantum: float) -> list[Finding]:
    """Whether many samples of an output that has no steps of its own are exactly alike, at an end of the range."""
    jumps = np.abs(np.diff(data.y))
    if quantum > 0 or not (jumps > 0).any():
        return []
    usual = float(np.median(jumps[jumps > 0]))
    for end, which in ((float(data.y.max()), "largest"), (float(data.y.min()), "smallest")):
        at_end = np.flatnonzero(data.y == end)
        if _is_rest(data, end):
            continue
        if len(at_end) < max(10, _PILE * len(data.y)):
            continue
        if len(at_end) < _ALONE * _commonest_within(data.y):
            continue  # a sensor whose values are held, or come again, has as many alike elsewhere
        entered = at_end[(at_end > 0) & (data.y[at_end - 1] != end)]
        # A motor that settles comes near its last value in ever smaller steps, which end in a float's last digit.
        if len(entered) and np.median(jumps[entered - 1]) > 0.05 * usual:
            return [_at_the_end(data, which, end, at_end)]
    return []


def _commonest_within(y: Array) -> int:
    """The number of samples with the commonest value that is neither an end of the range nor zero."""
    values, counts = np.unique(y, return_counts=True)
    within = counts[1:-1][values[1:-1] != 0]
    return int(within.max(initial=0))


def _at_the_end(data: Dataset, which: str, end: float, samples: NDArray[np.int64]) -> Finding:
    sentence = (
        f"{data.name}: the output stays at its {which} value, {end:.4g} {data.output_unit}, in "
        f"{len(samples)} samples and arrives there at full speed: the sensor is at the end of its "
        "range. The motion there isn't known; use a smaller input, or leave these rows out."
    )
    rows = data.row_span(int(samples[0]), int(samples[-1]))
    return warning("output-clipped", sentence, parameters=("gain", "time_constant"), rows=rows)


def _leaves(data: Dataset, flats: list[_Flat], usual: float) -> bool:
    """Whether the output comes back from the end of its range, at least once, at full pace: a blocked shaft doesn't."""
    # At once, or within half of its stay: a loop that goes on to the other end stays far longer than it needs for the way.
    windows = (2, max(2, (flats[0].last - flats[0].first) // 2))
    return any(
        abs(float(data.y[flat.last + window] - data.y[flat.last])) / window > _ABRUPT * usual
        for window in windows
        for flat in flats
        if flat.last + window < len(data.y)
    )


def _stops(data: Dataset, flats: list[_Flat], quantum: float) -> list[Finding]:
    """Whether the shaft stands although the input is one that moved it at other times."""
    if data.input_unit in (data.position_unit, data.output_unit):
        return []  # a goal that is reached: there a servo stands as it should
    if data.kind == "speed":
        flats = [flat for flat in flats if data.y[flat.first] == 0.0]
        quantum *= data.sample_time  # how far a shaft goes unseen
    u = data.input_at_output
    speed = np.abs(smooth_speed(data))
    fastest = float(np.percentile(speed, 95))
    fast = np.abs(u[speed > 0.5 * fastest])
    # Not the median: between pulses a motor coasts at no input at all, and none would then be the usual one.
    usual = float(np.sqrt(np.mean(fast**2)))
    # A motor is still fast under what no longer drives it: of stairs, no less than what it was seen to turn under evenly counts.
    stairs = speeds_by_level([data]) if np.count_nonzero(np.diff(u)) < _STAIRS * len(u) else {}
    turning = [abs(level) for level, pace in stairs.items() if abs(pace) > _SLOW * fastest]
    driven = (np.abs(u) >= 0.99 * max(usual, min(turning, default=0.0))) & (u != 0)
    long = [flat for flat in flats if flat.last - flat.first + 1 >= _PART * len(data.y)]
    lost = _without_effect(data, np.where(driven, u, 0.0), flats, quantum)
    for flat in long:
        rows = slice(flat.first, flat.last + 1)
        held_back = _way_held_back(data, np.sign(u[rows]) * driven[rows], fastest)
        turns = data.kind == "position" and _may_turn_within(data, flat, quantum)
        stays = held_back > _WOULD_GO * quantum and not turns
        if (np.mean(driven[rows]) > 0.3 and stays) or flat in lost:
            begin, end = (data.in_seconds(data.t_output[k]) for k in (flat.first, flat.last))
            late = ", or the input was logged ahead of the output" if flat.first == 0 else ""
            at_first = not np.ptp(data.y[: flat.last + 1])
            why = "static friction held the shaft, it was blocked" if at_first else "the shaft was blocked"
            sentence = (
                f"{data.name}: from {begin} to {end} the output stands still, although the same input moves it at other times: "
                f"{why} or the amplifier off{late}. Leave this stretch out."
            )
            at = data.row_span(flat.first, flat.last)
            return [warning("output-stops", sentence, parameters=("gain", "time_constant"), rows=at)]
    return []


def _runs_down(data: Dataset, quantum: float) -> list[Finding]:
    """Whether a motor that turned evenly under the last input comes to rest while it lasts: what is logged didn't drive it.

    An arm that swings to where it balances doesn't turn evenly before, and a shaft that turns round doesn't stay at rest.
    """
    first = int(stretches_of_input(data)[0][-1])
    speed = smooth_speed(data)[first:]
    goal = data.input_unit in (data.position_unit, data.output_unit)
    if goal or len(speed) < _LONG or data.input_at_output[-1] == 0:
        return []
    usual = float(np.median(speed[len(speed) // 4 : len(speed) // 2]))
    fast = np.flatnonzero(np.abs(speed) > (1 - _SLOW) * abs(usual))
    moving = np.flatnonzero(np.abs(speed) >= _SLOW * abs(usual))
    if not len(fast) or abs(usual) <= _ABRUPT * float(np.percentile(np.abs(smooth_speed(data)), 95)):
        return []
    turning = speed[len(speed) // 4 : fast[-1] + 1]
    rest = len(speed) - 1 - int(moving[-1])
    steps = quantum if data.kind == "position" else quantum * data.sample_time  # how far a shaft goes unseen
    even = 4 * len(turning) > len(speed) and np.ptp(turning) <= _EVEN * abs(usual)
    if even and rest >= _AT_REST and rest * data.sample_time * abs(usual) > _WOULD_GO * steps:
        return [_run_down(data, first + int(fast[-1]), len(data.y) - 1)]
    return []


def _slows_down(data: Dataset) -> Finding | None:
    """The finding on a motor that turned evenly under its one input, and slows down to less than half at the end of the record.

    A ripple, or a pendulum, varies the speed all the time; a supply that weakens takes more than the last quarter for that.
    """
    speed = smooth_speed(data)
    goal = data.input_unit in (data.position_unit, data.output_unit)
    if goal or len(speed) < _LONG or data.u[-1] == 0:
        return None
    usual = float(np.median(speed[len(speed) // 4 : -len(speed) // 4]))
    pace = speed * np.sign(usual)
    fast = np.flatnonzero(pace > (1 - _SLOW) * abs(usual))
    if not len(fast):
        return None
    first = int(fast[-1])
    falls, turning = pace[first:], pace[len(pace) // 4 : first + 1]
    even = 4 * first >= 3 * len(pace) and np.ptp(turning) <= _EVEN * abs(usual)
    if not (even and len(falls) > _FALLS and (np.diff(falls) < 0).all() and falls[-1] < _SLOWED * abs(usual)):
        return None
    if not _pace_before_last(data, usual) < (1 - _SLOW) * abs(usual):
        return None  # one false value at the end is no motion
    unit = data.output_unit if data.kind == "speed" else f"{data.position_unit}/s"
    before, after = (with_unit(each, unit, 2) for each in (usual, float(speed[-1])))
    begins, level = data.in_seconds(data.t_output[first]), with_unit(float(data.u[-1]), data.input_unit, 3)
    sentence = (
        f"{data.name}: after {begins} the motor slows down from {before} to {after}, although the input stays at {level}: the "
        f"driver was switched off, or something brakes the shaft. Use only the rows up to {begins}."
    )
    rows = data.row_span(first, len(data.y) - 1)
    return warning("output-stops", sentence, parameters=("gain", "time_constant"), rows=rows)


def _pace_before_last(data: Dataset, usual: float) -> float:
    """The speed in the direction of the `usual` one that the record ends with if its last sample is left out."""
    if data.kind == "speed":
        return float(data.y[-2] * np.sign(usual))
    earlier = len(data.y) - 2 - smoothing_span(data) // 2
    way, time = data.y[-2] - data.y[earlier], data.t_output[-2] - data.t_output[earlier]
    return float(way / time * np.sign(usual))


def _run_down(data: Dataset, first: int, last: int) -> Finding:
    level = with_unit(float(data.input_at_output[last]), data.input_unit, 3)
    sentence = (
        f"{data.name}: after {data.in_seconds(data.t_output[first])} the motor slows down to rest, although the input stays at "
        f"{level}, which moved it before: the driver was switched off or the shaft blocked. Leave these rows out."
    )
    at = data.row_span(first, last)
    return warning("output-stops", sentence, parameters=("gain", "time_constant", "delay"), rows=at)


def _may_turn_within(data: Dataset, flat: _Flat, quantum: float) -> bool:
    """Whether a shaft may have turned round in the middle of a flat of time t: at an acceleration a it goes a t²/8 either way."""
    time = (flat.last - flat.first) * data.sample_time
    return _quickest(data) * time**2 / 8.0 <= _TURNS_WITHIN * quantum


def _way_held_back(data: Dataset, driven: Array, fastest: float) -> float:
    """The way that a shaft would have gone in a flat in which it was `driven` (N,) to and fro (1 and -1) or not at all (0).

    At its usual speed; under an input that only comes on at the end of the flat it has to set off first, after a delay.
    """
    off = np.flatnonzero(driven != driven[-1])
    late = len(driven) - 1 - int(off[-1]) if len(off) and driven[-1] else 0
    time = max(late - _LATE, 0) * data.sample_time
    way = min(fastest * time, 0.5 * _quickest(data) * time**2)
    return abs(float(np.sum(driven[: len(driven) - late]))) * data.sample_time * fastest + way


def _quickest(data: Dataset) -> float:
    """The largest acceleration of the output that its smoothed speed shows, over as many samples as that is smoothed over."""
    across = smoothing_span(data)
    speed = smooth_speed(data)
    return float(np.abs(speed[across:] - speed[:-across]).max()) / (across * data.sample_time)


def _without_effect(data: Dataset, u: Array, flats: list[_Flat], quantum: float) -> list[_Flat]:
    """The flats in which a pulse had no effect until the next one came, as strong as those that moved the shaft far."""
    edges = np.flatnonzero(np.diff(np.sign(u), prepend=0.0, append=0.0))
    pulses = [(int(a), int(b)) for a, b in pairwise(edges) if u[a] != 0]
    if len(pulses) < 2:
        return []
    starts = np.array([a for a, _ in pulses])
    nexts = np.append(starts[1:], starts[-1] + int(np.median(np.diff(starts))))
    # In the first sample under the next pulse the shaft may move already.
    stood = [
        _flat_of(a, max(b + _SHORTEST, int(n) - 1), flats) for (a, b), n in zip(pulses, nexts, strict=True)
    ]
    moved = np.array([flat is None for flat in stood])
    if not moved.any():
        return []
    area = np.array([abs(float(u[a:b].sum())) for a, b in pulses])
    enough = 0.9 * float(np.quantile(area[moved], 0.8))
    position = data.y if data.kind == "position" else np.cumsum(data.y) * data.sample_time
    way = np.abs(position[np.minimum(nexts, len(u) - 1)] - position[starts])
    if not np.median(way[moved & (area >= enough)]) > _FEW * quantum:
        return []  # pulses so small that a coarse sensor may miss one
    return [flat for flat, size in zip(stood, area, strict=True) if flat is not None and size >= enough]


def _flat_of(first: int, end: int, flats: list[_Flat]) -> _Flat | None:
    """The flat in which samples `first` to `end` lie, if there is one."""
    return next((flat for flat in flats if flat.first <= first and end <= flat.last), None)


DOUBTS.member("flats")(
    Doubt(codes=("motion-too-small", _STILL, "output-clipped", "output-stops"), about_data=_about)
)
