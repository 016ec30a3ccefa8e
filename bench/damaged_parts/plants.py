"""Plants that are no motor: simulated in short steps, recorded as a device would."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from damaged_parts.changes import Change, in_place_of
from servobench.recordings.recording import Recording

Array = NDArray[np.float64]
_SUBSTEPS = 10


def pendulum(torque: float) -> Change:
    """Return a motor whose shaft carries a weight: K = 23 rad/(s·V), τ = 0.1 s, and a torque sin θ worth `torque` [V].

    It is simulated with the semi-implicit Euler rule (the speed first), which keeps the energy of an oscillation.
    """

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        u = recording[str(recording.input)].values
        h = float(np.median(np.diff(np.asarray(recording[str(recording.input)].t)))) / _SUBSTEPS
        gain, tau, w, angle = 23.0, 0.1, 0.0, 0.0
        y = np.empty(len(u))
        for k, voltage in enumerate(u):
            y[k] = angle
            for _ in range(_SUBSTEPS):
                w += h / tau * (gain * (voltage - torque * np.sin(angle)) - w)
                angle += h * w
        counts = np.floor(y * 2048 / (2 * np.pi))
        return in_place_of(recording, str(recording.output), counts)

    return changed


def hysteresis(width: float) -> Change:
    """Return a motor behind a valve that plays: what acts follows the input only beyond `width` [V] on either side."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        u = recording[str(recording.input)].values
        acts, now = np.empty(len(u)), 0.0
        for k, voltage in enumerate(u):
            now = min(max(now, voltage - width), voltage + width)
            acts[k] = now
        return driven(recording, acts)

    return changed


def saturated(limit: float) -> Change:
    """Return a motor that gets no more than ±limit [V] of what the record says."""
    return lambda recording, random: driven(
        recording, np.clip(recording[str(recording.input)].values, -limit, limit)
    )


def driven(recording: Recording, u: Array) -> Recording:
    """Return the record of a first-order motor, K = 23 rad/(s·V), τ = 0.1 s, that really got a held input u (N,) [V]."""
    t = np.asarray(recording[str(recording.input)].t)
    h = float(np.median(np.diff(t)))
    gain, tau, w, angle = 23.0, 0.1, 0.0, 0.0
    decay = float(np.exp(-h / tau))
    y = np.empty(len(u))
    for k, voltage in enumerate(u):
        y[k] = angle
        end = gain * voltage
        angle += end * h + (w - end) * tau * (1 - decay)
        w = end + (w - end) * decay
    counts = np.floor(y * 2048 / (2 * np.pi))
    made = in_place_of(recording, str(recording.output), counts)
    return replace(made, series=tuple(s for s in made.series if s.channel.name in (made.input, made.output)))


def relay(share: float) -> Change:
    """Return a limit cycle: a relay of ±3 V on the position, coarse and noisy; `share` of a turn is its amplitude."""

    def changed(recording: Recording, random: np.random.Generator) -> Recording:
        t = np.asarray(recording[str(recording.input)].t)
        h, gain, tau, lost = float(np.median(np.diff(t))), 23.0, 0.1, 0.16
        kicks = 0.5 * np.sqrt(h / _SUBSTEPS) * gain / tau * random.standard_normal((len(t), _SUBSTEPS)) * 0.1
        w, angle, u = 0.0, 0.0, 3.0
        coarse = 2 * np.pi / 100
        y, inputs = np.empty(len(t)), np.empty(len(t))
        for k in range(len(t)):
            y[k] = np.floor(angle / coarse)
            if y[k] * coarse > share * 2 * np.pi:
                u = -3.0
            elif y[k] * coarse < -share * 2 * np.pi:
                u = 3.0
            inputs[k] = u
            for n in range(_SUBSTEPS):
                w += h / _SUBSTEPS / tau * (gain * (u - lost * np.sign(w)) - w) + kicks[k, n]
                angle += h / _SUBSTEPS * w
        made = in_place_of(recording, str(recording.output), y)
        old = made[str(recording.output)]
        new = replace(old, channel=replace(old.channel, counts_per_rev=100.0))
        made = replace(made, series=tuple(new if each is old else each for each in made.series))
        return in_place_of(made, str(recording.input), inputs)

    return changed
