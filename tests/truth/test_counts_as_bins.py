"""Interval likelihood against a motor in closed form: is it as much better than output error as theory says, and does it cover?

The motor is the exact zero-order-hold recursion of the first-order equations, with Gaussian noise before the counts are rounded.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.signal import lfilter

from servobench.core.channels import Array
from servobench.identification.estimators.base import ESTIMATORS, Fit
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source
from tests.datasets import QUANTUM, dataset, square
from tests.rig.motor.reference import march
from tests.truth.test_intervals import answers, drawn

STRUCTURE = STRUCTURES["first_order_one_way"]
RUNS = 200


class Motor(NamedTuple):
    """The true motor, and the beginning of the record."""

    gain: float
    time_constant: float
    delay: float
    position: float
    speed: float


def motor(seed: int, delay: float = 0.0) -> Motor:
    """The reference set-up: 8.4 Ω, 0.042 N·m/A, 2.1e-5 kg·m², 5e-6 N·m·s/rad, k and J within ±5 %, any start."""
    random = np.random.default_rng([seed, 1])
    k, j = 0.042 * random.uniform(0.95, 1.05), 2.1e-5 * random.uniform(0.95, 1.05)
    damping = 8.4 * 5e-6 + k * k
    return Motor(k / damping, 8.4 * j / damping, delay, random.random() * QUANTUM, random.uniform(20, 70))


def position(true: Motor, u: Array, dt: float) -> Array:
    """The position at the samples: u[k - 1] acts for the delay, then u[k], delay < dt.

    The speed is the recursion w' = a w + K (h e u[k-1] + (1 - e) u[k]); the position follows from
    τ dω/dt + dθ/dt = K u, integrated: θ - θ₀ = K ∫u - τ (ω - ω₀).
    """
    gain, tau, delay, start, speed = true
    earlier = np.append(u[0], u[:-1])
    a, e, h = np.exp(-dt / tau), np.exp(-(dt - delay) / tau), -np.expm1(-delay / tau)
    drive = gain * (h * e * earlier + (1 - e) * u)
    w = np.append(speed, lfilter([1.0], [1.0, -a], drive[:-1], zi=[a * speed])[0])
    travelled = np.append(0.0, np.cumsum(delay * earlier + (dt - delay) * u)[:-1])
    return np.asarray(start + gain * travelled - tau * (w - speed), dtype=np.float64)


def record(
    seed: int, noise: float, *, samples: int = 5000, dt: float = 0.002, delay: float = 0.0
) -> tuple[Dataset, Motor]:
    """A record and its truth: the square wave, and noise of so many counts before the encoder rounds."""
    random = np.random.default_rng([seed, 2])
    true = motor(seed, delay)
    t = np.arange(samples) * dt
    u = square(t, random.random())
    seen = position(true, u, dt) + noise * QUANTUM * random.standard_normal(samples)
    y = (np.floor(seen / QUANTUM) + 0.5) * QUANTUM
    return Dataset(
        name="exact motor",
        t_input=t,
        u=u,
        input_unit="V",
        input_before=float(u[0]),
        t_output=t,
        y=y,
        output_unit="rad",
        kind="position",
        source=Source(name="exact motor"),
        quantum=QUANTUM,
    ), true


def fitted(data: Dataset, estimator: str = "interval_likelihood") -> Fit:
    return ESTIMATORS[estimator].fit(STRUCTURE, [data])


def covered(fit: Fit, true: Motor) -> list[bool]:
    """Whether the 95 % intervals of gain and time constant hold the truth."""
    pairs = ((fit["gain"], true.gain), (fit["time_constant"], true.time_constant))
    return [e.interval[0] <= value <= e.interval[1] for e, value in pairs]


def test_noise_of_a_twentieth_of_a_count_is_used_and_the_intervals_cover() -> None:
    """The information of a count is 36.1/Q² there, against 11.7/Q² of its middle: √(36.1/11.7) = 1.76 times better.

    200 runs know the ratio to about 6 %; at least 1.5 is asked for. Their coverage of 95 % has a standard deviation of 1.5 %; 91
    and 99 % are 2.6 of them away.
    """
    errors: dict[str, list[list[float]]] = {"output_error": [], "interval_likelihood": []}
    hits = []
    for seed in range(RUNS):
        data, true = record(seed, 0.05)
        for name, found in errors.items():
            fit = fitted(data, name)
            found.append([fit["gain"].value - true.gain, fit["time_constant"].value - true.time_constant])
        hits.append(covered(fit, true))
    rms = {name: np.sqrt(np.mean(np.square(found), axis=0)) for name, found in errors.items()}
    assert np.all(rms["output_error"] >= 1.5 * rms["interval_likelihood"])
    coverage = np.mean(hits, axis=0)
    assert np.all((coverage >= 0.91) & (coverage <= 0.99)), coverage


@pytest.mark.parametrize(
    ("noise", "samples", "dt"), [(0.0, 5000, 0.002), (0.3, 5000, 0.002), (0.05, 500, 0.02)]
)
def test_without_noise_with_much_of_it_and_with_few_samples_the_intervals_cover_too(
    noise: float, samples: int, dt: float
) -> None:
    """100 runs with a coverage of 95 % cover less than 88 in 1 case of 300; without noise they may cover all."""
    hits = []
    for seed in range(100):
        data, true = record(seed, noise, samples=samples, dt=dt)
        hits.append(covered(fitted(data), true))
    assert np.all(np.mean(hits, axis=0) >= 0.88)


def test_a_delay_of_a_part_of_a_sample_is_found() -> None:
    data, _ = record(7, 0.05, delay=0.0006)
    delay = fitted(data)["delay"]
    assert abs(delay.value - 0.0006) < 3.3 * delay.sd
    assert delay.sd < 3e-6


def test_a_motor_with_a_winding_and_friction_is_hit_at_this_precision_too() -> None:
    """The first-order model with a delay stands for a motor with a fast pole: still within 3.3 standard deviations."""
    for seed in range(4):
        truth = drawn(seed)
        random = np.random.default_rng([seed, 3])
        data = dataset(seed=seed, y=np.zeros(5000))
        angle = march(truth, data.u, 0.002, angle=random.random() * QUANTUM)[:, 2]
        seen = angle + 0.05 * QUANTUM * random.standard_normal(5000)
        # The same voltage as the record's; without the first 0.5 s, in which it starts from rest.
        data = replace(data, y=(np.floor(seen / QUANTUM) + 0.5) * QUANTUM).part(0.5, 10.0)
        fit = fitted(data)
        for name, value in answers(truth).items():
            assert abs(fit[name].value - value) < 3.3 * fit[name].sd, (seed, name)
