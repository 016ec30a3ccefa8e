"""Datasets for tests: the reference motor of `tests.rig.motor.reference` behind an ideal encoder."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source
from tests.rig.motor.reference import Truth, march

QUANTUM = 2 * np.pi / 2048


def square(t: NDArray[np.float64], phase: float = 0.0) -> NDArray[np.float64]:
    """The paper's square wave, 1 to 3 V at 0.4 Hz; the phase is a part of a period."""
    return np.where((0.4 * t + phase + 1e-9) % 1.0 < 0.5, 3.0, 1.0)


def prbs(samples: int, hold: int, random: np.random.Generator) -> NDArray[np.float64]:
    """±3 V from a shift register of 9 bits (x⁹ + x⁵ + 1) that starts anywhere, each bit held for some samples."""
    register = list(random.integers(0, 2, 9))
    if not any(register):
        register[0] = 1
    bits = []
    while len(bits) * hold < samples:
        bits.append(register[-1])
        register = [register[8] ^ register[4], *register[:-1]]
    return np.repeat(np.where(np.array(bits) == 1, 3.0, -3.0), hold)[:samples]


def dataset(
    *,
    seed: int,
    kind: Literal["square", "prbs"] = "square",
    samples: int = 5000,
    sample_time: float = 0.002,
    truth: Truth | None = None,
    hold: int = 50,
    chain: str = "",
    torque_noise: float = 0.0,
    u: NDArray[np.float64] | None = None,
    y: NDArray[np.float64] | None = None,
) -> Dataset:
    """Return a dataset of the reference motor: position from counts + 1/2, or what a chain makes of it.

    The input is `u` (M,), or of the kind.
    """
    random = np.random.default_rng(seed)
    t = np.arange(samples) * sample_time
    if u is None:
        u = square(t, random.random()) if kind == "square" else prbs(samples, hold, random)
    stages = Chain.parse(chain)
    if y is None:
        noise = {"torque_noise": torque_noise, "step": 5e-5, "seed": seed} if torque_noise else {}
        start = random.random() * QUANTUM
        angle = march(truth or Truth(), u, sample_time, angle=start, **noise)[:, 2]
        y = stages((np.floor(angle / QUANTUM) + 0.5) * QUANTUM, t)
    what = stages.yields("position")
    return Dataset(
        name="reference motor",
        t_input=t,
        u=u,
        input_unit="V",
        input_before=0.0,
        t_output=t,
        y=y,
        output_unit="rad" if what == "position" else "rad/s",
        kind=what,
        source=Source(name="reference motor"),
        quantum=None if stages else QUANTUM,
        applied=stages,
    )
