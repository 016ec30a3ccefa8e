"""A motor with friction that falls with the speed, differs by direction and grows with load, and gravity, in steps of 10 µs.

The truth that the nonlinear structures are held against; written from the equations, with the friction rule of a free step
that is braked at most to rest, and not with the events of the models.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from servobench.recordings.measurement.dataset import Dataset
from tests.datasets import QUANTUM, dataset


class OddMotor(NamedTuple):
    """Parameters in volts, radians and seconds; forward is the way a positive voltage drives."""

    gain: float = 23.8
    time_constant: float = 0.1
    coulomb: float = 0.16
    offset: float = 0.0
    delay: float = 0.0
    stribeck: float = 0.0
    stribeck_speed: float = 3.0
    gaussian: float = 0.0
    gravity_sine: float = 0.0
    gravity_cosine: float = 0.0
    load: float = 0.0
    drag_asymmetry: float = 0.0


@numba.njit(cache=True)  # type: ignore[untyped-decorator]
def _march(p, u, sample_time, substeps, angle, kicks, out):  # type: ignore[no-untyped-def]
    gain, tau, coulomb, offset, delay, stribeck, stribeck_speed, gaussian, sine, cosine, load, lopsided = p
    dt = sample_time / substeps
    w, theta = 0.0, angle
    late = round(delay / dt)
    kept = np.exp(-dt / tau)
    for n in range(len(u)):
        out[n, 0], out[n, 1] = theta, w
        for step in range(substeps):
            tick = n * substeps + step - late
            v = u[tick // substeps] if tick >= 0 else 0.0
            # Half a step of the angle, a step of the speed at the angle of the middle, half a step of the angle.
            theta += 0.5 * dt * w
            gravity = sine * np.sin(theta) + cosine * np.cos(theta)
            ratio = abs(w) / stribeck_speed
            falling = np.exp(-(ratio**2)) if gaussian else np.exp(-ratio)
            lost = coulomb + stribeck * falling + load * abs(gravity)
            free = kept * w + (1.0 - kept) * gain * (v - offset - gravity - lopsided * abs(w))
            stop = (1.0 - kept) * abs(gain) * lost
            w = free - min(stop, max(-stop, free))
            theta += 0.5 * dt * w
        if len(kicks) and w != 0.0:
            w += kicks[n]


def marched(
    truth: OddMotor,
    u: NDArray[np.float64],
    sample_time: float,
    angle: float = 0.0,
    step: float = 1e-5,
    kicks: NDArray[np.float64] | None = None,
) -> NDArray[np.float64]:
    """Return angle and speed (N, 2), latched before each input u (N,) acts, from rest at an angle [rad].

    `kicks` (N,) [rad/s] are added to the speed of a shaft that moves, at the end of each sample.
    """
    out = np.empty((len(u), 2))
    random = np.empty(0) if kicks is None else kicks
    _march(tuple(truth), u, sample_time, round(sample_time / step), angle, random, out)
    return out


def odd_record(
    truth: OddMotor,
    seed: int,
    *,
    samples: int = 5000,
    u: NDArray[np.float64] | None = None,
    torque: float = 0.0,
    angle: float = 0.0,
) -> Dataset:
    """Return a record of the motor under ±3 V (or u) behind an ideal encoder of 2048 counts; `torque` kicks it [rad/s, sd]."""
    plain = dataset(seed=seed, kind="prbs", samples=samples, y=np.zeros(samples))
    random = np.random.default_rng(1000 + seed)
    driven = plain.u if u is None else u
    start = angle + random.random() * QUANTUM
    kicks = torque * random.standard_normal(samples) if torque else None
    moved = marched(truth, driven, plain.sample_time, start, kicks=kicks)[:, 0]
    return replace(plain, u=driven, y=(np.floor(moved / QUANTUM) + 0.5) * QUANTUM, name="odd motor")
