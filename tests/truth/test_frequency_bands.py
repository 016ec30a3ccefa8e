"""Do the bands of a frequency response, and the intervals of what is fitted to it, cover? And is distortion told from noise?

The truth is a linear motor between its samples, in closed form: G = K e^(-ds)/(τs + 1), over s for the position.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from servobench.core.estimate import Estimate
from servobench.identification.estimators.base import ESTIMATORS
from servobench.identification.estimators.frequency_response import bode_readings, frequency_response
from servobench.identification.models.base import STRUCTURES
from servobench.recordings.measurement.base import Chain
from servobench.recordings.measurement.dataset import Dataset
from servobench.recordings.recording import Source
from tests import coverage

Array = NDArray[np.float64]
T, OFFSET, QUANTUM = 0.004, 0.2, 2 * np.pi / 2048
SAMPLES = 2000


@dataclass(frozen=True, kw_only=True)
class Motor:
    """A motor, where it starts, and the intensity q of the random acceleration [rad²/s³] that acts on it."""

    gain: float = 23.0
    tau: float = 0.1
    delay: float = 0.0
    speed: float = 30.0
    angle: float = 0.3
    q: float = 0.0

    def response(self, omega: Array) -> NDArray[np.complex128]:
        """G(jω) of the speed."""
        return np.asarray(self.gain * np.exp(-1j * omega * self.delay) / (1 + 1j * omega * self.tau))

    def states(self, u: Array, random: np.random.Generator) -> tuple[Array, Array]:
        """Angle and speed at the samples, before each u (N,) acts; a delay of less than a sample."""
        kicks = self._kicks(len(u), random)
        # What acts in the two parts of each sample; without a delay the first lasts no time and does nothing.
        late = np.append(u[:1], u[:-1]) - OFFSET
        parts = [
            (*matrix.ravel().tolist(), np.outer(v, drive).tolist())
            for h, v in ((self.delay, late), (T - self.delay, u - OFFSET))
            for matrix, drive in [self._steps(h)]
            if h > 0
        ]
        states = np.empty((len(u), 2))
        angle, speed = self.angle, self.speed
        for k, (kick_of_angle, kick_of_speed) in enumerate(kicks.tolist()):
            states[k] = angle, speed
            # Number by number: products of such small matrices take ten times as long.
            for a, b, c, d, pushes in parts:
                of_angle, of_speed = pushes[k]
                angle, speed = a * angle + b * speed + of_angle, c * angle + d * speed + of_speed
            angle, speed = angle + kick_of_angle, speed + kick_of_speed
        return states[:, 0], states[:, 1]

    def _steps(self, h: float) -> tuple[Array, Array]:
        fall = -np.expm1(-h / self.tau)
        matrix = np.array([[1.0, self.tau * fall], [0.0, 1.0 - fall]])
        return matrix, self.gain * np.array([h - self.tau * fall, fall])

    def _kicks(self, count: int, random: np.random.Generator) -> Array:
        """White acceleration over a sample: its exact covariance."""
        if self.q == 0:
            return np.zeros((count, 2))
        tau, a = self.tau, np.exp(-T / self.tau)
        cross = tau**2 * (1 - a) ** 2 / 2
        of_angle = tau**2 * (T - 2 * tau * (1 - a) + tau * (1 - a**2) / 2)
        q = self.q * np.array([[of_angle, cross], [cross, tau * (1 - a**2) / 2]])
        return np.asarray(random.standard_normal((count, 2)) @ np.linalg.cholesky(q).T)


def record(u: Array, y: Array, kind: str, chain: str = "", quantum: float | None = None) -> Dataset:
    """A dataset of y (N,), a position or a speed, after a chain."""
    t = T * np.arange(len(u))
    stages = Chain.parse(chain)
    what = stages.yields("position" if kind == "position" else "speed")
    return Dataset(
        name="motor", t_input=t, u=u, input_unit="V", input_before=float(u[0]), t_output=t, y=stages(y, t),
        output_unit="rad" if what == "position" else "rad/s", kind=what, source=Source(name="motor"),
        quantum=quantum, applied=stages,
    )  # fmt: skip


def multisine(period: int, lines: Array, random: np.random.Generator, samples: int = SAMPLES) -> Array:
    """Cosines at lines of a period with random phases, root mean square 1."""
    phases = 2 * np.pi * random.random(len(lines))
    x = np.cos(2 * np.pi * np.outer(np.arange(period), lines) / period + phases).sum(axis=1)
    return np.resize(x * np.sqrt(2 / len(lines)), samples)


def binary(samples: int, hold: int, random: np.random.Generator) -> Array:
    """±3 V at random, each held for some samples; it doesn't repeat."""
    return np.repeat(random.choice([-3.0, 3.0], -(-samples // hold)), hold)[:samples]


def square(samples: int, phase: float = 0.0) -> Array:
    """1 to 3 V, a period of 500 samples."""
    return np.where((np.arange(samples) / 500 + phase + 1e-9) % 1 < 0.5, 3.0, 1.0)


def encoder(angle: Array) -> Array:
    return np.asarray((np.floor(angle / QUANTUM) + 0.5) * QUANTUM)


def speed_of_a_multisine(motor: Motor, random: np.random.Generator) -> Dataset:
    u = 2 + multisine(500, np.arange(1, 50, 2), random)
    return record(u, motor.states(u, random)[1] + 0.3 * random.standard_normal(SAMPLES), "speed")


def filtered_position(motor: Motor, random: np.random.Generator) -> Dataset:
    u = 2 + multisine(500, np.arange(1, 50, 2), random)
    y = motor.states(u, random)[0] + 0.003 * random.standard_normal(SAMPLES)
    return record(u, y, "position", "derivative | lowpass 50 rad/s")


def position_that_does_not_repeat(motor: Motor, random: np.random.Generator) -> Dataset:
    u = binary(SAMPLES, 20, random)
    return record(u, motor.states(u, random)[0] + 0.005 * random.standard_normal(SAMPLES), "position")


def encoder_with_a_square(motor: Motor, random: np.random.Generator) -> Dataset:
    u = square(SAMPLES, random.random())
    return record(u, encoder(motor.states(u, random)[0]), "position", quantum=QUANTUM)


def torque(motor: Motor, random: np.random.Generator) -> Dataset:
    disturbed = replace(motor, q=0.05)
    u = binary(SAMPLES, 20, random)
    return record(u, encoder(disturbed.states(u, random)[0]), "position", quantum=QUANTUM)


def drawn(random: np.random.Generator) -> Motor:
    """A motor within ±5 % of the usual one."""
    gain, tau = np.array([23.0, 0.1]) * (1 + 0.05 * (2 * random.random(2) - 1))
    return Motor(gain=float(gain), tau=float(tau), speed=float(20 + 50 * random.random()))


CASES = [
    speed_of_a_multisine,
    filtered_position,
    position_that_does_not_repeat,
    encoder_with_a_square,
    torque,
]


@cache
def fitted(
    case: Callable[[Motor, np.random.Generator], Dataset], seed: int
) -> tuple[Motor, Mapping[str, Estimate]]:
    """A motor that is drawn with that seed, and what is found of it."""
    random = np.random.default_rng([7, seed])
    motor = drawn(random)
    return motor, ESTIMATORS["frequency_response"].fit(
        STRUCTURES["first_order"], [case(motor, random)]
    ).estimates


@cache
def within_bands(case: Callable[[Motor, np.random.Generator], Dataset], seed: int) -> NDArray[np.bool_]:
    """Which points of a frequency response lie no further from the truth than the circle that holds 95 %."""
    random = np.random.default_rng([8, seed])
    motor = drawn(random)
    points = frequency_response(case(motor, random)).as_speed()
    off = np.abs(points.response - motor.response(points.omega))
    return np.asarray(off <= np.sqrt(-2 * np.log(0.05)) * points.sd)


@pytest.mark.parametrize("runs", coverage.RUNS)
@pytest.mark.parametrize("case", CASES)
def test_95_percent_intervals_of_the_fit_cover(
    case: Callable[[Motor, np.random.Generator], Dataset], runs: int
) -> None:
    """Motors within ±5 %; a random torque is a tenth of what turns the motor, and no other case has one.

    No delay can be below zero, which is the truth, so its estimates scatter half as much; and the rounding of counts that a
    square passes again and again is no noise: its errors are bounded, and scatter less than normal ones of the same coverage.
    """
    covers: dict[str, list[bool]] = {"gain": [], "time_constant": [], "delay": []}
    offs: dict[str, list[float]] = {"gain": [], "time_constant": []}
    for seed in range(runs):
        motor, found = fitted(case, seed)
        for name, truth in (("gain", motor.gain), ("time_constant", motor.tau), ("delay", motor.delay)):
            low, high = found[name].interval
            covers[name].append(low <= truth <= high)
            if name in offs:
                offs[name].append(coverage.off((low, high), truth))
    for name, each in covers.items():
        coverage.check_counts(name, each)
    if case is not encoder_with_a_square:
        for name in offs:
            coverage.check_spread(name, offs[name])
            coverage.check_bias(name, offs[name])


@pytest.mark.parametrize("runs", [10, pytest.param(20, marks=pytest.mark.long)])
@pytest.mark.parametrize("case", CASES)
def test_95_percent_bands_of_points_cover(
    case: Callable[[Motor, np.random.Generator], Dataset], runs: int
) -> None:
    """Points are many, and those of a run hardly depend on each other: of 20 runs 500 at least, 95 ± 1 %. An encoder's rounding
    isn't quite noise, so that three times as much is allowed on both sides; √2 times that of half as many."""
    within = [within_bands(case, seed) for seed in range(runs)]
    assert abs(np.mean(np.concatenate(within)) - 0.95) <= 0.03 * np.sqrt(20 / runs)


@cache
def speed_under_sines() -> tuple[Array, Array]:
    """The input and the speed; without a random torque, so it is the same in each run."""
    n = np.arange(2000)
    u = 2 + np.concatenate([np.sin(2 * np.pi * f * T * n) for f in (0.3, 0.7, 1.3, 2.9, 5.3)])
    return u, Motor(delay=0.0015).states(u, np.random.default_rng(9))[1]


@cache
def readings_of_sines(seed: int) -> Mapping[str, Estimate]:
    u, speed = speed_under_sines()
    y = speed + 0.3 * np.random.default_rng([9, seed]).standard_normal(len(u))
    return bode_readings(frequency_response(record(u, y, "speed")))


@pytest.mark.parametrize("runs", [20, pytest.param(60, marks=pytest.mark.long)])
def test_magnitude_and_phase_of_sines_give_the_same_time_constant_and_cover(runs: int) -> None:
    """Five sines of 8 s each, one after the other in one record."""
    covered = {"gain": 0, "time_constant_from_magnitude": 0, "time_constant_from_phase": 0, "corner": 0}
    true = {
        "gain": 23.0,
        "time_constant_from_magnitude": 0.1,
        "time_constant_from_phase": 0.1,
        "corner": 10.0,
    }
    for seed in range(runs):
        found = readings_of_sines(seed)
        for name, count in covered.items():
            low, high = found[name].interval
            covered[name] = count + (low <= true[name] <= high)
    fewest, _ = coverage.fewest_and_most(runs)
    for name, count in covered.items():
        assert count >= fewest, (name, count)


def distorted(seed: int, square_part: float, cube_part: float, noise: float) -> tuple[Dataset, Array, Array]:
    """Steady periods of w + c₂ w² + c₃ w³ behind the motor, with noise; the input, and the same without noise.

    The input has three of four odd harmonics up to the 79th, at random.
    """
    random = np.random.default_rng([10, seed])
    odd = np.arange(1, 80, 2).reshape(-1, 4)
    lines = np.sort(
        np.concatenate(
            [np.delete(group, np.random.default_rng(n).integers(4)) for n, group in enumerate(odd)]
        )
    )
    u = multisine(500, lines, random, 3000)
    w = Motor(speed=0.0).states(u + OFFSET, random)[1][1000:]
    y = w + square_part * w**2 + cube_part * w**3
    u = u[1000:] + OFFSET
    return record(u, y + noise * random.standard_normal(len(y)), "speed"), u, y


@pytest.mark.parametrize(("c2", "c3"), [(0.004, 0.0), (0.0, 3e-4)])
def test_detection_lines_show_the_kind_and_the_size_of_a_distortion(c2: float, c3: float) -> None:
    data, _, clean = distorted(1, c2, c3, 0.02)
    found = frequency_response(data).detection
    assert found is not None
    # The truth: the Fourier series of the last period without noise. 3 standard deviations of the mean power over L lines.
    series = 2 * np.abs(np.fft.rfft(clean[-500:])) / 500
    k = np.rint(found.omega * 500 * T / (2 * np.pi)).astype(int)
    for odd in (False, True):
        lines = np.flatnonzero(found.odd == odd)
        truth = float(np.mean(series[k[lines]] ** 2))
        noise = float(np.mean(found.noise[lines] ** 2))
        margin = 3 * np.sqrt((noise**2 + 2 * noise * truth) / len(lines))
        assert abs(float(np.mean(found.amplitude[lines] ** 2)) - noise - truth) <= margin + 0.05 * truth
        over_noise = np.mean((found.amplitude[lines] / found.noise[lines]) ** 2)
        assert (over_noise > 10) == (odd == (c3 > 0))


def test_noise_and_distortion_are_told_apart_by_realisations() -> None:
    """The scatter of Y/U over 100 realisations without noise is what a non-linear motor adds to each of them.

    Over 30 lines that is 3000 complex numbers, whose root mean square is known to 1 %.
    """
    c3, noise = 3e-4, 0.2
    ratios = []
    for seed in range(100):
        _, u, clean = distorted(1000 + seed, 0.0, c3, 0.0)
        lines = np.flatnonzero(np.abs(np.fft.rfft(u[-500:] - OFFSET)) > 1.0)
        ratios.append(np.fft.rfft(clean[-500:])[lines[lines > 0]] / np.fft.rfft(u[-500:])[lines[lines > 0]])
    truth = np.sqrt(0.5 * np.var(np.array(ratios), axis=0))
    found = frequency_response([distorted(seed, 0.0, c3, noise)[0] for seed in range(8)])
    # Mean over the lines of the scatter's power: 7 x 30 degrees of freedom, 7 %, for what is seen of noise and distortion; the
    # amplitude divided by the hold's sinc and half sample, and by an alias of a per mil. Within 20 %.
    hold = np.abs(np.sinc(found.omega * T / (2 * np.pi)))
    seen = np.sqrt(np.mean((found.distortion_sd * hold) ** 2))
    assert seen == pytest.approx(np.sqrt(np.mean(truth**2)), rel=0.2)
    # What noise makes of each point: its power at a line over the input's; the mean of 8 records of 4 periods each.
    amplitude = np.sqrt(2 / 30)
    expected = noise * np.sqrt(0.5) / (amplitude * np.sqrt(2000) / 2) / np.sqrt(8)
    # The transient's three coefficients over windows with 15 quiet lines take a tenth more; the level is known to 5 %.
    assert np.median(found.noise_sd * hold) == pytest.approx(expected, rel=0.2)
