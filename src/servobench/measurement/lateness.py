"""How late the samples of a run were, out of what was recorded of each."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from servobench.channels import Array
from servobench.errors import ExperimentError
from servobench.experiment import Experiment, read_experiment
from servobench.measurement.hold_times import hold_times
from servobench.measurement.two_clocks import in_device_time
from servobench.recording.recording import Recording
from servobench.rounding import counted, microseconds


@dataclass(frozen=True, kw_only=True, eq=False)
class Lateness:
    """How late the samples of the run `name` were [s], and how many ticks were done late or not at all.

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
            f"samples came {p50} µs after their time in the median, {p99} µs in one of a hundred, {p999} µs in one of a "
            f"thousand, {largest} µs at most; {self.late} of {self.samples} were late, and "
            f"{counted(self.missed, 'tick')} missed"
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
        missed=_missed(experiment, series.t, series.values, late),
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
    try:
        return read_experiment(recording.experiment)
    except ExperimentError:  # of another version, or with a signal from a plug-in that isn't here
        return None


def _missed(experiment: Experiment, t: Array, scheduled: Array, late: Array) -> int:
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


def written(recording: Recording, t: Array) -> Array | None:
    """Return when the device had taken the inputs of times t (N,) [s]; None where a recording doesn't have it of all of them.

    A loop that notes it has a channel `written` [s], in the count of the samples' times. Where the device keeps the time it is in
    the host's count, and is carried over into the device's by when each sample was `received`; what the device itself says of a
    voltage (`held_since`) goes before. Where such a device states a delay it puts voltages out by its own clock: each acts that
    long after its sample, however late it was written. Of a device in virtual time it says nothing: there a voltage acts at its
    sample, however long the computer took.
    """
    if _kept_by_device(recording):
        told = _device_hold_times(recording, t)
        values = _carried_over(recording, "written", t) if told is None else told
    else:
        values = _noted("written", recording, t)
    usable = values is not None and bool(np.all(values >= t)) and bool(np.all(np.diff(values) > 0))
    return values if usable else None


def latched(recording: Recording, t: Array) -> Array | None:
    """Return when the device latched the samples of times t (M,) [s], which is when the loop asked for them or later.

    A device that keeps the host's time says it in a channel `latched` [s], in a count that began at another time. A sample can't
    be
    latched before it's asked for, so the smallest distance of the two counts is taken for their difference: what is left
    unknown is the shortest time that an asking took. Where some sample would then have been latched after the voltage
    that answers to it, or the times don't increase, the device's count is no such clock: None, as where there is none.
    """
    device, done = _noted("latched", recording, t), written(recording, t)
    if device is None or done is None or not len(t):
        return None
    values = device - float(np.min(device - t))
    usable = bool(np.all(values < done)) and bool(np.all(np.diff(values) > 0))
    return values if usable else None


def hidden_delay(recording: Recording, t: Array) -> float:
    """Return by how much a delay may be too short because nobody knows when within a call the device did it [s], on average.

    With the times t (N,) [s] of the samples: as long as it took to write, where the loop noted when it handed each voltage over
    and the device when it latched, or else from sample to voltage. 0 where a recording has no times of writing.
    """
    done = written(recording, t)
    if done is None or (_kept_by_device(recording) and _device_hold_times(recording, t) is not None):
        return 0.0
    if _kept_by_device(recording):
        handed = _carried_over(recording, "handed", t)
    else:
        handed = None if latched(recording, t) is None else _noted("handed", recording, t)
    return float(np.median(done - (t if handed is None else handed)))


def _kept_by_device(recording: Recording) -> bool:
    return recording.info is not None and recording.info.timing == "device"


def _carried_over(recording: Recording, name: str, t: Array) -> Array | None:
    """A channel of the host's times (N,) [s], in the count of a device that keeps the time; None where it has no part in it."""
    host, received = _noted(name, recording, t), _noted("received", recording, t)
    if host is None or received is None or (recording.info is not None and recording.info.delay > 0):
        return None
    return in_device_time(host, received, t)


def _device_hold_times(recording: Recording, t: Array) -> Array | None:
    """When each voltage began to hold (N,) [s], by a device that keeps the time and says so; None where it doesn't."""
    handed = _carried_over(recording, "handed", t)
    held_since, put = _at(recording, "held_since", t), _at(recording, "applied", t)
    if handed is None or held_since is None or put is None:
        return None
    return hold_times(put, handed, held_since, t)


def _noted(name: str, recording: Recording, t: Array) -> Array | None:
    """The values of a channel at the times t (N,), all finite; None where it hasn't got them, or time was virtual."""
    if recording.info is not None and recording.info.timing == "virtual":
        return None
    values = _at(recording, name, t)
    return values if values is not None and bool(np.isfinite(values).all()) else None


def _at(recording: Recording, name: str, t: Array) -> Array | None:
    """The values of a channel at the times t (N,); None where it hasn't got them."""
    if name not in recording:
        return None
    series = recording[name]
    if series.t is None or not len(series.t):
        return None
    at = np.minimum(np.searchsorted(series.t, t), len(series.t) - 1)
    return series.values[at] if np.array_equal(series.t[at], t) else None
