"""Random motors and records of them, over the range that people own."""

from dataclasses import dataclass

import numpy as np

from population_parts.departures import NONE, Departure
from population_parts.inputs import INPUTS, Array

TURN = 2 * np.pi
_OUTPUTS = {"counts": 0.45, "rad": 0.20, "differentiated": 0.20, "speed": 0.15}
_STARTS = ("lead", "running", "cold")
_ROWS = 20  # the least of a record
_FASTEST = 3500.0  # rad/s: hardly a motor with an encoder turns faster, 33,000 rpm


@dataclass(frozen=True, kw_only=True)
class Motor:
    """A motor, its sensor and its noises.

    Gain [rad/(s·V)], time constant, delay and sample time [s], Coulomb voltage [V]; `counts` in a turn; `noise` is the standard
    deviation of a reading [rad, or rad/s of a speed sensor]; `torque` is the intensity of the random torque as a voltage [V²·s],
    white.
    """

    gain: float
    tau: float
    delay: float
    coulomb: float
    sample_time: float
    counts: int
    noise: float
    torque: float
    departure: Departure = NONE

    @property
    def quantum(self) -> float:
        """The angle of a count [rad]."""
        return TURN / self.counts


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A motor and the experiment with it.

    `t` and `u` (L,) are the input from the time on at which the shaft still rested, `first` the number of the first row of the
    record in them; `output` and `start` as drawn, `chain` is what the record says of its output, `angle` the start angle [rad].
    """

    motor: Motor
    input: str
    amplitude: float
    output: str
    start: str
    chain: str
    angle: float
    t: Array
    u: Array
    first: int
    seed: tuple[int, ...]


def drawn(seed: tuple[int, ...], departure: Departure = NONE) -> Case:
    """Return the record of that seed."""
    random = np.random.default_rng(seed)
    tau, sample_time, length = _times(random)
    amplitude = _log(random, 1.0, 24.0)
    gain = _gain(random, amplitude, seed)
    outputs = [name for name in _OUTPUTS if departure.output_fits(name)]
    share = np.array([_OUTPUTS[name] for name in outputs])
    output = str(random.choice(outputs, p=share / share.sum()))
    counts = round(_log(random, 12.0, 65536.0))
    reads = output == "speed"
    noisy, shaken = random.random() < 0.5 or reads, random.random() < 0.5
    size = gain * amplitude * _log(random, 1e-3, 3e-2) if reads else TURN / counts * _log(random, 0.1, 3.0)
    coulomb = amplitude * departure.coulomb_share(random.uniform(0.0, 0.4) * (random.random() < 0.8))
    motor = Motor(
        gain=gain,
        tau=tau,
        delay=sample_time * random.uniform(0.0, 3.0) * (random.random() < 0.75),
        coulomb=coulomb,
        sample_time=sample_time,
        counts=counts,
        noise=size * noisy,
        # The speed wanders by K √(intensity/(2 τ)): 0.01 to 1 % of the top speed.
        torque=2 * tau * (amplitude * _log(random, 1e-4, 1e-2)) ** 2 * shaken,
        departure=departure.drawn(random, amplitude, gain),
    )
    kind, start = str(random.choice(list(INPUTS))), str(random.choice(_STARTS))
    t, u, first = _experiment(random, kind, start, amplitude, motor, length)
    declared = {"differentiated": str(random.choice(["derivative", ""])), "speed": "none"}
    return Case(
        motor=motor,
        input=kind,
        amplitude=amplitude,
        output=output,
        start=start,
        chain=declared.get(output, ""),
        angle=random.uniform(0.0, TURN),
        t=t,
        u=u,
        first=first,
        seed=seed,
    )


def _times(random: np.random.Generator) -> tuple[float, float, int]:
    """Time constant and sample time [s], and the rows of the record."""
    while True:
        tau, ratio, length = (_log(random, *ends) for ends in ((3e-3, 3.0), (2.0, 500.0), (5.0, 100.0)))
        rows = round(length * ratio)
        if 1e-4 <= tau / ratio <= 0.05 and rows >= _ROWS:
            return tau, tau / ratio, rows


def _gain(random: np.random.Generator, amplitude: float, seed: tuple[int, ...]) -> float:
    """A gain [rad/(s·V)]; one that is too large for the amplitude is drawn again, apart from all else that is drawn."""
    gain = _log(random, 0.5, 500.0)
    again = np.random.default_rng((*seed, 4))
    while gain * amplitude > _FASTEST:
        gain = _log(again, 0.5, 500.0)
    return gain


def _experiment(
    random: np.random.Generator, kind: str, start: str, amplitude: float, motor: Motor, rows: int
) -> tuple[Array, Array, int]:
    """Times and input, and which of them is the record's first row, at time zero."""
    dt = motor.sample_time
    early = 0
    if start == "lead":
        early = min(max(2, round(rows * _log(random, 3e-3, 0.1))), rows // 3)
    elif start == "running":
        early = round(10 * motor.tau / dt)
    count = rows + early if start == "running" else rows - early
    u = INPUTS[kind](np.arange(count) * dt, amplitude, motor.tau, random)
    if start == "running":
        return np.arange(-early, rows) * dt, u, early
    return np.arange(rows) * dt, np.concatenate([np.zeros(early), u]), 0


def _log(random: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))
