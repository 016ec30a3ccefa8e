"""An input that the output itself switches: a relay, and the limit cycle that it makes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.core.finding import Finding, warning
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.recordings.measurement.dataset import Dataset

_SWITCHES = 20
_ALIKE = 0.25  # of the way gone in a cycle: how near the output comes to where it was when the input switched last time
_EVEN = 2.0  # sample times: an input of its own switches in even times, to a sample
_LEVELS = 3
_CLOCKED = (
    0.9  # of the spans between switches are whole numbers of the shortest, where a PRBS's clock switches
)


def _about(records: Sequence[Dataset]) -> list[Finding]:
    return [finding for record in records for finding in _of(record)]


def _of(data: Dataset) -> list[Finding]:
    """Whether an input of a few levels switches where the output was when it switched before, at times that no clock makes."""
    levels = np.unique(data.u)
    if data.kind != "position" or len(levels) > _LEVELS or levels[0] * levels[-1] >= 0:
        return []
    high = data.u > 0
    switches = np.flatnonzero(np.diff(high.astype(np.int8))) + 1
    if len(switches) < _SWITCHES:
        return []
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(data.y)))])
    y = np.interp(data.t_input[switches], data.t_output, data.y)
    gone = np.interp(data.t_input[switches], data.t_output, way)
    # From a switch to the next one in the same direction.
    cycles = np.abs(y[2:] - y[:-2]) / np.maximum(gone[2:] - gone[:-2], 1e-300)
    spans = np.diff(data.t_input[switches])
    even = np.ptp(np.percentile(spans, (10, 90))) <= _EVEN * data.sample_time
    if even or _has_a_clock(spans, _EVEN * data.sample_time) or np.percentile(cycles, 80) > _ALIKE:
        return []
    sentence = (
        f"{data.name}: the input switches whenever the output reaches the same values, as with a "
        "relay: the motion is a limit cycle of nearly one frequency. It can't separate gain, time "
        "constant and friction, however good the fit looks; drive the motor with steps or a PRBS "
        "that don't depend on the output."
    )
    return [warning("limit-cycle", sentence, parameters=("gain", "time_constant", "coulomb_voltage"))]


def _has_a_clock(spans: Array, off: float) -> bool:
    """Whether times (N,) are whole numbers of one time, but for being `off`: those of a PRBS's bits, which no output makes."""
    times = np.rint(spans / spans.min())
    # What the shortest is off by counts as often as it fits into the longer ones; that of all together is off by less.
    times = np.rint(spans / float(np.median(spans / times)))
    clock = float(spans.sum() / times.sum())
    return bool(clock > 2.0 * off and np.mean(np.abs(spans - times * clock) <= off) >= _CLOCKED)


DOUBTS.member("limit_cycle")(Doubt(codes=("limit-cycle",), about_data=_about))
