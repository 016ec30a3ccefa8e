"""An output with steps that are coarse compared with the motion."""

from __future__ import annotations

import numpy as np

from servobench.core.finding import Finding, info, warning
from servobench.core.rounding import plain
from servobench.identification.estimators.base import Fit, FittedRecord
from servobench.identification.models.motion import smooth_speed
from servobench.identification.trust.doubts.base import DOUBTS, Doubt
from servobench.identification.trust.doubts.lattice import lattice_step
from servobench.identification.trust.validation import is_rounding
from servobench.identification.uncertainty.model_error import SOURCE
from servobench.recordings.measurement.dataset import Dataset

_FEWEST = 40.0  # steps in a time constant, or in the range of a speed
# Fewer steps than that in a time constant, at the longest that it may be, and a rounding (a step / √12) is more than 5 % of the
# way: it is no small perturbation of the model any more, which is what the intervals are worked out for. With more, 237 intervals
# of simulated motors that nothing else speaks against lay 0.7 standard deviations off in the root mean square, and none more
# than 2.5.
_SMALL = 1 / (0.05 * 12**0.5)
# With fewer the intervals hold where all that is left over is the rounding: with 1 to 6, 56 records of simulated motors under
# inputs of five kinds, on encoders of 8 to 44 counts, had 162 intervals that lay 0.7 standard deviations off in the root mean
# square, and none more than 2.6; square waves, which are rounded alike in each period, had 31, 1.3 off and none more than 2.4.
# Of 14 records with less than half a step one had a friction 24 of its own off.
_BLIND = 1.0
_UNEVEN = 0.1  # of the median time step: what a clock that is read by a program may vary by anyway
_ALIKE = 1e-3  # of a step: what is left of rounded decimals
# Of a step, noise and rounding together. Then the noise alone is 0.4 of one, and the bias of rounding exp(-2 π² 0.4²) / π,
# 0.0135 of one, at most (Widrow and Kollár 2008).
_DITHERED = 0.5


def _about_fit(fit: Fit) -> list[Finding]:
    """Whether the sensor has few steps in what tells the time constant: the way gone in it, or the range of the speed."""
    fewest, quantum, kind, by_edges = np.inf, 0.0, "position", False
    for record in fit.records:
        data = record.data
        q = data.quantum or lattice_step(data.y)
        if not q or (data.chain and not data.quantum) or _is_dithered(record, q):
            continue
        if data.kind == "position":
            if "time_constant" not in fit.model.names:
                continue
            speed = float(np.percentile(np.abs(smooth_speed(data)), 95))
            estimate = fit["time_constant"]
            # A time constant that is hardly known may be as long as its interval reaches.
            steps = speed * np.nanmin([estimate.value + 2 * estimate.sd, data.duration]) / q
        else:
            low, high = np.percentile(data.y, (1, 99))
            steps = float(high - low) / q
        if steps < fewest:
            fewest, quantum, kind, by_edges = steps, q, data.kind, is_sampled_by_edges(data, q)
    if not fewest < _FEWEST:
        return []
    unit = fit.records[0].data.output_unit
    where = "while the motor accelerates" if kind == "position" else "over the whole range of the speed"
    model_error = any(line.source == SOURCE for line in fit.budget)
    # What has a time for each step isn't rounded.
    enough = _SMALL if kind == "position" and not is_rounding(fit) else _BLIND
    allowed_for = by_edges or (fewest >= enough if kind == "position" else model_error)
    by = "and the intervals allow for it" if allowed_for else "perhaps by more than their intervals"
    sentence = (
        f"Each row is one step of the sensor, {plain(quantum, 3)} {unit}, at a time of its own, so the times tell the motion, "
        f"and how finely they are logged limits it. There are only {plain(fewest, 2)} steps {where}; a sensor with more of them, "
        "or a longer record, narrows the time constant down."
        if by_edges
        else f"The sensor is coarse: its steps are {plain(quantum, 3)} {unit}, only {plain(fewest, 2)} of them {where}. "
        f"Its rounding isn't random and shifts the time constant and the friction, {by}; a finer "
        "sensor or a longer record reduces that."
    )
    say = info if allowed_for else warning
    return [say("resolution-coarse", sentence, parameters=("time_constant", "coulomb_voltage"))]


def _is_dithered(record: FittedRecord, quantum: float) -> bool:
    """Whether noise from sample to sample spreads readings over the steps of their sensor, so that rounding becomes random."""
    changes = np.diff(record.residual[record.valid])
    sd = float(np.median(np.abs(changes))) / 0.6745 / np.sqrt(2.0)
    return not is_sampled_by_edges(record.data, quantum) and sd >= _DITHERED * quantum


def is_sampled_by_edges(data: Dataset, quantum: float) -> bool:
    """Return whether a position has a row for each step of its sensor, a `quantum` [its unit], at times that are uneven.

    A sensor that is read at even times steps by none or by several in some rows, unless the motor turns very evenly.
    """
    steps, times = np.abs(np.diff(data.y)), np.diff(data.t_output)
    uneven = len(times) > 0 and np.ptp(times) > _UNEVEN * float(np.median(times))
    return bool(data.kind == "position" and uneven and np.allclose(steps, quantum, rtol=_ALIKE, atol=0.0))


def is_coarse(fit: Fit) -> bool:
    """Return whether the sensor has too few steps to show what tells the time constant."""
    return bool(_about_fit(fit))


DOUBTS.member("resolution")(Doubt(codes=("resolution-coarse",), about_fit=_about_fit))
