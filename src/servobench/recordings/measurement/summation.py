"""Counts that were differenced into a speed, summed back: the inverse of `derivative`, and of a filter if that is exact."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from servobench.core.channels import Array
from servobench.core.units import unit
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset, keep_with_data
from servobench.recordings.measurement.derivative import Derivative
from servobench.recordings.measurement.ema import Ema
from servobench.recordings.measurement.grid import grid_step, last_decimal
from servobench.recordings.measurement.lowpass import Lowpass
from servobench.recordings.measurement.unnamed_ema import decays

_FEWEST = 20  # samples
_REGULAR = 0.01  # of the sample time; a speed over two samples is summed at regular times only
_LOST = 1.5  # sample times between rows: one is missing, and its counts aren't known
_OFF = 0.05  # of a count; what printing with a few digits leaves
_SHARP = 1e-6  # of a quantum, below the standard deviation of any gain of a real motor
_CHANCE = (
    0.1  # counts in a turn that are open: the chance that a whole number is among them although there is none
)
_GRID = 3.0  # errors of half a digit: one and a half of the print's own steps
# Of the quantum, that the digits leave open. A count of 4.008 rpm is one of 4 in whole rpm, as long as there are few of them;
# where less is open, a quantum that is round in print and makes a whole number of counts in a turn is seldom a gear's.
_COINCIDENCE = 0.005
_OPEN = 1.0  # counts in a turn that are open where a power of two is among them
_SAME = 1e-9  # of the range, or of a number: what differs less is the same value, computed in two ways
_PRINTED = (
    0.02  # of the usual distance: what differs less is the same value, printed with its last digit up or down
)
_ENOUGH = 20_000  # rows that show the weight of an average
_FEW = 20  # different numbers of counts in an interval, of a slow encoder


@dataclass(frozen=True, kw_only=True, eq=False)
class Summation:
    """A position in counts, as a dataset, that a speed may have been made of, and `how` the speed was made of it, in words.

    `by_counts` says that the lattice shows that it was, if there is a motor behind it: no converter's steps are whole numbers
    behind an average, but the levels of an input are, behind the motor itself.
    """

    data: Dataset
    how: str
    by_counts: bool = False


def summations(data: Dataset) -> Iterator[Summation]:
    """Yield the positions in counts whose difference a speed may be, the likeliest first; none where it lies on no lattice.

    A difference of counts over m samples, v[k] = Q (n[k] - n[k-m])/(t[k] - t[k-m]), is a whole number of quanta Q for each
    interval, so that n follows exactly from rounding, up to where it starts: no error accumulates. m is 1 or, at regular
    times, 2 (as of a central difference). First, a declared low-pass is undone: its output follows its input by
    y[k] = a y[k-1] + b x[k] + c x[k-1], and x lies on a lattice again only if a, b and c were those.
    All of it follows from the definition of a difference, and of the stages `derivative`, `lowpass` and `ema`.
    A lattice doesn't prove an encoder: a converter's steps or printed digits make one, too. Whether a sum is a position shows
    in how well a motor explains it.
    """
    steps = np.diff(data.t_output)
    if data.kind != "speed" or data.applied or len(data.y) < _FEWEST:
        return
    if steps.max() <= _LOST * data.sample_time:
        yield from _plainly(data, steps)
    if not data.declared and not data.chain_known and not _lies_on_a_lattice(data, steps):
        # Of a row that is missing the average has less left than of the others, so that its counts are no whole number.
        yield from _without_unnamed_ema(data, steps)


def _plainly(data: Dataset, steps: Array) -> Iterator[Summation]:
    """The sums of a speed without a filter, or before the one that is declared."""
    regular = bool(np.ptp(steps) < _REGULAR * data.sample_time)
    for speed, reach, how in _undo_filter(data):
        if reach == 1:
            yield from _once(data, speed[1:] * steps[: len(speed) - 1], how)
            if regular:
                yield from _central(data, 2.0 * data.sample_time * speed, how)
        elif regular:
            yield from _backward(data, data.sample_time * speed, how)


def _undo_filter(data: Dataset) -> Iterator[tuple[Array, int, str]]:
    """The speed before its declared filter, over how many samples it is a sum, and what was undone, in words."""
    stages = data.declared.linear.stages
    if stages and isinstance(stages[0], Derivative):
        stages = stages[1:]
    if not stages:
        yield data.y, 1, ""
    elif len(stages) == 1 and isinstance(stages[0], Lowpass):
        yield from _without_lowpass(data, stages[0])
    elif len(stages) == 1 and isinstance(stages[0], Ema):
        decay = stages[0].decay(np.diff(data.t_output))
        newest = (data.y[1:] - decay * data.y[:-1]) / (1.0 - decay)
        yield np.append(0.0, newest), 1, f", after `{stages[0]}` was undone"


def _without_lowpass(data: Dataset, stage: Lowpass) -> Iterator[tuple[Array, int, str]]:
    """The input of a low-pass, by the recursion that it is declared to be and by a step of backward Euler."""
    how = f", after `{stage}` was undone"
    h = stage.cutoff * np.diff(data.t_output)
    y, before = data.y[1:], data.y[:-1]
    first = np.zeros(
        1
    )  # the sample before the first one isn't known; the first value of a speed isn't summed
    if stage.discretisation == "tustin":
        both = ((1.0 + 0.5 * h) * y - (1.0 - 0.5 * h) * before) / (0.5 * h)
        yield np.concatenate([first, both]), 2, how  # x[k] + x[k-1]
    else:
        decay = np.exp(-h) if stage.discretisation == "zoh" else 1.0 - h
        # This is x[k-1]: the last value has left no trace in y.
        yield (y - decay * before) / (1.0 - decay), 1, how
    for decay in (1.0 / (1.0 + h), np.exp(-h), 1.0 - h):
        # y[k] = y[k-1] + (1 - a)(x[k] - y[k-1]), the usual line of a firmware, which acts on the new sample at once.
        yield np.concatenate([first, (y - decay * before) / (1.0 - decay)]), 1, how


def _without_unnamed_ema(data: Dataset, steps: Array) -> Iterator[Summation]:
    """The sum of what an exponential average was taken of that nobody named, where the speed shows its weight."""
    for decay, quantum in decays(data.y[:_ENOUGH], steps[: _ENOUGH - 1], _step):
        newest = (data.y[1:] - decay * data.y[:-1]) / (1.0 - decay)
        error = (1.0 + decay) / (1.0 - decay) * _half_a_digit(data) * float(steps.max())
        counts_and_quantum = whole_counts(newest * steps, data.position_unit, error, quantum)
        if counts_and_quantum is not None:
            weight = f"{1.0 - decay:.2g}"
            how = f"from sample to sample, after an exponential average that weighs the newest sample by {weight} was undone"
            counts, quantum = counts_and_quantum
            summed = np.append(0.0, np.cumsum(counts))
            yield Summation(data=_position(data, summed, quantum), how=how, by_counts=True)
            return


def _lies_on_a_lattice(data: Dataset, steps: Array) -> bool:
    """Whether a speed, or what it makes of the time between rows, is a multiple of one step that isn't the print's.

    No average is, but what one with a weight of 1/m would have been of is, as m y[k] - (m - 1) y[k-1] is a whole number then.
    """
    print_step = _GRID * _half_a_digit(data)
    own, counted = _step(data.y), _step(data.y[1:] * steps)
    return (own is not None and own > print_step) or (
        counted is not None and counted > print_step * data.sample_time
    )


@keep_with_data
def _half_a_digit(data: Dataset) -> float:
    """Half of the last digit that a speed was recorded with, in its SI unit; 0 where it has all digits, or none is known."""
    if not data.recorded_unit:
        return 0.0
    factor = unit(data.recorded_unit).factor
    digit = last_decimal(data.y / factor)
    return 0.0 if digit is None else 0.5 * digit * factor


def _once(data: Dataset, increments: Array, how: str) -> Iterator[Summation]:
    """The sum of differences between neighbouring samples."""
    counts_and_quantum = whole_counts(increments, data.position_unit, _half_a_digit(data) * data.sample_time)
    if counts_and_quantum is not None:
        counts, quantum = counts_and_quantum
        summed = np.concatenate([np.zeros(1), np.cumsum(counts)])
        yield Summation(data=_position(data, summed, quantum), how=f"from sample to sample{how}")


def _central(data: Dataset, increments: Array, how: str) -> Iterator[Summation]:
    """The sum of differences between the next sample and the one before."""
    error = 2.0 * data.sample_time * _half_a_digit(data)
    counts_and_quantum = whole_counts(increments[1:-1], data.position_unit, error)
    if counts_and_quantum is not None:
        counts, quantum = counts_and_quantum
        yield Summation(
            data=_position(data, _interleave(counts), quantum),
            how="from the sample before to the next one (if it was taken over the last two instead, the delay is "
            f"{data.sample_time:.3g} s smaller){how}",
        )


def _backward(data: Dataset, increments: Array, how: str) -> Iterator[Summation]:
    """The sum of differences over the last two samples."""
    counts_and_quantum = whole_counts(increments[2:], data.position_unit)
    if counts_and_quantum is not None:
        counts, quantum = counts_and_quantum
        yield Summation(data=_position(data, _interleave(counts), quantum), how=f"from sample to sample{how}")


def whole_counts(
    increments: Array, symbol: str, error: float = 0.0, step: float | None = None
) -> tuple[Array, float] | None:
    """Return whole numbers n (N,) and the quantum Q with increments (N,) = n Q to a twentieth of Q; None where there is none.

    Digits that were left out of the print put each increment off by an `error` at most, and leave Q open by a part of it; a Q of
    one such digit is the print's own. An encoder has a whole number of counts in a turn (`symbol` rad), and a count is 1
    (`symbol` counts); where neither decides, and Q is open by more than a millionth, there is None, too: the gain would be wrong
    by as much, whatever its interval says. `step` is Q as far as it is known already.
    """
    quantum = _step(increments) if step is None else step
    if quantum is None:
        return None
    for _ in range(2):
        counts = np.rint(increments / quantum)
        quantum = float(np.abs(increments).sum() / np.abs(counts).sum())
    off = float(np.abs(increments - counts * quantum).max())
    if off > _OFF * quantum or quantum < _GRID * error:
        return None
    low, high = _open(np.abs(increments), np.abs(counts), off)
    exact = _exact(low, high, symbol)
    if error > off:
        low, high = _open(np.abs(increments), np.abs(counts), error)
        if exact is None or high - low > _COINCIDENCE * quantum:
            exact = _exact(low, high, symbol)
    if exact is None and high - low > _SHARP * quantum:
        return None
    return counts, exact or quantum


def _open(sizes: Array, counts: Array, off: float) -> tuple[float, float]:
    """The least and the largest quantum with which no increment is off by more than a tenth above what the worst one is."""
    moved = counts > 0
    bound = 1.1 * off
    return float(np.max((sizes[moved] - bound) / counts[moved])), float(
        np.min((sizes[moved] + bound) / counts[moved])
    )


def _exact(low: float, high: float, symbol: str) -> float | None:
    """The quantum of a whole number of counts in a turn, or of one count, that is the only one between low and high.

    Where they are too far apart for any whole number to be a proof, a power of two is, which no gear makes by chance.
    """
    if symbol == "counts":
        return 1.0 if low <= 1.0 <= high else None
    if symbol != "rad" or not low > 0:
        return None
    fewest, most = 2.0 * np.pi / high, 2.0 * np.pi / low
    whole = np.rint(fewest) if abs(fewest - np.rint(fewest)) < _SAME * fewest else np.ceil(fewest)
    if whole <= most * (1.0 + _SAME) and most < fewest + _CHANCE:
        return float(2.0 * np.pi / whole)
    power = 2.0 ** np.rint(np.log2(fewest))
    return float(2.0 * np.pi / power) if fewest <= power <= most < fewest + _OPEN else None


def _step(increments: Array) -> float | None:
    """The step of the grid that the increments and 0 lie on, as found; a few values are all that a slow encoder has."""
    alike = _merge_close(np.append(increments, 0.0))
    step = grid_step(alike)
    if step is not None:
        return step
    values = np.unique(alike)
    return float(np.diff(values).min()) if 1 < len(values) <= _FEW else None


def _merge_close(x: Array) -> Array:
    """Values x (N,), those that differ in the last printed digit alone made alike: the one that is nearest to 0 for each."""
    for share in (_SAME, _PRINTED):
        values, place = np.unique(x, return_inverse=True)
        steps = np.diff(values)
        if len(steps):
            apart = steps > share * (values[-1] - values[0] if share == _SAME else np.median(steps))
            group = np.concatenate([[0], np.cumsum(apart)])
            nearest = np.full(group[-1] + 1, np.inf)
            for value, number in zip(values, group, strict=True):
                if abs(value) < abs(nearest[number]):
                    nearest[number] = value
            x = nearest[group[place]]
    return x


def _interleave(differences: Array) -> Array:
    """The counts n (N + 2,) with n[k+2] - n[k] = differences (N,), n[0] = 0 and n[1] such that odd and even samples fit best."""
    counts = np.zeros(len(differences) + 2)
    counts[2::2] = np.cumsum(differences[::2])
    counts[3::2] = np.cumsum(differences[1::2])
    between = counts[1:-1] - 0.5 * (counts[:-2] + counts[2:])
    # Where the odd samples stand too high by a, they are that much above the line between their neighbours, and even ones below.
    signs = np.where(np.arange(1, len(counts) - 1) % 2 == 1, 1.0, -1.0)
    counts[1::2] -= np.rint(np.mean(signs * between))
    return counts


def _position(data: Dataset, counts: Array, quantum: float) -> Dataset:
    """The dataset with its output in the middle of counts (K,), which may end before the speed does."""
    return replace(
        data,
        t_output=data.t_output[: len(counts)],
        current=None if data.current is None else data.current[: len(counts)],
        rows=None if data.rows is None else data.rows[: len(counts)],
        y=(counts + 0.5) * quantum,
        kind="position",
        output_unit=data.position_unit,
        quantum=quantum,
        declared=Chain(),
        chain_known=True,
    )
