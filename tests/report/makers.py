"""Data for reports: from the exact solution of a first-order motor, computed here."""

from collections.abc import Sequence

import numpy as np

from servobench.core.channels import Array
from servobench.identification.estimators.base import Fit
from servobench.identification.models.base import STRUCTURES, Model
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source

GAIN, TIME_CONSTANT, QUANTUM = 23.7, 0.0992, 2 * np.pi / 2048


def motor(u: Array, sample_time: float) -> tuple[Array, Array]:
    """Return position and speed, at rest at first, just before each input of u (N,) begins to hold."""
    decay = np.exp(-sample_time / TIME_CONSTANT)
    speed, position = np.zeros(len(u)), np.zeros(len(u))
    for k in range(len(u) - 1):
        end = GAIN * u[k]
        speed[k + 1] = decay * speed[k] + (1 - decay) * end
        travelled = TIME_CONSTANT * (1 - decay) * (speed[k] - end)
        position[k + 1] = position[k] + end * sample_time + travelled
    return position, speed


def dataset(
    *,
    samples: int = 1500,
    name: str = "square",
    seed: int = 1,
    noise: float | None = None,
    level: float = 3.0,
) -> Dataset:
    """Return an encoder's positions under a square wave from 1 V to `level`, or with `noise` a noisy speed."""
    sample_time = 0.002
    t = np.arange(samples) * sample_time
    u = np.where((0.8 * t + 1e-9) % 1 < 0.5, level, 1.0)
    position, speed = motor(u, sample_time)
    rng = np.random.default_rng(seed)
    counts = np.floor((position + rng.random() * QUANTUM) / QUANTUM)
    is_position = noise is None
    y = (counts + 0.5) * QUANTUM if is_position else speed + noise * rng.standard_normal(samples)
    return Dataset(
        name=name,
        t_input=t,
        u=u,
        input_unit="V",
        input_before=0.0,
        t_output=t,
        y=y,
        output_unit="rad" if is_position else "rad/s",
        kind="position" if is_position else "speed",
        source=Source(name=name),
        quantum=QUANTUM if is_position else None,
    )


def fit_of(theta: Sequence[float], covariance: Array, data: Dataset | None = None) -> Fit:
    """Return a fit of the plain first-order structure (gain, time constant, offset, delay) that nobody had to search for."""
    model = Model(
        structure=STRUCTURES["first_order"], theta=np.array(theta), data=data or dataset(samples=50)
    )
    return Fit(
        model=model,
        covariance=covariance,
        estimator="output_error",
        structure="first_order",
        converged=True,
        status="converged in 1 step",
        residual_sd=1.0,
        records=(),
    )
