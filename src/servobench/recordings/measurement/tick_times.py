"""When a sample was latched and a voltage written, from the recorded times."""

from __future__ import annotations

import numpy as np

from servobench.core.channels import Array
from servobench.recordings.measurement.hold_times import hold_times
from servobench.recordings.measurement.two_clocks import in_device_time
from servobench.recordings.recording import Recording


def write_times(recording: Recording, t: Array) -> Array | None:
    """Return when the device had taken the inputs of times t (N,) [s]; None where a recording doesn't have it of all of them.

    A loop that notes it has a channel `written` [s], in the count of the samples' times. Where the device keeps the time it is in
    the host's count, and is carried over into the device's by when each sample was `received`; what the device itself says of a
    voltage (`held_since`) goes before. Where such a device states a delay it puts voltages out by its own clock: each acts that
    long after its sample, however late it was written. Of a device in virtual time it says nothing: there a voltage acts at its
    sample, however long the computer took.
    """
    if _device_keeps_time(recording):
        reported = _device_hold_times(recording, t)
        values = _to_device_time(recording, "written", t) if reported is None else reported
    else:
        values = _values_at("written", recording, t)
    usable = values is not None and bool(np.all(values >= t)) and bool(np.all(np.diff(values) > 0))
    return values if usable else None


def latch_times(recording: Recording, t: Array) -> Array | None:
    """Return when the device latched the samples of times t (M,) [s]: when the loop asked for them, or later.

    A device that keeps the host's time says it in a channel `latched` [s], in a count that began at another time. A sample can't
    be
    latched before it's asked for, so the smallest distance of the two counts counts as their difference: what is left
    unknown is the shortest time that an asking took. Where some sample would then have been latched after the voltage
    that answers to it, or the times don't increase, the device's count is no such clock: None, as where there is none.
    """
    device, done = _values_at("latched", recording, t), write_times(recording, t)
    if device is None or done is None or not len(t):
        return None
    values = device - float(np.min(device - t))
    usable = bool(np.all(values < done)) and bool(np.all(np.diff(values) > 0))
    return values if usable else None


def host_delay(recording: Recording, t: Array) -> float:
    """Return how much too short a delay may be on average [s], as the time within a call at which the device acts isn't known.

    With the times t (N,) [s] of the samples: as long as it took to write, where the loop noted when it handed each voltage over
    and the device when it latched, or else from sample to voltage. 0 where a recording has no times of writing.
    """
    done = write_times(recording, t)
    if done is None or (_device_keeps_time(recording) and _device_hold_times(recording, t) is not None):
        return 0.0
    if _device_keeps_time(recording):
        handed = _to_device_time(recording, "handed", t)
    else:
        handed = None if latch_times(recording, t) is None else _values_at("handed", recording, t)
    return float(np.median(done - (t if handed is None else handed)))


def _device_keeps_time(recording: Recording) -> bool:
    return recording.info is not None and recording.info.timing == "device"


def _to_device_time(recording: Recording, name: str, t: Array) -> Array | None:
    """A channel of the host's times (N,) [s], in the count of a device that keeps the time; None where it has no part in it."""
    host, received = _values_at(name, recording, t), _values_at("received", recording, t)
    if host is None or received is None or (recording.info is not None and recording.info.delay > 0):
        return None
    return in_device_time(host, received, t)


def _device_hold_times(recording: Recording, t: Array) -> Array | None:
    """The times (N,) [s] at which each voltage began to hold, by a device that keeps the time and reports it; None otherwise."""
    handed = _to_device_time(recording, "handed", t)
    held_since, put = _at(recording, "held_since", t), _at(recording, "applied", t)
    if handed is None or held_since is None or put is None:
        return None
    return hold_times(put, handed, held_since, t)


def _values_at(name: str, recording: Recording, t: Array) -> Array | None:
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
