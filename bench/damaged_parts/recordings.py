"""Recordings of ours, as the simulated device makes them: every kind of excitation, and several motors."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from servobench.recordings.recording import Recording
from servobench.rig.devices.base import connect
from servobench.rig.experiment.experiment import Experiment
from servobench.rig.loop.run import run
from servobench.systems.signals.chirp import Chirp
from servobench.systems.signals.constant import Constant
from servobench.systems.signals.multisine import Multisine
from servobench.systems.signals.prbs import PRBS
from servobench.systems.signals.ramp import Ramp
from servobench.systems.signals.square import Square
from servobench.systems.signals.staircase import Staircase
from servobench.systems.signals.step import Step
from servobench.systems.signals.triangle import Triangle

SIGNALS = {
    "square": Square(low=1, high=3, frequency=0.4),
    "square ±2 V": Square(low=-2, high=2, frequency=0.4),
    "PRBS": PRBS(low=-3, high=3, bit_time=0.1),
    "staircase": Staircase(levels=(0.5, 1, 2, 3, 2, 1, -1, -2, -3, -1), dwell=1.0),
    "multisine": Multisine(amplitude=3.0, frequency=0.1, highest=3.0),
    "chirp": Chirp(amplitude=3.0, initial_frequency=0.2, final_frequency=5.0, sweep_time=10.0),
    "step": Step(initial=1, final=3, start=0.3),
    "step from rest": Step(initial=0, final=3, start=0.3),
    "triangle 0.1 Hz": Triangle(low=-3, high=3, frequency=0.1),
    "ramp": Ramp(initial=0.0, final=3.0, start=0.0, duration=10.0),
    "constant": Constant(value=2.0),
}


@dataclass(frozen=True, kw_only=True)
class Ours:
    """One recording of ours: excitation, length [s], sample time [s], and what the device is set to."""

    signal: str
    duration: float = 10.0
    sample_time: float = 0.002
    device: tuple[tuple[str, object], ...] = ()
    words: str = ""

    def made(self, seed: int) -> Recording:
        """Return the recording of that seed: another start angle, another inertia and motor constant, within ±5 %."""
        return _made(self, seed)


@lru_cache(maxsize=64)
def _made(ours: Ours, seed: int) -> Recording:
    random = np.random.default_rng(seed)
    inertia, constant = 1 + 0.05 * (2 * random.random(2) - 1)
    settings = {
        "disc_inertia": 1.63e-5 * inertia,
        "motor_constant": 0.042 * constant,
        "start_angle": float(random.random()),
        **dict(ours.device),
    }
    experiment = Experiment(
        signal=SIGNALS[ours.signal],
        duration=ours.duration,
        sample_time=ours.sample_time,
        seed=seed,
    )
    with connect("twin", **settings) as device:
        return run(experiment, device)


def undamaged() -> tuple[Ours, ...]:
    """Return the recordings in which no doubt may be found: excitations, lengths, rates, motors and noises."""
    every = ("square", "square ±2 V", "PRBS", "staircase", "multisine", "chirp", "step")
    still: tuple[tuple[str, object], ...] = (("coulomb_torque", 0.0),)
    torque: tuple[tuple[str, object], ...] = (("torque_noise", 1e-5),)
    heavy: tuple[tuple[str, object], ...] = (("disc_inertia", 6e-5), ("resistance", 6.0))
    return (
        *(Ours(signal=name, words=f"{name}, 10 s") for name in every),
        *(Ours(signal=name, sample_time=0.01, words=f"{name}, 100 Hz") for name in every),
        *(Ours(signal=name, duration=3.0, words=f"{name}, 3 s") for name in every if name != "staircase"),
        Ours(signal="PRBS", duration=1.0, words="PRBS, 1 s"),
        Ours(signal="step", duration=1.0, words="step, 1 s"),
        *(Ours(signal=name, device=still, words=f"{name}, no Coulomb friction") for name in every),
        *(Ours(signal=name, device=torque, words=f"{name}, random torque") for name in every),
        *(Ours(signal=name, device=heavy, words=f"{name}, another motor") for name in every),
    )
