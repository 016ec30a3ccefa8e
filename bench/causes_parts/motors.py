"""Plain first-order motors over the range that people own: nothing is wrong with them but friction, noise and an encoder.

    τ ω' + ω = K (u(t - d) - u_c sgn ω + v),   v a random voltage that holds for a quarter of a sample

From one change of the input to the next the speed is an exponential, and a stop is met exactly. No part of this shares code with
the package: whatever is said to be wrong with these motors is made up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source

Array = NDArray[np.float64]

_PARTS = 4  # of a sample, in which a random voltage holds
_MOST = 20_000  # samples
_FASTEST = 2500.0  # rad/s, the top speed without friction: 24,000 rpm
_DELAYS = (0.0, 1.0, 2.0, 3.0)  # samples, between which the delay is drawn


@dataclass(frozen=True, kw_only=True)
class PlainMotor:
    """One motor and how it was recorded; times in s, voltages in V, speeds in rad/s."""

    gain: float
    time_constant: float
    coulomb: float
    delay: float
    sample_time: float
    samples: int
    amplitude: float
    torque: float  # V, of the random voltage
    noise: float  # of the reading: counts, or of the top speed for a speed sensor
    counts: int
    input: str
    output: str
    start: str


def drawn(random: np.random.Generator) -> PlainMotor:
    """Draw a motor: τ 3 ms to 3 s, K 0.5 to 500, 5 to 100 τ long, τ/Ts 2 to 500, 1 to 24 V, 12 to 65,536 counts."""
    tau = _log(random, 3e-3, 3.0)
    sample_time = float(np.clip(tau / _log(random, 2.0, 500.0), 1e-4, 0.05))
    amplitude = _log(random, 1.0, 24.0)
    output = str(random.choice(["counts", "rad", "difference", "speed"], p=[0.45, 0.2, 0.2, 0.15]))
    noisy = random.random() < 0.5
    noise = _log(random, 1e-3, 0.03) if output == "speed" else _log(random, 0.1, 2.0) if noisy else 0.0
    return PlainMotor(
        gain=min(_log(random, 0.5, 500.0), _FASTEST / amplitude),
        time_constant=tau,
        coulomb=float(random.uniform(0.0, 0.4)) * amplitude * float(random.random() < 0.7),
        delay=float(random.uniform(_DELAYS[0], _DELAYS[-1])) * sample_time * float(random.random() < 0.75),
        sample_time=sample_time,
        samples=int(np.clip(_log(random, 5.0, 100.0) * tau / sample_time, 150, _MOST)),
        amplitude=amplitude,
        torque=amplitude * _log(random, 1e-3, 0.05) if random.random() < 0.5 else 0.0,
        noise=noise,
        counts=round(_log(random, 12, 65536)),
        input=str(random.choice(list(INPUTS))),
        output=output,
        start=str(random.choice(["rest", "running", "cold"])),
    )


def _log(random: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def recorded(motor: PlainMotor, random: np.random.Generator) -> Dataset:
    """Return what a recording of a motor has: from rest with a lead of zero volts, cold, or begun while it ran."""
    u = motor.amplitude * INPUTS[motor.input](random, motor.samples, motor.time_constant / motor.sample_time)
    before = int(np.ceil(5 * motor.time_constant / motor.sample_time)) if motor.start == "running" else 0
    if motor.start == "running":
        u = np.concatenate([u[-before:] if before <= len(u) else np.resize(u, before), u])
    elif motor.start == "rest":
        u[: max(5, motor.samples // 20)] = 0.0
    speed, angle = simulated(motor, u, random)
    u, speed, angle = u[before:], speed[before:], angle[before:]
    t = np.arange(len(u)) * motor.sample_time
    y, quantum, chain = _measured(motor, speed, angle, random)
    is_speed = motor.output in ("difference", "speed")
    return Dataset(
        name="plain motor",
        t_input=t,
        u=u,
        input_unit="V",
        input_before=0.0 if motor.start != "running" else float(u[0]),
        t_output=t,
        y=y,
        output_unit="rad/s" if is_speed else "rad",
        kind="speed" if is_speed else "position",
        source=Source(name="plain motor"),
        quantum=quantum,
        declared=Chain.parse(chain),
        chain_known=True,
    )


def _measured(
    motor: PlainMotor, speed: Array, angle: Array, random: np.random.Generator
) -> tuple[Array, float | None, str]:
    """The output, its quantum where it is known, and the chain."""
    quantum = 2 * np.pi / motor.counts
    if motor.output == "speed":
        top = motor.gain * motor.amplitude
        return speed + motor.noise * top * random.standard_normal(len(speed)), None, ""
    counted = np.floor(angle / quantum + motor.noise * random.standard_normal(len(angle)))
    if motor.output == "difference":
        return np.diff(counted, prepend=counted[0]) * quantum / motor.sample_time, None, "derivative"
    return (counted + 0.5) * quantum, quantum if motor.output == "counts" else None, ""


def simulated(motor: PlainMotor, u: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """Return speed (N,) [rad/s] and angle (N,) [rad] from rest anywhere; sample k is latched before u[k] acts."""
    whole, part = divmod(motor.delay / motor.sample_time, 1.0)
    padded = np.concatenate([np.zeros(int(whole) + 1), u])
    shaken = (
        motor.torque * random.standard_normal((len(u), _PARTS)) if motor.torque else np.zeros((len(u), 1))
    )
    out = np.empty((len(u), 2))
    _march(
        (motor.gain, motor.time_constant, motor.coulomb),
        padded[: len(u)],
        padded[1 : len(u) + 1],
        part * motor.sample_time,
        motor.sample_time,
        shaken,
        random.uniform(0.0, 2 * np.pi),
        out,
    )
    return out[:, 0], out[:, 1]


@numba.njit(cache=True)
def _march(p, late, held, first, dt, shaken, angle, out):  # type: ignore[no-untyped-def]
    """Fill out (N, 2) with speed and angle: in each sample `late` acts for a time `first`, then `held`."""
    speed = 0.0
    parts = shaken.shape[1]
    for n in range(len(late)):
        out[n, 0], out[n, 1] = speed, angle
        begin = 0.0
        for k in range(parts):
            end = dt * (k + 1) / parts
            switch = min(max(first, begin), end)
            speed, angle = _slide(p, late[n] + shaken[n, k], switch - begin, speed, angle)
            speed, angle = _slide(p, held[n] + shaken[n, k], end - switch, speed, angle)
            begin = end


@numba.njit(cache=True)
def _slide(p, volt, h, speed, angle):  # type: ignore[no-untyped-def]
    """Return speed and angle after a time h at a voltage; p = (K, τ, Coulomb voltage)."""
    gain, tau, lost = p
    while h > 0.0:
        if speed == 0.0 and abs(volt) <= lost:
            break
        sense = np.sign(volt) if speed == 0.0 else np.sign(speed)
        final = gain * (volt - sense * lost)
        span = h
        stops = speed * final < 0.0 or (final == 0.0 and speed != 0.0 and lost > 0.0)
        if speed * final < 0.0:
            until = tau * np.log((final - speed) / final)
            stops = until < h
            span = min(until, h)
        else:
            stops = False
        change = -np.expm1(-span / tau) * (final - speed)
        angle += final * span - tau * change
        speed = 0.0 if stops else speed + change
        h -= span
    return speed, angle


def _levels(random: np.random.Generator, n: int, lag: float, levels: Array) -> Array:
    """Levels in turn, each for 1 to 6 time constants, and again until the record is full."""
    hold = max(2, int(random.uniform(1.0, 6.0) * lag))
    return np.asarray(np.resize(np.repeat(levels, hold), n), dtype=np.float64)


def _bits(random: np.random.Generator, n: int, lag: float) -> Array:
    hold = max(1, int(random.uniform(0.3, 2.0) * lag))
    return np.repeat(random.integers(0, 2, n // hold + 1), hold)[:n].astype(np.float64)


def _phase(n: int, lag: float, slow: float, fast: float) -> Array:
    """The phase of a chirp from `slow` to `fast` over the motor's corner, in rad."""
    way = np.arange(n) / n
    return np.asarray(n / lag * (slow * way + 0.5 * (fast - slow) * way**2))


