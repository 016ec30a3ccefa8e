"""The stretches of a closed loop's record in which the shaft moves.

A loop brings the shaft to its set point, where friction holds it while the integral part grows until the shaft slips by a few
counts. Effects too small to measure decide when it slips: a fraction of a count, a tiny torque. A simulation that misses one
slip is off for the rest of the record. In the meantime the controller only responds to the shaft. So the rests contain almost
no information on friction and none on gain and time constant, but they would dominate a fit. This doesn't happen in open loop,
where the input determines when the shaft starts.

Nor does it happen if the voltage jumps with the reference and the shaft starts at once. This start determines the delay. During
the motion that follows, the reference is constant, and a proportional law acts as kp (r - θ(t - d)). By algebra, with θ(t - d)
= θ - d ω to first order,

    τ ω' = -(1 - K kp d) ω + K (kp (r - θ) - u₀ - u_c sgn ω)

which determines K/τ and (1 - K kp d)/τ, two numbers for the three unknowns K, τ and d. So a stretch that begins with a jump
includes some of the rest before it. Beginning at the jump isn't enough: an unknown start speed couldn't be separated from the
effect of the first milliseconds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, info, warning
from servobench.core.runs import runs
from servobench.recordings.measurement.base import Mask
from servobench.recordings.measurement.dataset import Dataset

_SLOW = 0.05  # of the top speed: below that friction decides about standing or moving
_QUANTA = 40.0  # in a step of the top speed: then what is slow is at least two of them
_RESTS = 0.02  # of the record: with less, the shaft only turns round
_SHORTEST = 20  # samples in a stretch; two start states are found from each
_REST = 20  # samples before a jump, if the shaft stands so long: time for friction to make sure of it
_AT_ONCE = 0.5  # of the change: less isn't a jump
_STANDS = 0.01  # of a jump: what hardly moves before it stands
_TRAVEL = 0.1  # of the record's range: a slip to and fro about the set point isn't a motion


def stretches_of_motion(records: Sequence[Dataset]) -> tuple[tuple[Dataset, ...], list[Finding]]:
    """Return the records, each that rests a good part of a closed loop as its stretches of motion, and what was left out.

    A stretch is a record of its own, and begins and ends while the shaft turns at 5 % of its top speed or faster. A record in
    open loop, of a speed or behind a chain comes back whole, and so does one without two such stretches.
    """
    stretches: list[Dataset] = []
    findings = []
    for data in records:
        parts = _stretches(data)
        stretches += parts or (data,)
        if parts:
            findings.append(_finding(data, parts))
    return tuple(stretches), findings


def _stretches(data: Dataset) -> tuple[Dataset, ...]:
    """The stretches of motion; none where the record is better left whole."""
    if not data.closed_loop or data.kind != "position" or data.chain.linear or len(data.y) < 4 * _SHORTEST:
        return ()
    span = _span(data)
    bounds = [
        (_set_off(data, first, 2 * span + _SHORTEST), last)
        for first, last in _runs(_quick(data, span), 2 * span)
        if last - first >= _SHORTEST and np.ptp(data.y[first:last]) > _TRAVEL * np.ptp(data.y)
    ]
    moving = sum(last - first for first, last in bounds)
    if len(bounds) < 2 or moving > (1 - _RESTS) * len(data.y):
        return ()
    end = np.append(data.t_output, np.inf)
    return tuple(data.part(float(data.t_output[first]), float(end[last])) for first, last in bounds)


def _span(data: Dataset) -> int:
    """The least number of samples in which the shaft goes by enough quanta at its top speed."""
    span, limit = 1, max(1, len(data.y) // 20)
    while span < limit and _top(data.y[span:] - data.y[:-span]) < _QUANTA * (data.quantum or 0.0):
        span += 1
    return span


def _top(moved: Array) -> float:
    return float(np.percentile(np.abs(moved), 95))


def _quick(data: Dataset, span: int) -> Mask:
    """The samples in a span that the motor passes quickly, all of it (M,)."""
    speed = (data.y[span:] - data.y[:-span]) / (data.t_output[span:] - data.t_output[:-span])
    quick = np.abs(speed) > _SLOW * _top(speed)
    inside = np.ones(len(data.y), dtype=bool)
    for k in range(span + 1):
        inside[k : len(quick) + k] &= quick
    inside[:span] = inside[len(quick) :] = False
    return inside


def _runs(quick: Mask, pause: int) -> list[tuple[int, int]]:
    """The first sample of each run and the one behind its last; a pause no longer than that, as of a reversal, is bridged."""
    bridged: list[tuple[int, int]] = []
    for first, last in runs(quick):
        if bridged and first - bridged[-1][1] <= pause:
            bridged[-1] = (bridged[-1][0], last)
        else:
            bridged.append((first, last))
    return bridged


def _set_off(data: Dataset, first: int, reach: int) -> int:
    """The sample with which a stretch begins: in the rest before the jump that sets the shaft off, else `first` itself.

    A jump is at most `reach` samples before `first`. Reference and input both stood before it, and it is most of what they do
    until then: a law that takes the reference into its integral alone doesn't jump, and while an integral gathers, when
    friction lets the shaft slip is chance.
    """
    if data.reference is None:
        return first
    window = np.searchsorted(data.t_input, data.t_output[[max(first - reach, 0), first]], side="right")
    changes = np.flatnonzero(np.diff(data.reference[window[0] - 1 : window[1]])) + window[0]
    if not len(changes) or not all(
        _jumps(each[: window[1]], int(changes[0])) for each in (data.reference, data.u)
    ):
        return first
    jump = int(np.searchsorted(data.t_output, data.t_input[changes[0]]))
    before = data.y[max(jump - _REST, 0) : jump + 1]
    moved = np.flatnonzero(np.abs(before - before[-1]) > 0.5 * (data.quantum or np.inf))
    return jump - len(before) + 1 + (int(moved[-1]) + 1 if len(moved) else 0)


def _jumps(x: Array, at: int) -> bool:
    """Whether what stood until then is at once, with sample `at`, where it goes most of the way to."""
    if at < _REST:
        return False
    before, steps = x[at - _REST : at], np.abs(x[at:] - x[at - 1])
    return bool(np.ptp(before) <= _STANDS * steps[0] and steps[0] >= _AT_ONCE * steps.max())


def doubt_rests(finding: Finding) -> Finding:
    """Return the finding on rests that were left out, for a shaft that something random moves besides its input.

    Of the twin in eight loops, 7 of 192 intervals were more than three standard deviations off under a random torque, one of them
    35; without one 152 of 159 held the truth.
    """
    sentence = (
        f"{finding.sentence} More than the noise of the sensor is left over there: if a random torque decides when the shaft "
        "slips, the controller responds to that, and the intervals may be too narrow. Record a run in open loop."
    )
    return warning(finding.code, sentence)


def _finding(data: Dataset, parts: Sequence[Dataset]) -> Finding:
    share = sum(len(part.y) for part in parts) / len(data.y)
    return info(
        "rests-left-out",
        f"{data.name}: the shaft stands or creeps near its set point in {100 * (1 - share):.0f} % of the record, where its "
        f"controller waits for friction to let it slip. Only the {len(parts)} stretches in which the shaft moves were fitted.",
    )
