"""The lateness of a run's samples, from their recorded times."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from servobench.core.channels import Array
from servobench.core.errors import ExperimentError
from servobench.core.rounding import count_text, microseconds
from servobench.recordings.recording import Recording

if TYPE_CHECKING:
    from servobench.rig.experiment import Experiment


@dataclass(frozen=True, kw_only=True, eq=False)
class Lateness:
    """The lateness of the samples of the run `name` [s], and the numbers of ticks done late or not at all.

    Its nominal `sample_time` is in s. `late` of the `samples` say so themselves, `missed` ticks have none. `by` (N,) is how
    long after its schedule each sample was latched at `t` (N,), both in s; `p50`, `p99`, `p999` and `largest` are the smallest
    lateness that a half, 99 %, 99.9 % and all of them don't exceed. `missed_rule` and `phase_rule` say what was done about
    ticks that had gone by (see `HostClock`).
    """

    name: str
    samples: int
    late: int
    missed: int
    sample_time: float
    p50: float
    p99: float
    p999: float
    largest: float
    missed_rule: str
    phase_rule: str
    t: Array = field(repr=False)
    by: Array = field(repr=False)

    @property
    def sentence(self) -> str:
        """All of it in one sentence, in µs."""
        p50, p99, p999, largest = (microseconds(x) for x in (self.p50, self.p99, self.p999, self.largest))
        return (
            f"samples were late by {p50} µs (median), {p99} µs (99th percentile), {p999} µs (99.9th) and {largest} "
            f"µs (largest); {self.late} of {self.samples} were late, and {count_text(self.missed, 'tick')} missed"
        )


def lateness(recording: Recording) -> Lateness | None:
    """Return how late the samples of a run were.

    Where the host kept the time, of a simulation too, it is the time of each sample less its schedule. Where the device did,
    whose count began at any time and runs at its own pace, it is what is left over a straight line through the samples' times,
    and no less than 0.
    None where no time passed (a run in virtual time), and where nothing tells: in a file of others without `scheduled`, and in
    a run whose experiment can't be read.
    """
    kept_by = recording.info.timing if recording.info else "virtual"
    if "scheduled" not in recording or "late" not in recording:
        return None
    experiment = _experiment(recording)
    series = recording["scheduled"]
    late = recording["late"].values
    if experiment is None or series.t is None or len(series.t) < 2 or len(late) != len(series.t):
        return None
    by = _off_the_line(series.t, series.values) if kept_by == "device" else series.t - series.values
    if kept_by == "virtual" and not by.any():
        return None
    p50, p99, p999, largest = np.quantile(by, (0.5, 0.99, 0.999, 1.0), method="inverted_cdf")
    return Lateness(
        name=recording.name,
        samples=len(by),
        late=int(np.count_nonzero(late)),
        missed=_count_missed(experiment, series.t, series.values, late),
        sample_time=experiment.sample_time,
        p50=float(p50),
        p99=float(p99),
        p999=float(p999),
        largest=float(largest),
        missed_rule=experiment.when_late.missed,
        phase_rule=experiment.when_late.phase,
        t=series.t,
        by=by,
    )


def _experiment(recording: Recording) -> Experiment | None:
    from servobench.rig.experiment import read_experiment  # which a file of others doesn't need

    try:
        return read_experiment(recording.experiment)
    except ExperimentError:  # of another version, or with a signal from a plug-in that isn't here
        return None


def _count_missed(experiment: Experiment, t: Array, scheduled: Array, late: Array) -> int:
    """The ticks between the samples, and before the first: each is due one sample time after the one before.

    Where the phase is lost, that is after the time at which a late one was done. A run that is cut short misses none at its end.
    """
    origin = scheduled[:-1].copy()
    if experiment.when_late.phase == "lose":
        origin = np.where(late[:-1] != 0, t[:-1], origin)
    steps = np.rint((scheduled[1:] - origin) / experiment.sample_time) - 1
    first = round(scheduled[0] / experiment.sample_time)
    return int(first + np.maximum(steps, 0).sum())


def _off_the_line(t: Array, scheduled: Array) -> Array:
    """The times t (N,) less a straight line over the schedule, moved up so that none is below 0."""
    x = scheduled - scheduled.mean()
    y = t - t.mean()
    left = y - x * (float(x @ y) / float(x @ x))
    return np.asarray(left - left.min())