def _sines(random: np.random.Generator, n: int, lag: float) -> Array:
    rates = np.geomspace(0.1, 3.0, 8) / lag
    x = sum(np.sin(rate * np.arange(n) + random.uniform(0, 2 * np.pi)) for rate in rates)
    return np.asarray(x / np.abs(x).max())


_UP = np.array([0.25, 0.5, 0.75, 1.0, 0.75, 0.5])

INPUTS = {
    "step": lambda random, n, lag: np.where(np.arange(n) < n // 10, 0.0, 1.0),
    "steps both ways": lambda random, n, lag: np.repeat([0.0, 1.0, 0.0, -1.0, 0.0], n // 5 + 1)[:n],
    "square one way": lambda random, n, lag: _levels(random, n, lag, np.array([1.0, 0.4])),
    "square two ways": lambda random, n, lag: _levels(random, n, lag, np.array([1.0, -1.0])),
    "stairs one way": lambda random, n, lag: _levels(random, n, lag, _UP),
    "stairs two ways": lambda random, n, lag: _levels(random, n, lag, np.concatenate([_UP, -_UP])),
    "prbs one way": lambda random, n, lag: 0.4 + 0.6 * _bits(random, n, lag),
    "prbs two ways": lambda random, n, lag: 2 * _bits(random, n, lag) - 1,
    "chirp": lambda random, n, lag: np.sin(_phase(n, lag, 0.1, 3.0)),
    "multisine": _sines,
    "sine": lambda random, n, lag: np.sin(random.uniform(0.2, 2.0) / lag * np.arange(n)),
    "ramp": lambda random, n, lag: np.arange(n) / n,
}
